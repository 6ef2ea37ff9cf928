"""Eigenfeatures of neighbourhoods: how linear, planar, scattered and upright they are (METHOD 3, Superpoint-Graph)."""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: ANN001, ANN202
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from numba import njit

from rm3d_plugin.ops._parallel import map_blocks
from rm3d_plugin.ops.normals import MIN_POINTS, _covariance, _diagonalise
from rm3d_plugin.ops.octree import Octree

CHUNK = 1 << 16  # points whose neighbours are held in memory at a time
BLOCK = 4096  # points that one thread works on at a time


class GeometricFeatures(NamedTuple):
    """Four numbers in [0, 1] for each point.

    Attributes:
        values: (N, 4) float32 linearity, planarity, scattering, verticality; the first three add up to 1. Zero where
            not valid.
        valid: (N,) bool, False where the neighbourhood has fewer than three points, or all in one place.
    """

    values: Float[np.ndarray, 'points 4']
    valid: Bool[np.ndarray, ' points']


def geometric_features(
    points: Float[np.ndarray, 'points 3'], k: int = 45, octree: Octree | None = None
) -> GeometricFeatures:
    """Linearity, planarity, scattering and verticality (Guinard and Landrieu 2017, as Superpoint-Graph uses them).

    With s1 >= s2 >= s3 the square roots of the covariance's eigenvalues: (s1 - s2) / s1, (s2 - s3) / s1 and s3 / s1.
    Verticality is the vertical part of the unit vector along sum_j lambda_j |u_j|: 0 for a floor, about 0.7 for a wall,
    1 for a pole.

    Args:
        points: (N, 3) metres, z up.
        k: Nearest points besides the point itself (larger: smoother).
        octree: Over the same points, where there is one already.

    Raises:
        ValueError: A coordinate is not finite, ``k`` is not positive, or the octree has other points.
    """
    if k < 1:
        raise ValueError(f'geometric_features: k: expected at least 1, got {k}')
    tree = Octree(points) if octree is None else octree
    n = len(points)
    if len(tree) != n:
        raise ValueError(f'geometric_features: octree: expected one of the {n} points, got one of {len(tree)}')
    array = np.ascontiguousarray(points, dtype=np.float64)
    values, valid = np.zeros((n, 4), dtype=np.float32), np.zeros(n, dtype=np.bool_)
    for start in range(0, n, CHUNK):
        rows = tree.order[start : start + CHUNK]
        near = tree.knn(array[rows], min(k + 1, n)).indices

        def work(first: int, last: int, rows: np.ndarray = rows, near: np.ndarray = near) -> None:
            _features_block(array, rows, near, first, last, values, valid)

        map_blocks(work, len(rows), BLOCK)
    return GeometricFeatures(values, valid)


@njit(cache=True, nogil=True)
def _features_block(points, rows, near, start, stop, values, valid):
    matrix, vectors = np.empty((3, 3)), np.empty((3, 3))
    for at in range(start, stop):
        row = rows[at]
        count = _covariance(points, near[at], points[row], matrix)
        total = matrix[0, 0] + matrix[1, 1] + matrix[2, 2]
        if count < MIN_POINTS or not total > 0.0:
            continue
        _diagonalise(matrix, vectors)
        spread = np.empty(3)
        direction = np.zeros(3)
        for column in range(3):
            value = max(matrix[column, column], 0.0)
            spread[column] = np.sqrt(value)
            for axis in range(3):
                direction[axis] += value * abs(vectors[axis, column])
        spread.sort()
        values[row, 0] = (spread[2] - spread[1]) / spread[2]
        values[row, 1] = (spread[1] - spread[0]) / spread[2]
        values[row, 2] = spread[0] / spread[2]
        values[row, 3] = direction[2] / np.sqrt((direction * direction).sum())
        valid[row] = True
