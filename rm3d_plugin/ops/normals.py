"""Surface normals and curvature from neighbourhood covariances (METHOD 2)."""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: ANN001, ANN202
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numba import njit

from rm3d_plugin.ops._parallel import map_blocks
from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.ops.shared_octree import nearest_of_each, octree_of

MIN_POINTS = 3  # a plane needs so many
CHUNK = 1 << 16  # points whose neighbours are held in memory at a time
BLOCK = 4096  # points that one thread works on at a time
SWEEPS = 12  # Jacobi converges quadratically: five sweeps reach rounding, the rest is never needed


@dataclass(frozen=True, eq=False)
class NormalEstimate:
    """Normals and curvature of points.

    Attributes:
        normals: (N, 3) float32 unit vectors; (0, 0, 1) where not valid.
        curvature: (N,) float32 l0 / (l0 + l1 + l2) in [0, 1/3]; 0 where not valid.
        valid: (N,) bool, False where the neighbourhood has fewer than three points.
    """

    normals: Float[np.ndarray, 'points 3']
    curvature: Float[np.ndarray, ' points']
    valid: Bool[np.ndarray, ' points']


@njit(cache=True, nogil=True)
def _rotate(matrix, vectors, p, q):
    """One Jacobi rotation that zeroes ``matrix[p, q]``."""
    if matrix[p, q] == 0.0:
        return
    slope = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
    t = 1.0 / (abs(slope) + np.sqrt(slope * slope + 1.0))
    if slope < 0.0:
        t = -t
    c = 1.0 / np.sqrt(t * t + 1.0)
    s = t * c
    other = 3 - p - q
    matrix[p, p] -= t * matrix[p, q]
    matrix[q, q] += t * matrix[p, q]
    matrix[p, q] = matrix[q, p] = 0.0
    with_p, with_q = matrix[other, p], matrix[other, q]
    matrix[other, p] = matrix[p, other] = c * with_p - s * with_q
    matrix[other, q] = matrix[q, other] = s * with_p + c * with_q
    for row in range(3):
        with_p, with_q = vectors[row, p], vectors[row, q]
        vectors[row, p] = c * with_p - s * with_q
        vectors[row, q] = s * with_p + c * with_q


@njit(cache=True, nogil=True)
def _diagonalise(matrix, vectors):
    """Jacobi's method on a symmetric 3 x 3 matrix in place; eigenvectors become the columns of ``vectors``."""
    for row in range(3):
        for column in range(3):
            vectors[row, column] = 1.0 if row == column else 0.0
    for _ in range(SWEEPS):
        off = abs(matrix[0, 1]) + abs(matrix[0, 2]) + abs(matrix[1, 2])
        if off <= 1e-18 * (matrix[0, 0] + matrix[1, 1] + matrix[2, 2]):
            break
        _rotate(matrix, vectors, 0, 1)
        _rotate(matrix, vectors, 0, 2)
        _rotate(matrix, vectors, 1, 2)


@njit(cache=True, nogil=True)
def _covariance(points, members, centre, matrix):
    """Covariance of the members (not -1), summed about their mean; how many they are."""
    mean = np.zeros(3)
    count = 0
    for member in members:
        if member < 0:
            break
        count += 1
        for axis in range(3):
            mean[axis] += points[member, axis] - centre[axis]
    mean /= max(count, 1)
    matrix[:] = 0.0
    for member in members[:count]:
        x = points[member, 0] - centre[0] - mean[0]
        y = points[member, 1] - centre[1] - mean[1]
        z = points[member, 2] - centre[2] - mean[2]
        matrix[0, 0] += x * x
        matrix[0, 1] += x * y
        matrix[0, 2] += x * z
        matrix[1, 1] += y * y
        matrix[1, 2] += y * z
        matrix[2, 2] += z * z
    matrix[1, 0], matrix[2, 0], matrix[2, 1] = matrix[0, 1], matrix[0, 2], matrix[1, 2]
    return count


@njit(cache=True, nogil=True)
def _normals_block(points, rows, offsets, indices, start, stop, viewpoint, normals, curvature, valid):
    """Normals of ``rows[start:stop]``; without a viewpoint (NaN) the largest component is positive."""
    matrix, vectors = np.empty((3, 3)), np.empty((3, 3))
    for at in range(start, stop):
        row = rows[at]
        count = _covariance(points, indices[offsets[at] : offsets[at + 1]], points[row], matrix)
        total = matrix[0, 0] + matrix[1, 1] + matrix[2, 2]
        if count < MIN_POINTS or not total > 0.0:
            normals[row] = (0.0, 0.0, 1.0)
            continue
        _diagonalise(matrix, vectors)
        least = 0
        for axis in range(1, 3):
            if matrix[axis, axis] < matrix[least, least]:
                least = axis
        largest = 0
        facing = 0.0
        for axis in range(3):
            if abs(vectors[axis, least]) > abs(vectors[largest, least]):
                largest = axis
            facing += (viewpoint[axis] - points[row, axis]) * vectors[axis, least]
        if facing == 0.0 or np.isnan(facing):
            facing = vectors[largest, least]
        sign = 1.0 if facing > 0.0 else -1.0
        for axis in range(3):
            normals[row, axis] = sign * vectors[axis, least]
        curvature[row] = max(matrix[least, least], 0.0) / total
        valid[row] = True


def estimate_normals(
    points: Float[np.ndarray, 'points 3'],
    k: int = 20,
    radius: float | None = None,
    viewpoint: Float[np.ndarray, '3'] | tuple[float, float, float] | None = None,
    octree: Octree | None = None,
) -> NormalEstimate:
    """Normals and curvature of every point: eigenvectors and eigenvalues of its neighbourhood's covariance (METHOD 2).

    Args:
        points: (N, 3) metres.
        k: Nearest points that make the neighbourhood, the point itself among them (larger: smoother).
        radius: Take all points within so many metres instead.
        viewpoint: (3,) metres; normals turn towards it. Without it their largest component is positive: the sign
            then means nothing.
        octree: Over the same points, where there is one already.

    Returns:
        One row a point. A neighbourhood of fewer than three points, or all in one place, is not valid.

    Raises:
        ValueError: A coordinate is not finite, ``k`` or ``radius`` is not positive, or the octree has other points.
    """
    if radius is None and k < 1:
        raise ValueError(f'estimate_normals: k: expected at least 1, got {k}')
    if radius is not None and not radius > 0:
        raise ValueError(f'estimate_normals: radius: expected a positive radius in metres, got {radius}')
    tree = octree_of(points) if octree is None else octree
    n = len(points)
    if len(tree) != n:
        raise ValueError(f'estimate_normals: octree: expected one of the {n} points, got one of {len(tree)}')
    array = np.ascontiguousarray(points, dtype=np.float64)
    view = np.full(3, np.nan) if viewpoint is None else np.asarray(viewpoint, dtype=np.float64)
    normals, curvature = np.empty((n, 3), dtype=np.float32), np.zeros(n, dtype=np.float32)
    valid = np.zeros(n, dtype=np.bool_)
    found = _within(tree, array, radius) if radius is not None else _nearest(tree, points, k, octree is None)
    for rows, indices, offsets in found:

        def work(
            first: int, last: int, rows: np.ndarray = rows, offsets: np.ndarray = offsets, indices: np.ndarray = indices
        ) -> None:
            _normals_block(array, rows, offsets, indices, first, last, view, normals, curvature, valid)

        map_blocks(work, len(rows), BLOCK)
    return NormalEstimate(normals, curvature, valid)


def _within(tree: Octree, points: np.ndarray, radius: float) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Numbers of some points at a time, and their neighbours within a radius in CSR."""
    for start in range(0, len(points), CHUNK):
        rows = tree.order[start : start + CHUNK]
        found = tree.radius(points[rows], radius, ordered=False)
        yield rows, found.indices, found.offsets


def _nearest(
    tree: Octree, points: np.ndarray, k: int, shared: bool
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """The same of the nearest ones; ``shared``: others may meet the same points."""
    orders = (tree.order[start : start + CHUNK] for start in range(0, len(points), CHUNK))
    found = nearest_of_each(points, k, CHUNK) if shared else ((rows, tree.knn(points[rows], k)) for rows in orders)
    for rows, near in found:
        indices = near.indices.reshape(-1)
        yield rows, indices, np.arange(0, len(indices) + 1, k, dtype=np.int64)
