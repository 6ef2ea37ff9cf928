"""Instances that chunks found for themselves, as instances of the scene."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from rm3d_plugin.ops.clustering import PointMasks, masks_of


class ChunkInstances(NamedTuple):
    """What was found in one chunk.

    Attributes:
        rows: (n,) int64 points of the scene that the chunk has, ascending.
        masks: (K, n) points of each instance, among the chunk's.
        labels: (K,) int64 classes.
        scores: (K,) float32.
    """

    rows: Int[np.ndarray, ' points']
    masks: Bool[np.ndarray, 'instances points']
    labels: Int[np.ndarray, ' instances']
    scores: Float[np.ndarray, ' instances']


class SceneInstances(NamedTuple):
    """Instances of a scene.

    Attributes:
        masks: Their points.
        labels: (K,) int64 classes.
        scores: (K,) float32, the mean of the parts' scores by their points.
    """

    masks: PointMasks
    labels: Int[np.ndarray, ' instances']
    scores: Float[np.ndarray, ' instances']


def stitch_instances(chunks: Sequence[ChunkInstances], num_points: int, min_iou: float) -> SceneInstances:
    """Join instances of one class that overlap where their chunks do.

    Two instances of different chunks are one where they share points, and these are at least ``min_iou`` of the points
    that either has among the points of both chunks. What is joined in a row is one instance (connected components).

    Args:
        chunks: What was found in each.
        num_points: Points of the scene.
        min_iou: Larger: fewer joints.

    Returns:
        Instances in the order of their first parts.
    """
    labels = np.concatenate([np.zeros(0, dtype=np.int64), *(chunk.labels for chunk in chunks)])
    scores = np.concatenate([np.zeros(0, dtype=np.float32), *(chunk.scores for chunk in chunks)])
    owner = np.repeat(np.arange(len(chunks)), [len(chunk.labels) for chunk in chunks])
    parts = [chunk.rows[mask] for chunk in chunks for mask in chunk.masks]
    found = _member(parts, num_points)
    first, second, shared = _overlaps(found, labels, owner)
    seen = (found @ _member([chunk.rows for chunk in chunks], num_points).T).toarray()  # points within each chunk
    either = seen[first, owner[second]] + seen[second, owner[first]] - shared
    joined = shared >= min_iou * either
    links = csr_matrix((np.ones(joined.sum()), (first[joined], second[joined])), shape=(len(parts), len(parts)))
    count, group = connected_components(links, directed=False)
    order = np.unique(group, return_index=True)[1]  # each component's first part
    order = np.argsort(order, kind='stable')
    return _joined(parts, labels, scores, [np.flatnonzero(group == number) for number in order[:count]])


def _member(parts: Sequence[np.ndarray], num_points: int) -> csr_matrix:
    masks = masks_of(list(parts))
    ones = np.ones(len(masks.indices), dtype=np.int64)
    return csr_matrix((ones, masks.indices, masks.offsets), shape=(len(parts), num_points))


def _overlaps(
    found: csr_matrix, labels: Int[np.ndarray, ' parts'], owner: Int[np.ndarray, ' parts']
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of one class from different chunks that share points, the earlier first, and how many they share."""
    both = (found @ found.T).tocoo()
    pair = (both.row < both.col) & (owner[both.row] != owner[both.col]) & (labels[both.row] == labels[both.col])
    return both.row[pair], both.col[pair], both.data[pair]


def _joined(
    parts: list[np.ndarray], labels: np.ndarray, scores: np.ndarray, groups: list[np.ndarray]
) -> SceneInstances:
    sizes = np.array([len(part) for part in parts], dtype=np.float64)
    points = [np.unique(np.concatenate([parts[i] for i in group])) for group in groups]
    means = [np.average(scores[group].astype(np.float64), weights=np.maximum(sizes[group], 1)) for group in groups]
    classes = labels[[int(group[0]) for group in groups]] if groups else labels[:0]
    return SceneInstances(masks_of(points), classes.astype(np.int64), np.array(means, dtype=np.float32))
