"""Clusters of points above the ground: objects that need no network to be told apart, and what they look like.

On streets objects stand apart. What is not ground falls into clusters, most hidden objects are one of them, and how a
cluster is shaped, and what a learned descriptor says of its points, tells much of what it is, whatever a network has
learnt of this run's few boxes.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.ops.clustering import ball_clusters
from rm3d_plugin.ops.segment import segment_mean, segment_sizes
from rm3d_plugin.pseudo_labels.common.density_ratio import DensityRatio, fit_density_ratio
from rm3d_plugin.pseudo_labels.common.kernel_classifier import scaling_of
from rm3d_plugin.pseudo_labels.detection.instances import PredictedInstances
from rm3d_plugin.structures import Boxes3D, Descriptors, PointCloud

LINK = 0.5  # of the narrowest class's width: points nearer than this to one another are of one cluster
TALLEST = 1.5  # of the highest class's height: points higher than this above the ground are of no cluster
SLABS = 5  # of equal height, up to the highest class's
LEAST = 5  # points of a cluster
USUAL_RANGE = 10.0  # m


class ObjectClusters(NamedTuple):
    """Clusters of a scene.

    Attributes:
        point: (N,) int64 cluster of each point, -1 = none.
        likeness: (K, C) how like annotated objects of each class a cluster is, against clusters at large; 1: as much as
            these are like each other. NaN: nobody knows what objects of the class look like.
        annotated: (B,) the same of each annotated box for its own class, from the others; 0 for one without points, or
            where nobody knows.
    """

    point: Int[np.ndarray, ' points']
    likeness: Float[np.ndarray, 'clusters classes']
    annotated: Float[np.ndarray, ' boxes']

    def points_of(self, chosen: Bool[np.ndarray, ' clusters']) -> Bool[np.ndarray, ' points']:
        """The points of some of the clusters."""
        return np.asarray(np.append(chosen, False)[self.point], dtype=bool)


def object_clusters(
    xyz: Float[np.ndarray, 'points 3'],
    height: Float[np.ndarray, ' points'],
    ground: Bool[np.ndarray, ' points'],
    sizes: Float[np.ndarray, 'classes 3'],
) -> Int[np.ndarray, ' points']:
    """Cluster of each point, -1 = none: ground, points far too high for any object, and a few strays.

    Args:
        xyz: Points, metres.
        height: Above the ground, metres.
        ground: Points of the ground.
        sizes: Usual sizes of classes, metres; NaN rows are ignored, and without any other there is no cluster.
    """
    known = sizes[np.isfinite(sizes).all(axis=1)]
    if not len(known):
        return np.full(len(xyz), -1, dtype=np.int64)
    taking_part = ~ground & (height < TALLEST * known[:, 2].max())
    return ball_clusters(xyz, LINK * float(known[:, :2].min()), np.where(taking_part, 0, -1), LEAST)


def shapes(
    cloud: PointCloud, height: Float[np.ndarray, ' points'], owner: Int[np.ndarray, ' points'], count: int, tall: float
) -> Float[np.ndarray, 'clusters features']:
    """What clusters look like, whichever way they are turned.

    Highest and lowest height above the ground; extents and deviations along the two principal axes from above; how many
    points it would have at 10 m, logarithm; in slabs of equal height the share of the points and both extents;
    mean, deviation and ninth decile of intensity and of each channel of colour, where there are any. A cluster without
    points has zeros. Where nobody knows the sensor, its own number of points counts.

    Args:
        cloud: The scene.
        height: Above the ground, metres.
        owner: Cluster of each point, -1 = none.
        count: Clusters.
        tall: Height up to which slabs reach, metres.
    """
    order = np.argsort(owner, kind='stable')
    starts = np.searchsorted(owner[order], np.arange(count + 1))
    xyz = cloud.xyz.astype(np.float64)
    reach = np.full(len(xyz), USUAL_RANGE) if cloud.sensor is None else np.hypot(*(xyz - cloud.sensor)[:, :2].T)
    channels = [part for part in (cloud.intensity, cloud.colors) if part is not None]
    beside = np.column_stack([np.zeros((len(cloud), 0)), *channels]).astype(np.float64)
    empty = np.zeros(7 + 3 * SLABS + 3 * beside.shape[1])
    rows = [
        _shape(xyz[own], height[own], beside[own], float(reach[own].mean()), tall) if len(own) else empty
        for own in (order[a:b] for a, b in zip(starts[:-1], starts[1:], strict=True))
    ]
    return np.array(rows).reshape(count, len(empty))


def _shape(xyz: np.ndarray, height: np.ndarray, beside: np.ndarray, reach: float, tall: float) -> np.ndarray:
    flat = xyz[:, :2] - xyz[:, :2].mean(axis=0)
    _, axes = np.linalg.eigh(flat.T @ flat)
    flat = flat @ axes[:, ::-1]  # longest first
    values = [height.max(), height.min(), *np.ptp(flat, axis=0), *flat.std(axis=0)]
    values.append(np.log1p(len(xyz) * (reach / USUAL_RANGE) ** 2))
    slab = np.floor(height * (SLABS / tall))
    for number in range(SLABS):
        own = flat[slab == number]
        values += [len(own) / len(xyz), *(np.ptp(own, axis=0) if len(own) else np.zeros(2))]
    parts = beside.mean(axis=0), beside.std(axis=0), np.quantile(beside, 0.9, axis=0)
    return np.concatenate([values, *parts])


def described(
    descriptors: Descriptors, owner: Int[np.ndarray, ' points'], count: int
) -> Float[np.ndarray, 'clusters features']:
    """Mean descriptor of the points of each cluster; NaN for one without a described point.

    Args:
        descriptors: Of all points.
        owner: Cluster of each point, -1 = none.
        count: Clusters.
    """
    inside = np.flatnonzero((owner >= 0) & descriptors.valid)
    means = segment_mean(descriptors.select(inside).values, owner[inside], count)
    means[segment_sizes(owner[inside], count) == 0] = np.nan
    return means


def known_mean(parts: Sequence[Float[np.ndarray, '*shape']]) -> Float[np.ndarray, '*shape']:
    """Of several likenesses of the same things, element by element; those that say nothing (NaN) are left out.

    >>> known_mean([np.array([4.0, 4.0, np.nan]), np.array([1.0, np.nan, np.nan])])
    array([2.5, 4. , nan])
    """
    return np.asarray(np.ma.masked_invalid(np.stack(parts)).mean(axis=0).filled(np.nan))


def named_clusters(clusters: ObjectClusters, probabilities: Float[np.ndarray, 'points classes']) -> PredictedInstances:
    """Each cluster as an instance of the class that is likeliest by the network and by its shape together.

    A cluster of which both say nothing is no instance.

    Args:
        clusters: Of a scene.
        probabilities: Softmax of the points, background last; NaN where the network saw none, which counts as 0.
    """
    count, classes = clusters.likeness.shape
    said = segment_mean(np.nan_to_num(probabilities[:, :classes]), clusters.point, count)
    scores = said * np.minimum(np.nan_to_num(clusters.likeness), 1.0)
    scores = np.column_stack([np.zeros(count), scores])  # a first column, so that no class is among the answers
    named = scores.argmax(axis=1)
    row = np.append(np.where(named > 0, np.cumsum(named > 0) - 1, -1), -1)
    return PredictedInstances(row[clusters.point], named[named > 0] - 1, scores.max(axis=1)[named > 0])


def unlike_clusters(clusters: ObjectClusters, least: float) -> Bool[np.ndarray, ' clusters']:
    """Clusters that are like no class's annotated objects, see :attr:`TeacherRules.least_likeness`.

    Where nobody knows what objects of some class look like there are none.
    """
    return np.asarray((clusters.likeness < least).all(axis=1), dtype=bool)


def like_clusters(clusters: ObjectClusters, least: float) -> Bool[np.ndarray, ' clusters']:
    """Clusters that are so like the annotated objects of some class, see :attr:`TeacherRules.usual_likeness`."""
    return np.asarray((clusters.likeness >= least).any(axis=1), dtype=bool)


def looks_like_its_class(
    clusters: ObjectClusters, xyz: Float[np.ndarray, 'points 3'], boxes: Boxes3D, least: float
) -> Bool[np.ndarray, ' boxes']:
    """Whether the cluster with the most points in each box is so like the annotated objects of the box's class.

    A box without points of any cluster is not. Of a class of which nobody knows what its objects look like each box is.
    """
    without = np.where(np.isnan(clusters.likeness).any(axis=0), np.nan, 0.0)
    likeness = np.concatenate([clusters.likeness, without[None]])
    return np.asarray(~(likeness[cluster_of_boxes(clusters, xyz, boxes), boxes.labels] < least), dtype=bool)


def cluster_of_boxes(
    clusters: ObjectClusters, xyz: Float[np.ndarray, 'points 3'], boxes: Boxes3D
) -> Int[np.ndarray, ' boxes']:
    """The cluster with the most points in each box; -1: it has a point of none."""
    inside = clusters.point >= 0
    xyz, point = xyz[inside], clusters.point[inside]
    out = np.full(len(boxes), -1, dtype=np.int64)
    for row in range(len(boxes)):
        own = point[points_in_boxes(xyz, boxes.tensor[row : row + 1]) >= 0]
        if len(own):
            out[row] = np.bincount(own).argmax()
    return out


class Likeness(NamedTuple):
    """How like the annotated objects of each class something is.

    Attributes:
        ratios: Of each class; None: it has not two annotated objects, so nobody knows what is usual.
        usual: (C,) what the ratio is at annotated objects that are left out, the median.
    """

    ratios: tuple[DensityRatio | None, ...]
    usual: Float[np.ndarray, ' classes']

    @property
    def known(self) -> Bool[np.ndarray, ' classes']:
        """Of which classes it is known."""
        return np.array([ratio is not None for ratio in self.ratios], dtype=bool)

    def of(self, rows: Float[np.ndarray, 'clusters features']) -> Float[np.ndarray, 'clusters classes']:
        """Likeness of rows to each class; NaN for a class without a ratio, and for a row of NaN."""
        out = np.full((len(rows), len(self.ratios)), np.nan)
        for c, ratio in enumerate(self.ratios):
            if ratio is not None and len(rows):
                out[:, c] = ratio.of(rows) / self.usual[c]
        return out


LEAST_USUAL = 0.1  # of what the ratio is at annotated objects that are not left out: some classes are unlike themselves


def fit_likeness(
    annotated: Float[np.ndarray, 'objects features'],
    labels: Int[np.ndarray, ' objects'],
    clusters: Float[np.ndarray, 'clusters features'],
    classes: int,
) -> tuple[Likeness, Float[np.ndarray, ' objects']]:
    """Learn from annotated objects and clusters of which nothing is known; also the likeness of objects left out.

    Args:
        annotated: What the annotated objects look like: rows of :func:`shapes` or :func:`described`.
        labels: Classes of the annotated objects.
        clusters: The same of clusters; without any nothing is learnt.
        classes: C.
    """
    usual, left_out = np.ones(classes), np.zeros(len(labels))
    ratios: list[DensityRatio | None] = [None] * classes
    if not len(clusters):
        return Likeness(tuple(ratios), usual), left_out
    scaling = scaling_of(clusters)
    for c in range(classes):
        own = labels == c
        if own.sum() < 2:
            continue
        ratio, without = fit_density_ratio(annotated[own], clusters, scaling)
        usual[c] = max(float(np.median(without)), LEAST_USUAL * float(np.median(ratio.of(annotated[own]))), 1e-12)
        ratios[c], left_out[own] = ratio, without / usual[c]
    return Likeness(tuple(ratios), usual), left_out
