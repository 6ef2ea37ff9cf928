"""The nearest points of every point, and what they say of the surface there."""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: ANN001, ANN202
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numba import njit

from rm3d_plugin.ops._parallel import map_blocks
from rm3d_plugin.ops.normals import MIN_POINTS, _covariance, _diagonalise
from rm3d_plugin.ops.octree import Octree

NEAREST = 16  # neighbours of a point besides itself: a plane is seen through the noise, and edges of 10 cm still show
SPACING_RANK = 8  # the spacing is the usual distance to this neighbour: two rings of a grid
SHAPE_COLUMNS = 8
_BLOCK = 4096  # points that one thread works on at a time
_LEAST_SIZE = 1e-6  # m, below which logarithms of sizes are alike


class Neighborhoods(NamedTuple):
    """Nearest points and the shape of where they lie.

    Attributes:
        nearest: (N, k + 1) int32 nearest points, the point itself among the first; -1 where there are fewer.
        distance: (N, k + 1) metres; inf where there are fewer.
        normal: (N, 3) unit vectors of either sign; (0, 0, 1) where three points are not there.
        shape: (N, 8) linearity, planarity, scattering (Guinard and Landrieu 2017), upright part of the normal and of
            the longest direction, surface variation, log of the longest extent in metres, height over the mean.
        spacing: Metres, the usual distance to the :data:`SPACING_RANK`-th neighbour.
    """

    nearest: Int[np.ndarray, 'points k']
    distance: Float[np.ndarray, 'points k']
    normal: Float[np.ndarray, 'points 3']
    shape: Float[np.ndarray, 'points 8']
    spacing: float


def neighborhoods(xyz: Float[np.ndarray, 'points 3'], k: int = NEAREST) -> Neighborhoods:
    """Search the neighbours of all points, and fit an ellipsoid to each neighbourhood.

    Args:
        xyz: Metres, z up.
        k: Neighbours besides the point itself (larger: smoother normals, rounder edges).
    """
    points = np.ascontiguousarray(xyz, dtype=np.float64)
    count = len(points)
    if not count:
        return Neighborhoods(
            np.zeros((0, k + 1), np.int32), np.zeros((0, k + 1)), np.zeros((0, 3)), np.zeros((0, SHAPE_COLUMNS)), 0.0
        )
    near = Octree(points).knn(points, k + 1)
    distance = np.sqrt(near.sq_dists)
    normal, shape = np.zeros((count, 3)), np.zeros((count, SHAPE_COLUMNS))

    def work(start: int, stop: int) -> None:
        _shapes(points, near.indices, start, stop, normal, shape)

    map_blocks(work, count, _BLOCK)
    reached = distance[:, min(SPACING_RANK, k, count - 1)]
    return Neighborhoods(near.indices, distance, normal, shape, float(np.median(reached)))


@njit(cache=True, nogil=True)
def _shapes(points, near, start, stop, normal, shape):
    matrix, vectors = np.empty((3, 3)), np.empty((3, 3))
    for row in range(start, stop):
        normal[row] = (0.0, 0.0, 1.0)
        shape[row, 6] = np.log(_LEAST_SIZE)
        count = _covariance(points, near[row], points[row], matrix)
        total = matrix[0, 0] + matrix[1, 1] + matrix[2, 2]
        if count < MIN_POINTS or not total > 0.0:
            continue
        _diagonalise(matrix, vectors)
        values = np.array([matrix[0, 0], matrix[1, 1], matrix[2, 2]])
        order = np.argsort(values)
        spread = np.sqrt(np.maximum(values[order], 0.0) / count)
        mean = 0.0
        for member in near[row, :count]:
            mean += points[member, 2] / count
        normal[row] = vectors[:, order[0]]
        shape[row, 0] = (spread[2] - spread[1]) / spread[2]
        shape[row, 1] = (spread[1] - spread[0]) / spread[2]
        shape[row, 2] = spread[0] / spread[2]
        shape[row, 3] = abs(vectors[2, order[0]])
        shape[row, 4] = abs(vectors[2, order[2]])
        shape[row, 5] = max(values[order[0]], 0.0) / total
        shape[row, 6] = np.log(spread[2] + _LEAST_SIZE)
        shape[row, 7] = points[row, 2] - mean
