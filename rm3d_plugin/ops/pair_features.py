"""Histograms of point-pair features over neighbourhoods (METHOD 3).

A feature never becomes an angle: each bin edge is a comparison of products, so that the loop over pairs holds one
square root, no branch and no table, and compiles to vector instructions in float32.
"""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: ANN001, ANN202
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

from rm3d_plugin.ops._parallel import map_blocks
from rm3d_plugin.ops.octree import Neighbors, Octree

ANGLE_BINS = 125  # 5 of theta, 5 of alpha, 5 of phi: theta + 5 alpha + 25 phi
DISTANCE_BINS = 5
MIN_POINTS = 3
CHUNK = 1 << 14  # neighbourhoods held in memory at a time
BLOCK = 512  # neighbourhoods that one thread works on at a time
TILE = 16  # pairs computed together; two vectors of eight
COPIES = 4  # histograms filled in turn, so that equal bins in a row do not wait for each other
DUMP = DISTANCE_BINS * ANGLE_BINS  # where pairs without a feature go

ZERO, ONE, TWO, FIVE, TWENTY_FIVE = (np.float32(v) for v in (0, 1, 2, 5, 25))
INNER, OUTER = np.float32(0.2), np.float32(0.6)  # edges between bins 2 | 3 and 3 | 4 of [-1, 1]
INNER_SQ, OUTER_SQ = np.float32(0.04), np.float32(0.36)
COS_36, SIN_36 = np.float32(np.cos(np.pi / 5)), np.float32(np.sin(np.pi / 5))
COS_108, SIN_108 = np.float32(np.cos(3 * np.pi / 5)), np.float32(np.sin(3 * np.pi / 5))
DISTANCE_EDGES_SQ = tuple(np.float32((edge / 5) ** 2) for edge in range(1, 5))


class PairHistograms(NamedTuple):
    """Joint histograms of pair features.

    Attributes:
        values: (M, 125 or 625) float32, each row sums to 1; zero where not valid.
        valid: (M,) bool, False where fewer than three points or no pair could be used.
        pairs: (M,) int64 pairs used.
    """

    values: Float[np.ndarray, 'neighborhoods bins']
    valid: Bool[np.ndarray, ' neighborhoods']
    pairs: Int[np.ndarray, ' neighborhoods']


@njit(cache=True, nogil=True)
def _gather(points, normals, members, local):
    """Coordinates and normals of the members that have a normal, as six columns; how many they are."""
    count = 0
    for member in members:
        nx, ny, nz = normals[member, 0], normals[member, 1], normals[member, 2]
        if nx * nx + ny * ny + nz * nz > np.float32(0.5):
            local[0, count], local[1, count], local[2, count] = points[member, 0], points[member, 1], points[member, 2]
            local[3, count], local[4, count], local[5, count] = nx, ny, nz
            count += 1
    return count


@njit(cache=True, nogil=True)
def _bin_tile(local, i, first, bins):
    """Bins of the pairs of point ``i`` with the points from ``first`` on; the columns are padded to whole tiles."""
    pix, piy, piz, nix, niy, niz = local[0, i], local[1, i], local[2, i], local[3, i], local[4, i], local[5, i]
    px, py, pz = local[0, first : first + TILE], local[1, first : first + TILE], local[2, first : first + TILE]
    nx, ny, nz = local[3, first : first + TILE], local[4, first : first + TILE], local[5, first : first + TILE]
    for lane in range(TILE):
        dx, dy, dz = px[lane] - pix, py[lane] - piy, pz[lane] - piz
        njx, njy, njz = nx[lane], ny[lane], nz[lane]
        length_sq = dx * dx + dy * dy + dz * dz
        along_i = nix * dx + niy * dy + niz * dz
        along_j = njx * dx + njy * dy + njz * dz
        cosine = nix * njx + niy * njy + niz * njz
        first_is_source = abs(along_i) >= abs(along_j)
        ux = nix if first_is_source else njx
        uy = niy if first_is_source else njy
        uz = niz if first_is_source else njz
        along_u = along_i if first_is_source else -along_j
        along_t = along_j if first_is_source else -along_i
        # Seen from j, d and with it d x u turn round; the target's normal takes the sign instead.
        cx, cy, cz = dy * uz - dz * uy, dz * ux - dx * uz, dx * uy - dy * ux
        cross_sq = cx * cx + cy * cy + cz * cz
        cross = np.sqrt(cross_sq)
        tx = njx if first_is_source else -nix
        ty = njy if first_is_source else -niy
        tz = njz if first_is_source else -niz
        alpha = cx * tx + cy * ty + cz * tz
        size = abs(alpha)
        step = (ONE if size >= INNER * cross else ZERO) + (ONE if size >= OUTER * cross else ZERO)
        index = FIVE * (TWO + (step if alpha >= ZERO else -step))
        square = along_u * along_u
        step = (ONE if square >= INNER_SQ * length_sq else ZERO) + (ONE if square >= OUTER_SQ * length_sq else ZERO)
        index += TWENTY_FIVE * (TWO + (step if along_u >= ZERO else -step))
        rise, run = along_t - along_u * cosine, cosine * cross
        size = abs(rise)
        step = (ONE if size * COS_36 >= run * SIN_36 else ZERO) + (ONE if size * COS_108 >= run * SIN_108 else ZERO)
        index += TWO + (step if rise >= ZERO else -step)
        bins[lane] = np.int32(index) if cross_sq > ZERO else np.int32(DUMP)


@njit(cache=True, nogil=True)
def _add_distance(local, i, first, span_sq, bins):
    """Add 125 times the bin of the pairs' distance; ``span_sq``: the squared distance that ends the last bin."""
    for lane in range(TILE):
        square = ZERO
        for axis in range(3):
            square += (local[axis, first + lane] - local[axis, i]) ** 2
        step = 0
        for edge in DISTANCE_EDGES_SQ:
            step += square >= edge * span_sq
        if bins[lane] < DUMP:
            bins[lane] += ANGLE_BINS * step


@njit(cache=True, nogil=True)
def _histogram(local, count, span_sq, histograms, bins):
    """Count the pairs of a neighbourhood into ``histograms``, the sum in row 0; how many pairs have a feature."""
    histograms[:] = 0
    for i in range(count - 1):
        for first in range(i + 1, count, TILE):
            _bin_tile(local, i, first, bins)
            if span_sq < np.inf:
                _add_distance(local, i, first, span_sq, bins)
            for lane in range(min(TILE, count - first)):
                histograms[lane % COPIES, bins[lane]] += 1
    for copy in range(1, COPIES):
        histograms[0] += histograms[copy]
    return count * (count - 1) // 2 - histograms[0, DUMP]


@njit(cache=True, nogil=True)
def _histograms_block(points, normals, offsets, indices, spans, rows, start, stop, values, valid, pairs):
    """Fill ``values``, ``valid`` and ``pairs`` at ``rows[start:stop]`` for neighbourhoods ``start`` to ``stop``."""
    width = 0
    for row in range(start, stop):
        width = max(width, offsets[row + 1] - offsets[row])
    local = np.zeros((6, width + TILE), dtype=np.float32)
    histograms = np.empty((COPIES, DUMP + 1), dtype=np.int64)
    bins = np.empty(TILE, dtype=np.int32)
    for row in range(start, stop):
        count = _gather(points, normals, indices[offsets[row] : offsets[row + 1]], local)
        if count < MIN_POINTS:
            continue
        used = _histogram(local, count, spans[row] * spans[row], histograms, bins)
        at = rows[row]
        pairs[at] = used
        valid[at] = used > 0
        if used > 0:
            for column in range(values.shape[1]):
                values[at, column] = histograms[0, column] / used


def pair_histograms(
    points: Float[np.ndarray, 'points 3'],
    normals: Float[np.ndarray, 'points 3'],
    neighbors: Neighbors,
    spans: Float[np.ndarray, ' neighborhoods'] | None = None,
) -> PairHistograms:
    """Joint histograms of theta, alpha and phi (and distance) over all pairs of each neighbourhood (METHOD 3).

    The source of a pair is the point whose normal makes the smaller angle with the line; with equal angles the one that
    comes first in the neighbourhood. Bin floor(5 (x - min) / (max - min)); index theta + 5 alpha + 25 phi (+ 125
    distance). Computed in float32: a feature within about 1e-6 of an edge may fall to either side.

    Args:
        points: (N, 3) metres. float64 points are moved to their mean before they become float32.
        normals: (N, 3) unit normals; a point with a zero or NaN normal is left out.
        neighbors: The points of each neighbourhood, the centre among them if it is to count.
        spans: (M,) metres, the distance at which the last of five distance bins ends; None leaves distance out.

    Returns:
        One row a neighbourhood.

    Raises:
        ValueError: Points, normals or spans do not fit.
    """
    near = _local(points, normals)
    count = len(neighbors)
    if spans is not None and spans.shape != (count,):
        raise ValueError(f'pair_histograms: spans: expected shape ({count},), got {spans.shape}')
    result = _empty(count, ANGLE_BINS if spans is None else DISTANCE_BINS * ANGLE_BINS)
    _fill(near, neighbors, spans, np.arange(count), result)
    return result


class _Local(NamedTuple):
    """Points and normals as the kernels want them: float32, rows side by side."""

    xyz: np.ndarray
    normals: np.ndarray


def _local(points: np.ndarray, normals: np.ndarray) -> _Local:
    if points.shape != normals.shape or points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f'pair_histograms: points {points.shape} and normals {normals.shape}: expected both (N, 3)')
    moved = points - points.mean(axis=0) if points.dtype == np.float64 and len(points) else points
    return _Local(*(np.ascontiguousarray(array, dtype=np.float32) for array in (moved, normals)))


def _empty(rows: int, bins: int) -> PairHistograms:
    return PairHistograms(
        np.zeros((rows, bins), dtype=np.float32), np.zeros(rows, dtype=np.bool_), np.zeros(rows, dtype=np.int64)
    )


def _fill(
    near: _Local, neighbors: Neighbors, spans: np.ndarray | None, rows: Int[np.ndarray, ' some'], result: PairHistograms
) -> None:
    """Write the histograms of some neighbourhoods into ``rows`` of a result."""
    reach = np.full(len(rows), np.inf, dtype=np.float32) if spans is None else spans.astype(np.float32)

    def work(start: int, stop: int) -> None:
        _histograms_block(*near, neighbors.offsets, neighbors.indices, reach, rows, start, stop, *result)

    map_blocks(work, len(rows), BLOCK)


def histograms_of_points(
    points: Float[np.ndarray, 'points 3'],
    normals: Float[np.ndarray, 'points 3'],
    octree: Octree,
    search: Callable[[Int[np.ndarray, ' some']], tuple[Neighbors, Float[np.ndarray, ' some'] | None]],
    bins: int,
) -> PairHistograms:
    """Histograms around every point, a part of the points at a time so that memory stays bounded.

    Args:
        points: (N, 3) metres.
        normals: (N, 3) unit normals.
        octree: Over the same points; its order decides which points share a part.
        search: Gives the neighbourhoods of some points and their spans, see :func:`pair_histograms`.
        bins: 125, or 625 where ``search`` gives spans.

    Returns:
        One row a point.
    """
    near, result = _local(points, normals), _empty(len(points), bins)
    for start in range(0, len(points), CHUNK):
        rows = octree.order[start : start + CHUNK].astype(np.int64)
        neighbors, spans = search(rows)
        _fill(near, neighbors, spans, rows, result)
    return result
