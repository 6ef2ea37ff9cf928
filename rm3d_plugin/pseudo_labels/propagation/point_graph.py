"""The graph over which labels spread: neighbours are joined by how alike they are."""

from typing import NamedTuple

import numpy as np
import scipy.sparse
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.propagation.neighborhoods import Neighborhoods

JOINED = 12  # neighbours of a point: enough that noise does not tear a surface apart
USUAL = 0.75  # share of the neighbour pairs whose difference is the scale of a cue: nearly all pairs lie in one object
LOCAL_RANK = 6  # distances count in those to this neighbour, since density falls with range
SMOOTHED = 9  # points over which colours are averaged: those of single points are noise
FLOOR = 1e-4  # weight of a pair however different: what no edge ends is reached in the end
LEAST_ANGLE = 1.0  # degrees that normals of sixteen points never tell apart
LEAST_CHANNEL = 1e-2  # of the deviation of a channel


class PointGraph(NamedTuple):
    """Symmetric weights between neighbours.

    Attributes:
        weights: (N, N) CSR, positive, no diagonal.
        degree: (N,) sums of its rows.
    """

    weights: scipy.sparse.csr_array
    degree: Float[np.ndarray, ' points']


def point_graph(near: Neighborhoods, channels: list[Float[np.ndarray, 'points columns']]) -> PointGraph:
    """Join each point with its nearest by exp(-sum of squared differences, each in the scale of its cue) + FLOOR.

    Cues are the angle between normals, the distance and the difference of each channel (the paper's A_n and M_color,
    between points). The scale of a cue is what three of four pairs of this very scan stay
    below, so that no length, angle or colour is assumed. A pair that either end names gets the larger weight.

    Args:
        near: Neighbours and normals.
        channels: Of :func:`~rm3d_plugin.pseudo_labels.propagation.channels.channel_groups`.
    """
    count = len(near.nearest)
    start, end, rank = _pairs(near.nearest[:, : JOINED + 1])
    cost = np.zeros(len(start))
    for difference, least in _cues(near, channels, start, end, rank):
        cost += np.square(difference / max(_usual(difference), least))
    directed = scipy.sparse.coo_array((np.exp(-cost) + FLOOR, (start, end)), shape=(count, count)).tocsr()
    weights = directed.maximum(directed.T).tocsr()
    weights.sort_indices()
    return PointGraph(weights, np.asarray(weights.sum(axis=1), dtype=np.float64).ravel())


def _pairs(
    index: Int[np.ndarray, 'points k'],
) -> tuple[Int[np.ndarray, ' pairs'], Int[np.ndarray, ' pairs'], Int[np.ndarray, ' pairs']]:
    """Both ends of each pair, and the column it stands in; no point with itself, wherever duplicates put it."""
    start = np.repeat(np.arange(len(index)), index.shape[1])
    end = index.ravel().astype(np.int64)
    rank = np.tile(np.arange(index.shape[1]), len(index))
    kept = (end >= 0) & (end != start)
    return start[kept], end[kept], rank[kept]


def _usual(difference: Float[np.ndarray, ' pairs']) -> float:
    return float(np.quantile(difference, USUAL)) if len(difference) else 0.0


def _cues(
    near: Neighborhoods,
    channels: list[Float[np.ndarray, 'points columns']],
    start: Int[np.ndarray, ' pairs'],
    end: Int[np.ndarray, ' pairs'],
    rank: Int[np.ndarray, ' pairs'],
) -> list[tuple[Float[np.ndarray, ' pairs'], float]]:
    """Differences of the pairs by cue, and the least scale of each."""
    cosine = np.abs(np.einsum('ij,ij->i', near.normal[start], near.normal[end]))
    local = np.where(np.isfinite(near.distance), near.distance, 0.0)[:, : LOCAL_RANK + 1].max(axis=1, initial=0.0)
    floor = max(0.1 * near.spacing, 1e-9)  # where points coincide their distances are rounding
    cues = [
        (np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0))), LEAST_ANGLE),
        (near.distance[start, rank] / np.maximum(local[start], floor), 1e-3),
    ]
    for channel in channels:
        smooth = smoothed(channel, near.nearest)
        deviation = float(np.linalg.norm(channel.std(axis=0)))
        cues.append((np.linalg.norm(smooth[start] - smooth[end], axis=1), LEAST_CHANNEL * deviation))
    return cues


def smoothed(
    values: Float[np.ndarray, 'points columns'], index: Int[np.ndarray, 'points k']
) -> Float[np.ndarray, 'points columns']:
    """Means over the :data:`SMOOTHED` nearest points."""
    near = index[:, :SMOOTHED]
    there = near >= 0
    total = np.zeros(values.shape)
    for column in range(near.shape[1]):
        total += np.where(there[:, column, None], values[near[:, column]], 0.0)
    return np.asarray(total / np.maximum(there.sum(axis=1), 1)[:, None])
