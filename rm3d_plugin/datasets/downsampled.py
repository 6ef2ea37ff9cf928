"""Fewer points on load, without losing the way back: one point a voxel, and for every original point its row.

A network sees the kept points, labels and budgets are about them, and predictions go back to every original point by
``prediction[dataset.original_index(index)]``.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.storage.coordinates import warn_of_strays
from rm3d_plugin.structures import stray_points

REACH = 2**20  # cells to either side of the first point that fit a cell's number


class Thinned(NamedTuple):
    """Which points stay, and who stands for each of the others.

    Attributes:
        kept: (n,) int64 numbers of the points that stay, ascending.
        rows: (N,) int64 row of ``kept`` that stands for each original point; ``kept[rows[kept]] == kept``.
    """

    kept: Int[np.ndarray, ' kept']
    rows: Int[np.ndarray, ' points']


class VoxelThinner:
    """Keeps the first point of each voxel, chunk by chunk: chunks give what all points at once would give.

    The grid is aligned to the coordinates' zero, so that it depends on no bounding box.

    Args:
        size: Edge of a voxel, metres.

    Raises:
        ValueError: ``size`` is not positive.
    """

    def __init__(self, size: float) -> None:
        self.size = check_voxel(size)
        self.seen = 0  # points so far
        self._anchor: np.ndarray | None = None  # cell of the first point
        self._codes = np.zeros(0, dtype=np.int64)  # of the kept points' cells, ascending
        self._rows = np.zeros(0, dtype=np.int64)  # row of the kept point in each of them

    def __len__(self) -> int:
        return len(self._codes)

    def add(self, xyz: Float[np.ndarray, 'points 3']) -> Thinned:
        """Take in the next points.

        Args:
            xyz: (n, 3) metres, finite; every chunk in the same frame, float64 where coordinates are large.

        Returns:
            ``kept``: numbers *within the chunk* of the points that stay; ``rows``: for each point of the chunk, its row
            among all points kept since the first chunk.

        Raises:
            ValueError: A point lies a million voxels or more from the first one.
        """
        codes = self._cell_codes(xyz)
        self.seen += len(codes)
        unique, first, inverse = np.unique(codes, return_index=True, return_inverse=True)
        at = np.searchsorted(self._codes, unique)
        known = at < len(self._codes)
        known[known] = self._codes[at[known]] == unique[known]

        fresh = np.flatnonzero(~known)
        order = fresh[np.argsort(first[fresh], kind='stable')]  # rows are given in the order of the points
        row = np.empty(len(unique), dtype=np.int64)
        row[known] = self._rows[at[known]]
        row[order] = len(self._codes) + np.arange(len(order))

        self._codes = np.insert(self._codes, at[fresh], unique[fresh])
        self._rows = np.insert(self._rows, at[fresh], row[fresh])
        return Thinned(first[order].astype(np.int64), row[inverse.reshape(-1)])

    def _cell_codes(self, xyz: Float[np.ndarray, 'points 3']) -> Int[np.ndarray, ' points']:
        real = np.floor(np.asarray(xyz, dtype=np.float64) / self.size)  # integers would overflow unseen
        if self._anchor is None and len(real):
            self._anchor = real[0].copy()
        if self._anchor is not None:
            real -= self._anchor
        if len(real) and not np.abs(real).max() < REACH:
            raise ValueError(
                f'thinning to {self.size} m: a point lies {np.abs(real).max() * self.size:.0f} m from the first one, '
                f'the grid reaches {REACH * self.size:.0f} m; remove stray points or use larger voxels'
            )
        shifted = real.astype(np.int64) + REACH
        return (shifted[:, 0] * (2 * REACH) + shifted[:, 1]) * (2 * REACH) + shifted[:, 2]


def thin_voxels(xyz: Float[np.ndarray, 'points 3'], size: float | None) -> Thinned:
    """The first point of each voxel, and for each point the row of the one that stays in its voxel.

    Args:
        xyz: (N, 3) metres, finite.
        size: Edge of a voxel, metres; None: every point stays.

    Raises:
        ValueError: ``size`` is not positive, or the cloud is a million voxels wide.

    >>> thin_voxels(np.array([[0.1, 0, 0], [0.9, 0, 0], [0.3, 0, 0]]), 0.5)
    Thinned(kept=array([0, 1]), rows=array([0, 1, 0]))
    """
    if size is None:
        return Thinned(np.arange(len(xyz)), np.arange(len(xyz)))
    return VoxelThinner(size).add(xyz)


class KeptPoints(NamedTuple):
    """A scene without its stray points, thinned.

    Attributes:
        kept: (n,) int64 numbers of the points that stay, ascending.
        rows: (N,) int64 row of ``kept`` that stands for each point; 0, which means nothing, for a stray one.
        stray: (N,) bool; nobody stands for these.
    """

    kept: Int[np.ndarray, ' kept']
    rows: Int[np.ndarray, ' points']
    stray: Bool[np.ndarray, ' points']


def keep_points(xyz: Float[np.ndarray, 'points 3'], size: float | None, name: str) -> KeptPoints:
    """Leave out stray points with a warning that names them, and thin the others.

    Args:
        xyz: (N, 3) metres, world frame, finite.
        size: See :func:`thin_voxels`.
        name: Of the scene, for the warning.

    Raises:
        ValueError: See :func:`thin_voxels`.
    """
    stray = stray_points(xyz)
    if not stray.any():
        return KeptPoints(*thin_voxels(xyz, size), stray)
    warn_of_strays(stray, xyz, name, 'they are left out, their class is unknown')
    thin = thin_voxels(xyz[~stray], size)
    rows = np.zeros(len(xyz), dtype=np.int64)
    rows[~stray] = thin.rows
    return KeptPoints(np.flatnonzero(~stray)[thin.kept], rows, stray)


def check_voxel(size: float) -> float:
    """The edge of a voxel as float.

    Raises:
        ValueError: It is no positive number of metres.
    """
    if not 0 < size < np.inf:
        raise ValueError(f'voxel_downsample: expected metres > 0, or None for every point, got {size}')
    return float(size)
