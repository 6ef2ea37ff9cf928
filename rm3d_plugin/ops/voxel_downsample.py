"""A subset of points with a least distance between any two, without a grid's preference for axes."""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: ANN001, ANN202
import numpy as np
from jaxtyping import Float, Int
from numba import njit

from rm3d_plugin.ops.voxel_grid import close_gaps

REACH = 2**20  # cells along an axis that fit a cell's number


@njit(cache=True)
def _thin(points, cells, beside, square):
    """Points that no earlier kept point lies nearer to than the spacing; ``beside``: cells around each cell, or -1."""
    head, after = np.full(len(beside), -1, dtype=np.int64), np.full(len(points), -1, dtype=np.int64)
    kept = np.empty(len(points), dtype=np.int64)
    count = 0
    for i in range(len(points)):
        free = True
        for cell in beside[cells[i]]:
            j = head[cell] if cell >= 0 else -1
            while j >= 0 and free:
                dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
                free = dx * dx + dy * dy + dz * dz >= square
                j = after[j]
            if not free:
                break
        if free:
            after[i], head[cells[i]] = head[cells[i]], i
            kept[count] = i
            count += 1
    return kept[:count]


def voxel_downsample_points(points: Float[np.ndarray, 'points 3'], spacing: float) -> Int[np.ndarray, ' kept']:
    """Keep each point, in their order, that lies at least ``spacing`` from all kept before.

    Every point has a kept one nearer than ``spacing``; only distances and the order count, so turning the cloud
    changes nothing but by rounding.

    Args:
        points: (N, 3) metres, finite.
        spacing: Metres.

    Returns:
        Numbers of the kept points, ascending.

    Raises:
        ValueError: ``spacing`` is not positive, or so small that along an axis half a million stretches of it hold
            points.
    """
    if not spacing > 0:
        raise ValueError(f'voxel_downsample_points: spacing: expected metres > 0, got {spacing}')
    if len(points) == 0:
        return np.zeros(0, dtype=np.int64)
    array = np.ascontiguousarray(points, dtype=np.float64)
    grid = np.floor((array - array.min(axis=0)) / spacing).astype(np.int64) + 1
    grid = close_gaps(grid, REACH - 2)
    if grid.max() > REACH - 2:
        raise ValueError(
            f'voxel_downsample_points: spacing {spacing} m: the cloud is more than {REACH - 2} times as wide'
        )
    codes, cells = np.unique((grid[:, 0] * REACH + grid[:, 1]) * REACH + grid[:, 2], return_inverse=True)
    steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing='ij'), axis=-1).reshape(27, 3)
    around = codes[:, None] + ((steps[:, 0] * REACH + steps[:, 1]) * REACH + steps[:, 2])
    at = np.minimum(np.searchsorted(codes, around), len(codes) - 1)
    return _thin(array, cells.reshape(-1), np.where(codes[at] == around, at, -1), spacing * spacing)
