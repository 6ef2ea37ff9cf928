"""What points look like at several scales: shape, height, colour and return strength of what lies around them."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import minimum_filter

from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.ops.segment import segment_mean
from rm3d_plugin.pseudo_labels.propagation.neighborhoods import SHAPE_COLUMNS, Neighborhoods, neighborhoods

LEVELS = 5  # voxels of 2, 4, 8, 16 and 32 spacings (a pyramid as of Hackel, Wegner and Schindler 2016)
AROUND = 26  # voxels around one: those that touch it where all are occupied
LEAST_VOXELS = 32  # a level with fewer tells nothing apart: the level below stands there
COLUMNS_OF = (16.0, 64.0, 256.0)  # spacings, edges of the columns in which heights are taken
FLOOR_PERCENT = 1.0  # of the points lie below the floor: stray ones
MOST_CELLS = 1 << 22  # of a grid of columns; wider clouds get wider columns


class _Level(NamedTuple):
    """A voxel-downsampled cloud: middles of voxels, points of each, and the nearest middle of each point."""

    middle: Float[np.ndarray, 'voxels 3']
    voxel: Int[np.ndarray, ' points']
    sizes: Int[np.ndarray, ' voxels']


def point_features(
    xyz: Float[np.ndarray, 'points 3'], near: Neighborhoods, channels: list[Float[np.ndarray, 'points columns']]
) -> Iterator[Float[np.ndarray, 'points columns']]:
    """Features of all points, some columns at a time; lengths follow the spacing of the scan.

    Shape of the nearest points and of five scales above, how many points fill a voxel there, mean and deviation of the
    channels, and heights over the lowest point of columns of three widths and over the floor.

    Args:
        xyz: Metres, z up.
        near: Of the same points.
        channels: Of :func:`~rm3d_plugin.pseudo_labels.propagation.channels.channel_groups`.
    """
    points = np.asarray(xyz, dtype=np.float64)
    extra = np.concatenate([np.zeros((len(points), 0)), *channels], axis=1)
    yield near.shape
    yield extra
    below = np.zeros((len(points), _level_width(extra.shape[1])))
    for level in range(1, LEVELS + 1):
        downsampled = _level(points, near.spacing * 2.0**level)
        if len(downsampled.middle) >= LEAST_VOXELS:
            below = _level_features(points, downsampled, extra)
        yield below
    yield _heights(points, near.spacing)


def _level_width(channels: int) -> int:
    return SHAPE_COLUMNS + 2 + 2 * channels


def _level(points: Float[np.ndarray, 'points 3'], size: float) -> _Level:
    if not (len(points) and size > 0):
        return _Level(points[:0], np.zeros(len(points), np.int64), np.zeros(0, np.int64))
    cells = np.floor((points - points.min(axis=0)) / size).astype(np.int64)
    _, voxel, count = np.unique(_keys(cells), return_inverse=True, return_counts=True)
    return _Level(segment_mean(points, voxel, len(count)), voxel, count)


def _keys(cells: Int[np.ndarray, 'points 3']) -> Int[np.ndarray, ' points']:
    """One number a cell; cells more than two million apart may share one, which only blurs features."""
    x, y, z = (cells & ((1 << 21) - 1)).T
    return np.asarray((x << 42) | (y << 21) | z)


def _level_features(
    points: Float[np.ndarray, 'points 3'], level: _Level, extra: Float[np.ndarray, 'points columns']
) -> Float[np.ndarray, 'points features']:
    around = neighborhoods(level.middle, min(AROUND, len(level.middle) - 1))
    height = level.middle[:, 2][around.nearest]
    columns = [around.shape, np.ptp(height, axis=1)[:, None], np.log(level.sizes)[:, None]]
    if extra.shape[1]:
        few = around.nearest[:, :9]
        mean = segment_mean(extra, level.voxel, len(level.sizes))[few].mean(axis=1)
        square = segment_mean(np.square(extra), level.voxel, len(level.sizes))[few].mean(axis=1)
        columns += [mean, np.sqrt(np.maximum(square - np.square(mean), 0.0))]
    nearest = Octree(level.middle).knn(points, 1).indices[:, 0]
    return np.asarray(np.concatenate(columns, axis=1)[nearest])


def _heights(points: Float[np.ndarray, 'points 3'], spacing: float) -> Float[np.ndarray, 'points 4']:
    """Metres over the lowest point of the column and its eight neighbours, by width, and over the floor."""
    if not len(points):
        return np.zeros((0, len(COLUMNS_OF) + 1))
    z = points[:, 2]
    heights = [_over_lowest(points, edge * spacing) for edge in COLUMNS_OF]
    return np.stack([*heights, z - np.percentile(z, FLOOR_PERCENT)], axis=1)


def _over_lowest(points: Float[np.ndarray, 'points 3'], edge: float) -> Float[np.ndarray, ' points']:
    low = points[:, :2].min(axis=0)
    area = float(np.prod(np.ptp(points[:, :2], axis=0) + edge))
    edge = max(edge, float(np.sqrt(area / MOST_CELLS)), float(np.ptp(points[:, :2], axis=0).max()) / MOST_CELLS, 1e-9)
    cell = np.floor((points[:, :2] - low) / edge).astype(np.int64)
    lowest = np.full(cell.max(axis=0) + 1, np.inf)
    np.minimum.at(lowest, (cell[:, 0], cell[:, 1]), points[:, 2])
    lowest = minimum_filter(lowest, size=3, mode='nearest')
    return np.asarray(points[:, 2] - lowest[cell[:, 0], cell[:, 1]])
