"""The nearest neighbour in each of the eight octants around a point (Jiang et al., PointSIFT, arXiv 1807.00652)."""

import numpy as np
from jaxtyping import Float, Int
from numba import njit

from rm3d_plugin.ops.octree import Octree

CHUNK = 1 << 14  # points whose neighbours are held at a time


def octant_neighbors(
    xyz: Float[np.ndarray, 'points 3'], radius: float, octree: Octree | None = None
) -> Int[np.ndarray, 'points 8']:
    """For each point its nearest other one in each octant; the point itself where there is none.

    Octant 4 a + 2 b + c holds what lies at x >= 0, y >= 0, z >= 0 of the point where a, b, c are 1, and below 0 where
    they are 0. Points at the same place are no neighbours. Ties: the lowest number.

    Args:
        xyz: Any unit.
        radius: How far a neighbour may lie, in that unit.
        octree: Over the same points, where there is one already.

    Raises:
        ValueError: The radius is not positive.
    """
    if not radius > 0:
        raise ValueError(f'octant_neighbors: radius: expected more than 0, got {radius}')
    points = np.array(xyz, dtype=np.float64, order='C')
    tree = Octree(points) if octree is None else octree
    out = np.repeat(np.arange(len(points))[:, None], 8, axis=1)
    for start in range(0, len(points), CHUNK):
        rows = np.arange(start, min(start + CHUNK, len(points)))
        found = tree.radius(points[rows], radius, ordered=False)
        _nearest_of_octants(points, rows, found.indices, found.offsets, found.sq_dists, out)
    return out


@njit(cache=True)
def _nearest_of_octants(
    points: np.ndarray,
    rows: np.ndarray,
    indices: np.ndarray,
    offsets: np.ndarray,
    sq_dists: np.ndarray,
    out: np.ndarray,
) -> None:
    best = np.empty(8)
    for at in range(len(rows)):
        best[:] = np.inf
        own = rows[at]
        for slot in range(offsets[at], offsets[at + 1]):
            other, square = indices[slot], sq_dists[slot]
            if square == 0.0:
                continue
            octant = 0
            for axis in range(3):
                octant = 2 * octant + (1 if points[other, axis] >= points[own, axis] else 0)
            if square < best[octant] or (square == best[octant] and other < out[own, octant]):
                best[octant], out[own, octant] = square, other
