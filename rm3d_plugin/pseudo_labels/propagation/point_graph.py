"""The graph over which labels spread: neighbours are joined by how alike they are."""

from typing import NamedTuple

import numpy as np
import scipy.sparse
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.propagation.neighborhoods import Neighborhoods
from rm3d_plugin.structures import PointCloud

JOINED = 12  # neighbours of a point: enough that noise does not tear a surface apart
USUAL = 0.75  # share of the neighbour pairs whose difference is the scale of a cue: nearly all pairs lie in one object
LOCAL_RANK = 6  # distances count in those to this neighbour, since density falls with range
SMOOTHED = 9  # points over which colours are averaged: those of single points are noise
FLOOR = 1e-4  # weight of a pair however different: what no edge ends is reached in the end
LEAST_ANGLE = 1.0  # degrees that normals of sixteen points never tell apart
LEAST_RATIO = 1e-3  # of the local spacing
LEAST_CHANNEL = 1e-2  # of the deviation of a channel
COLOUR_COLUMNS = 3  # of a channel that is a colour
ANGLE, COLOURED_ANGLE = 20.0, 7.0  # degrees; scales of the fixed graph, without and with colours
COLOUR = 10.0  # CIE Lab
STRENGTH = 0.1  # of an intensity in [0, 1]
CURVATURE = 0.03


class PointGraph(NamedTuple):
    """Symmetric weights between neighbours.

    Attributes:
        weights: (N, N) CSR, positive, no diagonal.
        degree: (N,) sums of its rows.
    """

    weights: scipy.sparse.csr_array
    degree: Float[np.ndarray, ' points']


def measured_graph(
    xyz: Float[np.ndarray, 'points 3'], near: Neighborhoods, channels: list[Float[np.ndarray, 'points columns']]
) -> PointGraph:
    """Join each point with its nearest by exp(-sum of squared differences, each in the scale of its cue) + FLOOR.

    Cues are the angle between normals, the distance, how far the one lies off the tangent plane of the other, and the
    difference of each channel (the paper's A_n and M_color, between points). The scale of a cue is what three of four
    pairs of this very scan stay below, so that no length, angle or colour is assumed.

    Args:
        xyz: Metres.
        near: Neighbours and normals.
        channels: Of :func:`~rm3d_plugin.pseudo_labels.propagation.channels.channel_groups`.
    """
    pairs = _pairs(near.nearest[:, : JOINED + 1])
    local = _local(near)[pairs.start]
    off = np.einsum('ij,ij->i', xyz[pairs.end].astype(np.float64) - xyz[pairs.start], near.normal[pairs.start])
    cues = [
        (_angle(near, pairs), LEAST_ANGLE),
        (near.distance[pairs.start, pairs.rank] / local, LEAST_RATIO),
        (np.abs(off) / local, LEAST_RATIO),
    ]
    for channel in channels:
        least = LEAST_CHANNEL * float(np.linalg.norm(channel.std(axis=0)))
        cues.append((_step(smoothed(channel, near.nearest), pairs), least))
    cost = np.zeros(len(pairs.start))
    for difference, least in cues:
        cost += np.square(difference / max(_usual(difference), least))
    return _joined(pairs, cost, len(near.nearest))


def fixed_graph(
    cloud: PointCloud, near: Neighborhoods, channels: list[Float[np.ndarray, 'points columns']]
) -> PointGraph:
    """The same with scales that are the same for all scans, and curvature where there are no colours.

    It errs elsewhere than :func:`measured_graph`, which is why the mean of both is better than either.

    Args:
        cloud: The scan.
        near: Neighbours and normals.
        channels: Of :func:`~rm3d_plugin.pseudo_labels.propagation.channels.channel_groups`.
    """
    pairs = _pairs(near.nearest[:, : JOINED + 1])
    coloured = [channel for channel in channels if channel.shape[1] == COLOUR_COLUMNS]
    cost = np.square(_angle(near, pairs) / (COLOURED_ANGLE if coloured else ANGLE))
    cost += np.square(near.distance[pairs.start, pairs.rank] / (2.0 * _local(near)[pairs.start]))
    for channel in channels:
        colour = channel.shape[1] == COLOUR_COLUMNS
        values, scale = (smoothed(channel, near.nearest), COLOUR) if colour else (channel, STRENGTH)
        cost += np.square(_step(values, pairs) / scale)
    if not coloured:
        cost += np.square((near.shape[pairs.start, 5] - near.shape[pairs.end, 5]) / CURVATURE)
    return _joined(pairs, cost, len(cloud))


class _Pairs(NamedTuple):
    """Both ends of each pair of neighbours, and the column of the neighbourhood it stands in."""

    start: Int[np.ndarray, ' pairs']
    end: Int[np.ndarray, ' pairs']
    rank: Int[np.ndarray, ' pairs']


def _joined(pairs: _Pairs, cost: Float[np.ndarray, ' pairs'], count: int) -> PointGraph:
    """A pair that either end names gets the larger weight."""
    directed = scipy.sparse.coo_array((np.exp(-cost) + FLOOR, (pairs.start, pairs.end)), shape=(count, count)).tocsr()
    weights = directed.maximum(directed.T).tocsr()
    weights.sort_indices()
    return PointGraph(weights, np.asarray(weights.sum(axis=1), dtype=np.float64).ravel())


def _pairs(index: Int[np.ndarray, 'points k']) -> _Pairs:
    """No point with itself, wherever duplicates put it."""
    start = np.repeat(np.arange(len(index)), index.shape[1])
    end = index.ravel().astype(np.int64)
    rank = np.tile(np.arange(index.shape[1]), len(index))
    kept = (end >= 0) & (end != start)
    return _Pairs(start[kept], end[kept], rank[kept])


def _usual(difference: Float[np.ndarray, ' pairs']) -> float:
    return float(np.quantile(difference, USUAL)) if len(difference) else 0.0


def _angle(near: Neighborhoods, pairs: _Pairs) -> Float[np.ndarray, ' pairs']:
    """Degrees between normals of either sign."""
    cosine = np.abs(np.einsum('ij,ij->i', near.normal[pairs.start], near.normal[pairs.end]))
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0))))


def _local(near: Neighborhoods) -> Float[np.ndarray, ' points']:
    """Spacing at each point, metres; where points coincide their distances are rounding."""
    reached = np.where(np.isfinite(near.distance), near.distance, 0.0)[:, : LOCAL_RANK + 1].max(axis=1, initial=0.0)
    return np.maximum(reached, max(0.1 * near.spacing, 1e-9))


def _step(channel: Float[np.ndarray, 'points columns'], pairs: _Pairs) -> Float[np.ndarray, ' pairs']:
    return np.asarray(np.linalg.norm(channel[pairs.start] - channel[pairs.end], axis=1))


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
