"""Fast point feature histograms: what each point sees of its neighbours, then a weighted mean over them (METHOD 3).

Both passes work along the Morton curve, so that the points and histograms a neighbourhood touches lie together.
"""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: ANN001, ANN202
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

from rm3d_plugin.ops._parallel import map_blocks
from rm3d_plugin.ops.octree import Neighbors, Octree

FEATURE_BINS = 11  # of each of theta, alpha and phi
BINS = 3 * FEATURE_BINS
TOTAL = 100.0  # what the bins of one feature sum to
CHUNK = 1 << 16  # neighbourhoods held in memory at a time
KEEP = 1 << 25  # neighbours kept between the two passes; beyond it the second pass searches again
BLOCK = 2048  # points that one thread works on at a time

Search = Callable[[Int[np.ndarray, ' some']], Neighbors]


class FastHistograms(NamedTuple):
    """One histogram a point.

    Attributes:
        values: (N, 33) float32, 11 bins of theta, 11 of alpha, 11 of phi; zero where not valid.
        valid: (N,) bool, False where no neighbour has a histogram to add.
    """

    values: Float[np.ndarray, 'points 33']
    valid: Bool[np.ndarray, ' points']


@njit(cache=True, nogil=True)
def _bin(value, low, high):
    """Number of the bin out of eleven."""
    return min(max(int(np.floor(FEATURE_BINS * (value - low) / (high - low))), 0), FEATURE_BINS - 1)


@njit(cache=True, nogil=True)
def _count_pair(xyz, normals, i, j, counts):
    """Count the pair feature of two points into three histograms; False for a pair without a frame."""
    dx, dy, dz = xyz[j, 0] - xyz[i, 0], xyz[j, 1] - xyz[i, 1], xyz[j, 2] - xyz[i, 2]
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    if length == 0.0:
        return False
    along_i = (normals[i, 0] * dx + normals[i, 1] * dy + normals[i, 2] * dz) / length
    along_j = (normals[j, 0] * dx + normals[j, 1] * dy + normals[j, 2] * dz) / length
    source, target, phi = i, j, along_i
    if abs(along_i) < abs(along_j):
        source, target, phi = j, i, -along_j
        dx, dy, dz = -dx, -dy, -dz
    ux, uy, uz = normals[source, 0], normals[source, 1], normals[source, 2]
    tx, ty, tz = normals[target, 0], normals[target, 1], normals[target, 2]
    vx, vy, vz = dy * uz - dz * uy, dz * ux - dx * uz, dx * uy - dy * ux
    size = np.sqrt(vx * vx + vy * vy + vz * vz)
    if size == 0.0:
        return False
    vx, vy, vz = vx / size, vy / size, vz / size
    wx, wy, wz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    theta = np.arctan2(wx * tx + wy * ty + wz * tz, ux * tx + uy * ty + uz * tz)
    counts[_bin(theta, -np.pi, np.pi)] += np.float32(1)
    counts[FEATURE_BINS + _bin(vx * tx + vy * ty + vz * tz, -1.0, 1.0)] += np.float32(1)
    counts[2 * FEATURE_BINS + _bin(phi, -1.0, 1.0)] += np.float32(1)
    return True


@njit(cache=True, nogil=True)
def _count_zeros(counts):
    """Count a pair whose three features are 0."""
    for start in range(0, BINS, FEATURE_BINS):
        counts[start + FEATURE_BINS // 2] += np.float32(1)


@njit(cache=True, nogil=True)
def _count_block(xyz, normals, usable, rank, offsets, indices, first, start, stop, own, counts, shares):
    """Histograms of the pairs (centre, neighbour) for chunk rows ``start`` to ``stop``; what one pair adds.

    With ``own``, Open3D's reading, a pair without a frame has features of 0; without it, PCL's, it counts nowhere.
    """
    for row in range(start, stop):
        centre = first + row
        if not usable[centre]:
            continue
        members = 0
        for at in range(offsets[row], offsets[row + 1]):
            other = rank[indices[at]]
            if usable[other]:
                members += 1
                if other != centre and not _count_pair(xyz, normals, centre, other, counts[centre]) and own:
                    _count_zeros(counts[centre])
        if members > 1:
            shares[centre] = TOTAL / (members - 1)


@njit(cache=True, nogil=True)
def _weigh_block(counts, shares, rank, order, offsets, indices, sq_dists, first, start, stop, own, values, valid):
    """Sum of the neighbours' histograms over squared distance, each feature scaled to 100, plus the own one."""
    total = np.empty(BINS)
    for row in range(start, stop):
        centre = first + row
        if shares[centre] == 0.0:
            continue
        total[:] = 0.0
        for at in range(offsets[row], offsets[row + 1]):
            if sq_dists[at] > 0.0:
                other = rank[indices[at]]
                weight = shares[other] / sq_dists[at]
                for column in range(BINS):
                    total[column] += weight * counts[other, column]
        filled = 0
        for part in range(0, BINS, FEATURE_BINS):
            mass = total[part : part + FEATURE_BINS].sum()
            filled += mass > 0.0
            for column in range(part, part + FEATURE_BINS):
                mean = TOTAL * total[column] / mass if mass > 0.0 else 0.0
                total[column] = mean + (shares[centre] * counts[centre, column] if own else 0.0)
        if filled:
            valid[order[centre]] = True
            for column in range(BINS):
                values[order[centre], column] = total[column]


def fast_histograms(
    points: Float[np.ndarray, 'points 3'],
    normals: Float[np.ndarray, 'points 3'],
    octree: Octree,
    search: Search,
    own_spfh: bool = False,
) -> FastHistograms:
    """FPFH of every point.

    The simplified histogram (SPFH) of a point counts theta, alpha and phi of the pairs (point, neighbour), each pair
    adding 100 / (members - 1). The result is the sum of the neighbours' SPFH over their squared distance (square
    metres), each feature's 11 bins scaled to sum to 100. Pairs of equal points, or along the source's normal, count
    nowhere, yet remain among the members; with ``own_spfh`` their features are 0, as in Open3D. Computed in float64.

    Args:
        points: (N, 3) metres.
        normals: (N, 3) unit normals; a point with a zero or NaN normal is left out.
        octree: Over the same points.
        search: Gives the neighbourhoods of some points, the centres among them.
        own_spfh: Add the point's own SPFH after scaling.

    Returns:
        One row a point.

    Raises:
        ValueError: Points, normals or octree do not fit.
    """
    if points.shape != normals.shape or points.ndim != 2 or points.shape[1] != 3 or len(octree) != len(points):
        raise ValueError(
            f'fast_histograms: points {points.shape}, normals {normals.shape}, octree of {len(octree)}: expected (N, 3)'
        )
    n, order = len(points), octree.order
    rank = np.empty(n, dtype=np.int32)
    rank[order] = np.arange(n, dtype=np.int32)
    xyz, directions = (np.ascontiguousarray(array[order], dtype=np.float64) for array in (points, normals))
    usable = np.asarray((directions * directions).sum(axis=1) > 0.5)
    counts, shares = np.zeros((n, BINS), dtype=np.float32), np.zeros(n)
    result = FastHistograms(np.zeros((n, BINS), dtype=np.float32), np.zeros(n, dtype=np.bool_))
    kept: dict[int, Neighbors] = {}
    for first, found in _chunks(order, search, kept):

        def count(start: int, stop: int, first: int = first, found: Neighbors = found) -> None:
            near = (rank, found.offsets, found.indices)
            _count_block(xyz, directions, usable, *near, first, start, stop, own_spfh, counts, shares)

        map_blocks(count, len(found), BLOCK)
    for first, found in _chunks(order, search, kept):

        def weigh(start: int, stop: int, first: int = first, found: Neighbors = found) -> None:
            near = (rank, order, found.offsets, found.indices, found.sq_dists)
            _weigh_block(counts, shares, *near, first, start, stop, own_spfh, *result)

        map_blocks(weigh, len(found), BLOCK)
    return result


def _chunks(
    order: Int[np.ndarray, ' points'], search: Search, kept: dict[int, Neighbors]
) -> Iterator[tuple[int, Neighbors]]:
    """Neighbourhoods a chunk at a time, along ``order``; the first ones stay in ``kept`` for the next pass."""
    for first in range(0, len(order), CHUNK):
        found = kept[first] if first in kept else search(order[first : first + CHUNK])
        if first not in kept and sum(len(chunk.indices) for chunk in kept.values()) + len(found.indices) <= KEEP:
            kept[first] = found
        yield first, found
