"""Occupied voxels of a cloud and their 26 neighbours."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

AXIS_BITS = 20  # voxels along an axis: 2^20
GAP = 2  # cells apart: no neighbours, however much farther
RELATIONS = [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) != (0, 0, 0)]


class VoxelGrid(NamedTuple):
    """Occupied voxels of a cloud, sorted by (x, y, z).

    Attributes:
        coords: (V, 3) whole numbers, from 1 upwards; gaps are closed where the cloud is too wide (:func:`close_gaps`).
        point_to_voxel: (N,) voxel of each point.
    """

    coords: Int[np.ndarray, 'voxels 3']
    point_to_voxel: Int[np.ndarray, ' points']


def voxel_grid(points: Float[np.ndarray, 'points 3'], size: float) -> VoxelGrid:
    """Sort points into cubes of edge ``size`` metres whose corners lie at multiples of it.

    Raises:
        ValueError: The size is not positive, or more than half a million voxels along an axis are occupied.
    """
    if not size > 0:
        raise ValueError(f'voxel_grid: size: expected a positive length in metres, got {size}')
    if len(points) == 0:
        return VoxelGrid(np.zeros((0, 3), dtype=np.int64), np.zeros(0, dtype=np.int64))
    cells = np.floor(points.astype(np.float64) / size)
    cells = (cells - cells.min(axis=0) + 1).astype(np.int64)  # from 1: a neighbour's number is never negative
    cells = close_gaps(cells, (1 << AXIS_BITS) - 2)
    if cells.max() > (1 << AXIS_BITS) - 2:
        raise ValueError(
            f'voxel_grid: the cloud is {cells.max()} voxels of {size} m wide, at most {(1 << AXIS_BITS) - 2} '
            'can be numbered; drop stray points or use larger voxels'
        )
    keys, inverse = np.unique(_keys(cells), return_inverse=True)
    mask = (1 << AXIS_BITS) - 1
    coords = np.stack([keys >> 2 * AXIS_BITS, keys >> AXIS_BITS & mask, keys & mask], axis=1)
    return VoxelGrid(coords, inverse.astype(np.int64))


def close_gaps(cells: Int[np.ndarray, 'points 3'], most: int) -> Int[np.ndarray, 'points 3']:
    """Cells with smaller numbers where some exceed ``most``: an empty stretch along an axis becomes one cell wide.

    Which cells touch each other stays as it is, and so does their order along each axis.

    Args:
        cells: Whole numbers from 1 upwards.
        most: Largest number that is wanted; a cloud with more occupied cells along an axis exceeds it still.
    """
    if not len(cells) or cells.max() <= most:
        return cells
    out = np.empty_like(cells)
    for axis in range(cells.shape[1]):
        occupied, inverse = np.unique(cells[:, axis], return_inverse=True)
        steps = np.minimum(np.diff(occupied, prepend=occupied[0] - 1), GAP)
        out[:, axis] = np.cumsum(steps)[inverse]
    return out


def _keys(coords: Int[np.ndarray, 'voxels 3']) -> Int[np.ndarray, ' voxels']:
    x, y, z = coords.T
    return ((x << AXIS_BITS) | y) << AXIS_BITS | z


def voxel_neighbors(coords: Int[np.ndarray, 'voxels 3']) -> Int[np.ndarray, 'voxels 26']:
    """The 26 voxels that share a face, edge or corner with each (sorted as by :func:`voxel_grid`); -1 = empty."""
    out = np.full((len(coords), len(RELATIONS)), -1, dtype=np.int64)
    if len(coords) == 0:
        return out
    keys = _keys(coords)
    for column, relation in enumerate(RELATIONS):
        wanted = _keys(coords + np.array(relation))
        at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        out[:, column] = np.where(keys[at] == wanted, at, -1)
    return out
