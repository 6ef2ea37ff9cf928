"""The labels that an answer starts from."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud

NEAREST = 64  # neighbours of a label that are looked at: strokes that cross the rings of a scanner are seen as one
MOST = 0.75  # share of the nearer points that have the same label
TIED = 1e-6  # relative, of squared distances
_CHUNK = 1 << 14  # labels that are looked at at once
_FIRST = 5  # ranks that are looked at first


class Labels(NamedTuple):
    """What is given of the points of a scan and of other scans.

    Attributes:
        points: (L,) with a label, each once.
        classes: (L,) of each, from 0 to ``num_classes`` - 1.
        num_classes: How many; those without a label get what others say for them.
        places: (L,) of each, see :func:`places_of`: the labels of a stroke are one observation, however many points.
        regions: (L,) of each, the smallest that the scan is divided into: what a class looks like is learnt from these.
        others: (E, F) features of labelled points of other scans.
        other_classes: (E,) of these.
    """

    points: Int[np.ndarray, ' labelled']
    classes: Int[np.ndarray, ' labelled']
    num_classes: int
    places: Int[np.ndarray, ' labelled']
    regions: Int[np.ndarray, ' labelled']
    others: Float[np.ndarray, 'examples features']
    other_classes: Int[np.ndarray, ' examples']

    @classmethod
    def of(
        cls,
        scene: PreparedCloud,
        points: Int[np.ndarray, ' labelled'],
        classes: Int[np.ndarray, ' labelled'],
        num_classes: int,
        others: Float[np.ndarray, 'examples features'] | None = None,
        other_classes: Int[np.ndarray, ' examples'] | None = None,
        tree: Octree | None = None,
    ) -> 'Labels':
        """Labels of a scan, told apart by place and region.

        Args:
            scene: The scan.
            points: Labelled ones, each once.
            classes: Of these, from 0.
            num_classes: How many.
            others: Examples of other scans; None: there are none.
            other_classes: Of these.
            tree: Of the points of the scan; None: made now.
        """
        return cls(
            points,
            classes,
            num_classes,
            places_of(scene.cloud.xyz, points, classes, tree),
            scene.scales[0].region[points],
            scene.features[:0] if others is None else others,
            np.zeros(0, dtype=np.int64) if other_classes is None else other_classes,
        )

    def select(self, rows: Bool[np.ndarray, ' labelled']) -> 'Labels':
        """Some of the labels, and all others."""
        return self._replace(
            points=self.points[rows],
            classes=self.classes[rows],
            places=self.places[rows],
            regions=self.regions[rows],
        )

    @property
    def counts(self) -> Int[np.ndarray, ' classes']:
        """Labels of each class."""
        return np.bincount(self.classes, minlength=self.num_classes)

    @property
    def place_counts(self) -> Int[np.ndarray, ' classes']:
        """Labels of each class, those of one place once."""
        return np.bincount(self.classes[one_of_each(self.places)], minlength=self.num_classes)

    @property
    def region_counts(self) -> Int[np.ndarray, ' classes']:
        """Regions with a label of each class."""
        there = np.unique(np.column_stack([self.regions, self.classes]), axis=0)
        return np.bincount(there[:, 1], minlength=self.num_classes)


def places_of(
    xyz: Float[np.ndarray, 'points 3'],
    points: Int[np.ndarray, ' labelled'],
    classes: Int[np.ndarray, ' labelled'],
    tree: Octree | None = None,
) -> Int[np.ndarray, ' labelled']:
    """Number of the place of each label; a stroke is one, be it of a brush, a rectangle or a click on a whole object.

    Where labels were drawn by chance few of the points around one are labelled; in a stroke most are. So two labels of
    a class are one place if three of four of the points that are no farther from the one than the other is have the
    same label, and so on from one to the next; and if they lie at one spot. No length is assumed, and scans are denser
    near the scanner. A line of single points is as many places as it has points.

    Args:
        xyz: Metres, of all points of the scan.
        points: Labelled ones, each once.
        classes: Of these.
        tree: Of all points; None: made now.

    >>> row = np.column_stack([np.arange(12.0), np.zeros(12), np.zeros(12)])
    >>> places_of(row, np.array([0, 1, 2, 7, 11]), np.array([5, 5, 5, 5, 5])).tolist()
    [0, 0, 0, 1, 2]
    """
    label, row = np.full(len(xyz), -1, dtype=np.int64), np.full(len(xyz), -1, dtype=np.int64)
    label[points], row[points] = classes, np.arange(len(points))
    tree, place = Octree(xyz) if tree is None else tree, np.arange(len(points))
    for first in range(0, len(points), _CHUNK):
        some = points[first : first + _CHUNK]
        found = tree.knn(xyz[some], NEAREST + 1)
        near, together = found.indices, _together(some, found.indices, found.sq_dists, label)
        for ranks in (slice(None, _FIRST), slice(_FIRST, None)):  # the nearest join most: few pairs are left then
            start, rank = np.nonzero(together[:, ranks])
            place = _joined(place, first + start, row[near[:, ranks][start, rank]])
    return np.unique(place, return_inverse=True)[1].astype(np.int64)


def _together(
    points: Int[np.ndarray, ' some'],
    near: Int[np.ndarray, 'some k'],
    squared: Float[np.ndarray, 'some k'],
    label: Int[np.ndarray, ' points'],
) -> Bool[np.ndarray, 'some k']:
    """Which neighbours have the same label as a point, as most of those have that are no farther from it."""
    there = (near >= 0) & (near != points[:, None])
    alike = there & (label[near] == label[points][:, None])
    count, of = (np.cumsum(each, axis=1, dtype=np.int16) for each in (alike, there))
    last = _last_as_near(squared)
    most = np.take_along_axis(count, last, axis=1) >= MOST * np.take_along_axis(of, last, axis=1)
    return np.asarray(alike & (most | (squared == 0.0)))


def _last_as_near(squared: Float[np.ndarray, 'some k']) -> Int[np.ndarray, 'some k']:
    """Rank of the last neighbour that is as near as each is, but for rounding: ties do not go by numbers of points.

    >>> _last_as_near(np.array([[0.0, 1.0, 1.0, 4.0]]))
    array([[0, 2, 2, 3]])
    """
    ends = np.ones(squared.shape, dtype=np.bool_)
    ends[:, :-1] = squared[:, 1:] > squared[:, :-1] * (1.0 + TIED)
    rank = np.where(ends, np.arange(squared.shape[1]), squared.shape[1])
    return np.asarray(np.minimum.accumulate(rank[:, ::-1], axis=1)[:, ::-1])


def _joined(
    place: Int[np.ndarray, ' labelled'], start: Int[np.ndarray, ' pairs'], end: Int[np.ndarray, ' pairs']
) -> Int[np.ndarray, ' labelled']:
    one, other = place[start], place[end]
    apart = one != other
    links = coo_array((np.ones(np.count_nonzero(apart)), (one[apart], other[apart])), shape=(len(place), len(place)))
    return np.asarray(connected_components(links, directed=False)[1][place])


def one_of_each(places: Int[np.ndarray, ' labelled'], seed: int | None = None) -> Int[np.ndarray, ' rows']:
    """Rows of one label of each place, ascending.

    Args:
        places: Of the labels.
        seed: Of which of them; None: the first.

    >>> one_of_each(np.array([0, 0, 1, 2, 1]))
    array([0, 2, 3])
    """
    order = np.arange(len(places)) if seed is None else np.random.default_rng(seed).permutation(len(places))
    return np.asarray(np.sort(order[np.unique(places[order], return_index=True)[1]]))
