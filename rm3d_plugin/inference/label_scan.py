"""From few labels of a scan to a label for each of its points, without training."""

import time
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.pseudo_labels.propagation import (
    Beside,
    Estimate,
    PreparedCloud,
    WalkerRules,
    prepare_cloud,
    propagate_prepared,
)
from rm3d_plugin.pseudo_labels.propagation.choose import Choice
from rm3d_plugin.pseudo_labels.propagation.coarsening import coarsen
from rm3d_plugin.pseudo_labels.propagation.rules import DEFAULT
from rm3d_plugin.structures import PointCloud

MOST_POINTS = 2_000_000  # that labels spread over; of larger scans so many are drawn, the others follow the nearest
REGION_POINTS = 50  # of a region, at least on average; larger: fewer regions, more of them of two classes


@dataclass(frozen=True, eq=False)
class LabelledScan:
    """Labels of one scan, and how far to trust them.

    Attributes:
        semantic: (N,) int64 class of each point; labelled points keep theirs.
        confidence: (N,) float32 probability of that class; 1 at labelled points.
        region: (N,) int64 region of each point, from 0, see :func:`regions_of_prepared`.
        clicks: (C,) labelled points of each class.
        choice: Which candidate was taken, and what share of the left-out labels each named correctly.
        estimate: Of the mean IoU on the points without a label; None where none is possible.
        checked: Labels were to be left out.
        seconds: It took.
        method: What was taken.
        network_weight: Power of what a network says beside the walk; 0: it has no say.
    """

    semantic: Int[np.ndarray, ' points']
    confidence: Float[np.ndarray, ' points']
    region: Int[np.ndarray, ' points']
    clicks: Int[np.ndarray, ' classes']
    choice: Choice
    estimate: Estimate | None
    checked: bool
    seconds: float
    method: str
    network_weight: float = 0.0

    @classmethod
    def spread(
        cls,
        semantic: Int[np.ndarray, ' points'],
        confidence: Float[np.ndarray, ' points'],
        region: Int[np.ndarray, ' points'],
        clicks: Int[np.ndarray, ' classes'],
        method: str = DEFAULT,
        seconds: float = 0.0,
    ) -> 'LabelledScan':
        """Labels that nothing was left out for."""
        return cls(semantic, confidence, region, clicks, Choice(DEFAULT, {}), None, False, seconds, method)

    def remark(self) -> str:
        """The estimate, or why there is none, and what was taken."""
        count = int(self.clicks.sum())
        if self.estimate is not None:
            return f'{self.estimate.text()}, from {self.estimate.labels} of your clicks; method: {self.method}'
        if not count:
            return f'no estimate: no click is in this scan, others taught it; method: {self.method}'
        if not self.checked:
            return f'no estimate: clicks were not checked; method: {self.method} (the default)'
        if count == len(self.semantic):
            return 'no estimate: every point was labelled'
        default = '' if self.choice.accuracy or self.network_weight else ' (the default)'
        labels = '1 labelled point is' if count == 1 else f'{count} labelled points are'
        few = f'{labels} in too few places to leave some of each class out'
        return f'no estimate: {few}; method: {self.method}{default}'


def label_scan(
    cloud: PointCloud, annotated: Int[np.ndarray, ' points'], num_classes: int, check: bool = True, seed: int = 0
) -> LabelledScan:
    """Label every point of a scan from the few that are labelled.

    Args:
        cloud: N points, metres, z up.
        annotated: Class of each, -1 = unlabelled.
        num_classes: Number of classes.
        check: Leave labels out in turn: for the estimate, and to take another candidate where that is better.
        seed: Of what is left out together.

    Raises:
        ValueError: ``annotated`` does not fit.
    """
    began = time.perf_counter()
    drawn = drawn_points(len(cloud), np.flatnonzero(annotated >= 0))
    scene = prepare_drawn(cloud, drawn)
    found = label_prepared(scene, annotated[drawn], num_classes, check, seed, Beside())
    return replace(at_all_points(found, cloud, drawn), seconds=time.perf_counter() - began)


def drawn_points(
    count: int, labelled: Int[np.ndarray, ' labelled'], most: int | None = None
) -> Int[np.ndarray, ' drawn']:
    """Points that stand for all: every one, or the labelled ones and others by chance, ascending.

    Args:
        count: Of the points.
        labelled: Points that are kept.
        most: That are drawn, beside the labelled ones; None: :data:`MOST_POINTS`.

    >>> len(drawn_points(100, np.array([7]), most=10)), 7 in drawn_points(100, np.array([7]), most=10)
    (11, True)
    """
    most = MOST_POINTS if most is None else most
    if count <= most:
        return np.arange(count)
    drawn = np.zeros(count, dtype=np.bool_)
    others = np.delete(np.arange(count), labelled)
    drawn[np.random.default_rng(0).choice(others, min(most, len(others)), replace=False)] = True
    drawn[labelled] = True
    return np.flatnonzero(drawn)


def prepare_drawn(cloud: PointCloud, drawn: Int[np.ndarray, ' drawn']) -> PreparedCloud:
    """Graph and features of the points of :func:`drawn_points`."""
    return prepare_cloud(cloud.select(drawn) if len(drawn) < len(cloud) else cloud)


def at_all_points(found: LabelledScan, cloud: PointCloud, drawn: Int[np.ndarray, ' drawn']) -> LabelledScan:
    """What was found at points that were drawn, at all: each takes it from the nearest of these.

    Args:
        found: Of the points drawn.
        cloud: All points.
        drawn: Of :func:`drawn_points`.
    """
    if len(drawn) == len(cloud):
        return found
    nearest = nearest_drawn(cloud, drawn)
    return replace(
        found,
        semantic=found.semantic[nearest],
        confidence=found.confidence[nearest],
        region=found.region[nearest],
    )


def nearest_drawn(cloud: PointCloud, drawn: Int[np.ndarray, ' drawn']) -> Int[np.ndarray, ' points']:
    """Which of the points drawn is the nearest to each point; a drawn one is so to itself."""
    nearest = Octree(cloud.xyz[drawn]).knn(cloud.xyz, 1).indices[:, 0]
    nearest[drawn] = np.arange(len(drawn))
    return np.asarray(nearest, dtype=np.int64)


def label_prepared(
    scene: PreparedCloud,
    annotated: Int[np.ndarray, ' points'],
    num_classes: int,
    check: bool,
    seed: int,
    beside: Beside,
    seconds: float = 0.0,
) -> LabelledScan:
    """:func:`label_scan` on a scan that is prepared, with what is known beside its labels.

    Args:
        scene: The scan.
        annotated: See :func:`label_scan`.
        num_classes: See :func:`label_scan`.
        check: See :func:`label_scan`.
        seed: See :func:`label_scan`.
        beside: Examples of other scans, a network.
        seconds: That the preparation took.

    Raises:
        ValueError: ``annotated`` or ``beside`` does not fit.
    """
    began = time.perf_counter()
    rules = WalkerRules(seed=seed) if check else WalkerRules(seed=seed, folds=0)
    found = propagate_prepared(scene, annotated, num_classes, rules, beside)
    return LabelledScan(
        semantic=found.semantic,
        confidence=found.confidence,
        region=regions_of_prepared(scene),
        clicks=np.bincount(annotated[annotated >= 0], minlength=num_classes),
        choice=found.choice,
        estimate=found.estimate,
        checked=check,
        seconds=seconds + time.perf_counter() - began,
        method='walker, features and network' if found.network_weight else found.choice.candidate,
        network_weight=found.network_weight,
    )


def regions_of(cloud: PointCloud) -> Int[np.ndarray, ' points']:
    """:func:`regions_of_prepared` of any scan."""
    drawn = drawn_points(len(cloud), np.zeros(0, dtype=np.int64))
    region = regions_of_prepared(prepare_drawn(cloud, drawn))
    return region if len(drawn) == len(cloud) else region[nearest_drawn(cloud, drawn)]


def regions_of_prepared(scene: PreparedCloud) -> Int[np.ndarray, ' points']:
    """An over-segmentation: points that the strongest edges of the walker's graph join, numbered by their first point.

    Args:
        scene: N points; about N / 50 regions come out.
    """
    nobody = np.zeros(0, dtype=np.int64)
    return coarsen(scene.graphs[0], nobody, max(len(scene.cloud) // REGION_POINTS, 1)).node.astype(np.int64)
