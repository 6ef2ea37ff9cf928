"""Signatures of histograms of orientations (METHOD 3; Tombari, Salti, Di Stefano, ECCV 2010)."""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: ANN001, ANN202
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

from rm3d_plugin.ops._parallel import map_blocks
from rm3d_plugin.ops.normals import _diagonalise
from rm3d_plugin.ops.octree import Neighbors, Octree

SECTORS, SHELLS, HALVES = 8, 2, 2  # azimuth, radius, elevation
VOLUMES = SECTORS * SHELLS * HALVES
COSINE_BINS = 11  # centres at -1, -0.8, ..., 1
BINS = VOLUMES * COSINE_BINS
MIN_NEIGHBORS = 5  # for a frame, the centre not among them
MEDIAN_POINTS = 5  # decide a sign that the majority leaves open
LINE = 1e-10  # second eigenvalue over the largest: below it the neighbours lie on a line, which has no frame
# From the second highest power down: arctan(x) / x in x^2, arccos(x) / sqrt(1 - x) in x.
ARC_TANGENT = (
    -0.0161657367,
    0.0429096138,
    -0.0752896400,
    0.1065626393,
    -0.1420889944,
    0.1999355085,
    -0.3333314528,
    1.0,
)
ARC_COSINE = (0.0066700901, -0.0170881256, 0.0308918810, -0.0501743046, 0.0889789874, -0.2145988016, 1.5707963050)
CHUNK = 1 << 15  # neighbourhoods held in memory at a time
BLOCK = 512  # points that one thread works on at a time


class Signatures(NamedTuple):
    """One signature a point.

    Attributes:
        values: (N, 352) float32, volume by volume (azimuth sector, then shell, then half) 11 cosine bins; zero where
            not valid.
        valid: (N,) bool, False with fewer than five neighbours, with all on one line, or none with a normal.
        frames: (N, 3, 3) float32, the x, y and z axes as rows; zero where not valid.
    """

    values: Float[np.ndarray, 'points 352']
    valid: Bool[np.ndarray, ' points']
    frames: Float[np.ndarray, 'points 3 3']


@njit(cache=True, nogil=True)
def _gather(xyz, rank, centre, indices, sq_dists, local, members):
    """Offsets and distance of the neighbours that lie elsewhere than the centre; how many they are."""
    count = 0
    for at in range(len(indices)):
        if sq_dists[at] > 0.0:
            other = rank[indices[at]]
            for axis in range(3):
                local[count, axis] = xyz[other, axis] - xyz[centre, axis]
            local[count, 3] = np.sqrt(sq_dists[at])
            members[count] = other
            count += 1
    return count


@njit(cache=True, nogil=True)
def _faces_back(local, count, axis):
    """Whether most neighbours lie behind the axis; a tie is decided by the points around the median distance."""
    ahead = 0
    for row in range(count):
        ahead += local[row, 0] * axis[0] + local[row, 1] * axis[1] + local[row, 2] * axis[2] >= 0.0
    if 2 * ahead != count:
        return 2 * ahead < count
    ahead, middle, reach = 0, count // 2, MEDIAN_POINTS // 2
    for row in range(middle - reach, middle + reach + 1):
        ahead += local[row, 0] * axis[0] + local[row, 1] * axis[1] + local[row, 2] * axis[2] > 0.0
    return ahead <= reach


@njit(cache=True, nogil=True)
def _frame(local, count, radius, matrix, vectors, axes):
    """Axes of a neighbourhood, sorted by distance, into the rows of ``axes``; False where it has none."""
    matrix[:] = 0.0
    total = 0.0
    for row in range(count):
        weight = radius - local[row, 3]
        total += weight
        for i in range(3):
            for j in range(3):
                matrix[i, j] += weight * local[row, i] * local[row, j]
    if not total > 0.0:
        return False
    matrix /= total
    _diagonalise(matrix, vectors)
    most = least = 0
    for axis in range(1, 3):
        if matrix[axis, axis] > matrix[most, most]:
            most = axis
        if matrix[axis, axis] <= matrix[least, least]:
            least = axis
    if most == least or not matrix[3 - most - least, 3 - most - least] > LINE * matrix[most, most]:
        return False
    for target, source in ((0, most), (2, least)):
        sign = -1.0 if _faces_back(local, count, vectors[:, source]) else 1.0
        for axis in range(3):
            axes[target, axis] = sign * vectors[axis, source]
    for axis in range(3):
        after, last = (axis + 1) % 3, (axis + 2) % 3
        axes[1, axis] = axes[2, after] * axes[0, last] - axes[2, last] * axes[0, after]
    return True


@njit(cache=True, nogil=True)
def _azimuth(y, x):
    """``arctan2`` to 3e-8 rad: polynomial 4.4.49 of Abramowitz and Stegun."""
    across, along = abs(y), abs(x)
    ratio = min(across, along) / max(across, along)
    square = ratio * ratio
    value = 0.0028662257
    for factor in ARC_TANGENT:
        value = value * square + factor
    value *= ratio
    value = np.pi / 2 - value if across > along else value
    value = np.pi - value if x < 0.0 else value
    return -value if y < 0.0 else value


@njit(cache=True, nogil=True)
def _inclination(cosine):
    """``arccos`` to 3e-8 rad: polynomial 4.4.46 of Abramowitz and Stegun."""
    size = min(abs(cosine), 1.0)
    value = -0.0012624911
    for factor in ARC_COSINE:
        value = value * size + factor
    value *= np.sqrt(1.0 - size)
    return np.pi - value if cosine < 0.0 else value


@njit(cache=True, nogil=True)
def _vote(x, y, z, distance, cosine, radius, histogram):
    """Add one neighbour: in each of four directions it is shared between the bin that holds it and the nearest next."""
    half = 1 if z > 0.0 else 0
    shell = 1 if distance > radius / 2 else 0
    aside = x != 0.0 or y != 0.0
    turn = (_azimuth(y, x) + np.pi) / (np.pi / 4) if aside else 0.0
    sector = min(int(turn), SECTORS - 1)
    position = (1.0 + cosine) * (COSINE_BINS - 1) / 2
    step = int(position + 0.5)
    volume = (sector * SHELLS + shell) * HALVES + half

    beside = position - step
    own = 1.0 - abs(beside)
    following = step + 1 if beside > 0.0 else step - 1
    # PCL counts this bin modulo ten: what belongs to the last one goes to the first.
    histogram[volume * COSINE_BINS + following % (COSINE_BINS - 1)] += abs(beside)

    beside = (distance / radius - 0.25) * 2 - shell
    own += 1.0 - abs(beside)
    if (beside > 0.0) != (shell == 1):
        histogram[(volume + (HALVES if shell == 0 else -HALVES)) * COSINE_BINS + step] += abs(beside)

    beside = 1.5 - _inclination(z / distance) / (np.pi / 2) - half
    own += 1.0 - abs(beside)
    if (beside > 0.0) != (half == 1):
        histogram[(volume + (1 if half == 0 else -1)) * COSINE_BINS + step] += abs(beside)

    if aside:
        beside = min(max(turn - 0.5 - sector, -0.5), 0.5)
        own += 1.0 - abs(beside)
        next_sector = (sector + (1 if beside > 0.0 else SECTORS - 1)) % SECTORS
        next_volume = (next_sector * SHELLS + shell) * HALVES + half
        histogram[next_volume * COSINE_BINS + step] += abs(beside)
    histogram[volume * COSINE_BINS + step] += own


@njit(cache=True, nogil=True)
def _signature(local, members, count, normals, radius, axes, histogram):
    """Fill the histogram with the neighbours that have a normal."""
    histogram[:] = 0.0
    for row in range(count):
        nx, ny, nz = normals[members[row], 0], normals[members[row], 1], normals[members[row], 2]
        if nx * nx + ny * ny + nz * nz > 0.5:
            dx, dy, dz = local[row, 0], local[row, 1], local[row, 2]
            cosine = min(max(nx * axes[2, 0] + ny * axes[2, 1] + nz * axes[2, 2], -1.0), 1.0)
            x = dx * axes[0, 0] + dy * axes[0, 1] + dz * axes[0, 2]
            y = dx * axes[1, 0] + dy * axes[1, 1] + dz * axes[1, 2]
            z = dx * axes[2, 0] + dy * axes[2, 1] + dz * axes[2, 2]
            _vote(x, y, z, local[row, 3], cosine, radius, histogram)


@njit(cache=True, nogil=True)
def _signatures_block(xyz, normals, rank, rows, found, radii, first, start, stop, square_norm, values, valid, frames):
    """Fill the outputs for chunk rows ``start`` to ``stop``; ``found``: offsets, indices and squared distances."""
    offsets, indices, sq_dists = found
    width = 0
    for row in range(start, stop):
        width = max(width, offsets[row + 1] - offsets[row])
    local, members = np.empty((width, 4)), np.empty(width, dtype=np.int64)
    matrix, vectors, axes, histogram = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty(BINS)
    for row in range(start, stop):
        low, high = offsets[row], offsets[row + 1]
        count = _gather(xyz, rank, first + row, indices[low:high], sq_dists[low:high], local, members)
        if count < MIN_NEIGHBORS or not _frame(local, count, radii[row], matrix, vectors, axes):
            continue
        _signature(local, members, count, normals, radii[row], axes, histogram)
        size = 0.0
        for column in range(BINS):
            size += histogram[column] * histogram[column] if square_norm else histogram[column]
        if size > 0.0:
            size = np.sqrt(size) if square_norm else size
            valid[rows[row]] = True
            frames[rows[row]] = axes
            for column in range(BINS):
                values[rows[row], column] = histogram[column] / size


def shot_signatures(
    points: Float[np.ndarray, 'points 3'],
    normals: Float[np.ndarray, 'points 3'],
    octree: Octree,
    search: Callable[[Int[np.ndarray, ' some']], tuple[Neighbors, Float[np.ndarray, ' some']]],
    square_norm: bool,
) -> Signatures:
    """SHOT of every point, computed in float64, a part of the points at a time along the Morton curve.

    Args:
        points: (N, 3) metres.
        normals: (N, 3) unit normals; a point with a zero or NaN normal shapes the frames alone.
        octree: Over the same points.
        search: Gives the neighbourhoods of some points, nearest first, and their radii in metres.
        square_norm: Scale each signature to an L2 norm of 1 instead of a sum of 1.

    Returns:
        One row a point.

    Raises:
        ValueError: Points, normals or octree do not fit.
    """
    if points.shape != normals.shape or points.ndim != 2 or points.shape[1] != 3 or len(octree) != len(points):
        raise ValueError(
            f'shot_signatures: points {points.shape}, normals {normals.shape}, octree of {len(octree)}: expected (N, 3)'
        )
    n, order = len(points), octree.order
    rank = np.empty(n, dtype=np.int32)
    rank[order] = np.arange(n, dtype=np.int32)
    xyz, directions = (np.ascontiguousarray(array[order], dtype=np.float64) for array in (points, normals))
    result = Signatures(
        np.zeros((n, BINS), dtype=np.float32), np.zeros(n, dtype=np.bool_), np.zeros((n, 3, 3), dtype=np.float32)
    )
    for first in range(0, n, CHUNK):
        rows = order[first : first + CHUNK]
        near, radii = search(rows)
        found = (near.offsets, near.indices, near.sq_dists)

        def work(
            start: int,
            stop: int,
            first: int = first,
            rows: np.ndarray = rows,
            found: tuple[np.ndarray, np.ndarray, np.ndarray] = found,
            radii: np.ndarray = radii,
        ) -> None:
            _signatures_block(xyz, directions, rank, rows, found, radii, first, start, stop, square_norm, *result)

        map_blocks(work, len(rows), BLOCK)
    return result
