"""The labels that an answer starts from."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

APART = 1.0  # spacings below which two labels of a class are one place, clicked twice


class Labels(NamedTuple):
    """What is given of the points of a scan and of other scans.

    Attributes:
        points: (L,) with a label, each once.
        classes: (L,) of each, from 0 to ``num_classes`` - 1.
        num_classes: How many; those without a label get what others say for them.
        places: (L,) of each, see :func:`places_of`: the labels of one place, as of a stroke, tell of a class as one.
        others: (E, F) features of labelled points of other scans.
        other_classes: (E,) of these.
    """

    points: Int[np.ndarray, ' labelled']
    classes: Int[np.ndarray, ' labelled']
    num_classes: int
    places: Int[np.ndarray, ' labelled']
    others: Float[np.ndarray, 'examples features']
    other_classes: Int[np.ndarray, ' examples']

    def select(self, rows: Bool[np.ndarray, ' labelled']) -> 'Labels':
        """Some of the labels, and all others."""
        return self._replace(points=self.points[rows], classes=self.classes[rows], places=self.places[rows])

    @property
    def counts(self) -> Int[np.ndarray, ' classes']:
        """Labels of each class."""
        return np.bincount(self.classes, minlength=self.num_classes)

    @property
    def place_counts(self) -> Int[np.ndarray, ' classes']:
        """Labels of each class, those of one place once."""
        _, first = np.unique(self.places, return_index=True)
        return np.bincount(self.classes[first], minlength=self.num_classes)


def places_of(
    xyz: Float[np.ndarray, 'labelled 3'], classes: Int[np.ndarray, ' labelled'], spacing: float
) -> Int[np.ndarray, ' labelled']:
    """Number of the place of each label: labels of a class within :data:`APART` spacings, one with the next, are one.

    Args:
        xyz: Metres.
        classes: From 0.
        spacing: Metres between points of the scan.

    >>> places_of(np.array([[0.0, 0, 0], [0.1, 0, 0], [0.2, 0, 0], [5, 0, 0]]), np.array([0, 0, 1, 0]), 0.1).tolist()
    [0, 0, 1, 2]
    """
    if not len(xyz):
        return np.zeros(0, dtype=np.int64)
    rows, same = np.unique(np.column_stack([xyz.astype(np.float64), classes]), axis=0, return_inverse=True)
    pairs = cKDTree(rows[:, :3]).query_pairs(APART * spacing, output_type='ndarray')
    pairs = pairs[rows[pairs[:, 0], 3] == rows[pairs[:, 1], 3]]
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(rows), len(rows)))
    found = connected_components(links, directed=False)[1][same.ravel()]
    return np.unique(found, return_inverse=True)[1].astype(np.int64)
