"""What the ground looks like, point by point: how bright, how rough, and what lies higher or brighter beside it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import gaussian_filter, map_coordinates

from rm3d_plugin.pseudo_labels.common.sensor import WIDEST, IntensityByRange, brightness, intensity_of, seen_from_sensor
from rm3d_plugin.structures import PointCloud

CELL = 0.25  # m of the grid, seen from above, on which neighbourhoods are taken
SCALES = (0.25, 0.5, 1.0, 2.0, 4.0)  # m, deviation of the neighbourhoods' Gaussians
ROUGH_SCALES = SCALES[1:4]
SIDE_SCALE = SCALES[1]
SIDES = (0.75, 1.5, 2.5, 4.0)  # m to both sides
PLANE_NOISE = 0.1  # m
_TRUNCATE = 2.5  # deviations


class GroundFeatures(NamedTuple):
    """Features of the ground points of a scene.

    Attributes:
        rows: (L, F) one a ground point.
        heights: (N,) metres of all points above the plane through most ground ones.
    """

    rows: Float[np.ndarray, 'ground features']
    heights: Float[np.ndarray, ' points']


def ground_features(
    cloud: PointCloud, ground: Bool[np.ndarray, ' points'], usual: IntensityByRange, heading: bool
) -> GroundFeatures:
    """Brightness, range, distance from the path; means, deviations and heights around; differences to both sides.

    Brightness is the strength over what is usual at that range, less 1 (0 where a scan has none). Neighbourhoods are
    Gaussian, on a grid seen from above, and know ground points only.

    Args:
        cloud: Points of a scene, metres, z up. Where the sensor is unknown the origin stands for it.
        ground: Points that are asked about.
        usual: See :func:`~rm3d_plugin.pseudo_labels.common.sensor.range_normalised_intensity`.
        heading: Whether the sensor travels along x, as on vehicles: then sides are those of its path, else towards the
            sensor and away from it.
    """
    xyz = seen_from_sensor(cloud)
    heights = _above_plane(xyz, xyz[ground])
    x, y, _ = own = xyz[ground].T
    ranges, z = np.linalg.norm(own, axis=0), heights[ground]
    if not len(z):
        return GroundFeatures(np.zeros((0, 0), dtype=np.float32), heights)
    strength = intensity_of(cloud)
    bright = np.zeros(len(z))
    if strength is not None and len(usual.ranges):
        bright = brightness(strength[ground], ranges, usual) - 1.0
    grid = _Grid(np.column_stack([x, y]))
    sums = [grid.sums(values) for values in (np.ones(len(z)), bright, z, bright**2, z**2)]
    aside = np.abs(y) if heading else np.hypot(x, y)
    columns = [bright, np.log(np.maximum(ranges, 1e-3)), np.minimum(aside, WIDEST)]
    for scale in SCALES:
        blurred = [gaussian_filter(one, scale / CELL, truncate=_TRUNCATE, mode='constant') for one in sums]
        mass, *means = (one[grid.rows] for one in blurred)
        mean, height, squares, z_squares = (part / np.maximum(mass, 1e-9) for part in means)
        columns += [mean, _deviation(squares, mean), z - height]
        if scale in ROUGH_SCALES:
            columns.append(np.minimum(_deviation(z_squares, height), 0.3))
        if scale == SIDE_SCALE:
            columns.append(np.log(mass + 1e-3))
            beside = blurred[:3]
    outward = np.stack([np.zeros_like(y), np.where(y >= 0, 1.0, -1.0)]) if heading else own[:2] / np.maximum(aside, 0.1)
    for distance in (step for side in SIDES for step in (side, -side)):
        mass, mean, height = (grid.between(one, own[:2] + distance * outward) for one in beside)
        there = mass > 0.02
        for total, zero in ((height, z), (mean, 0.0)):
            columns.append(np.where(there, total / np.where(there, mass, 1.0) - zero, 0.0).clip(-0.5, 0.5))
    return GroundFeatures(np.stack(columns, axis=1).astype(np.float32), heights)


class _Grid:
    """Cells over ground points, seen from above."""

    def __init__(self, xy: Float[np.ndarray, 'ground 2']) -> None:
        self.low = xy.min(axis=0) - 1.0
        self.shape = tuple(((xy.max(axis=0) + 1.0 - self.low) / CELL).astype(int) + 1)
        self.rows: tuple[Int[np.ndarray, ' _ground'], ...] = tuple(((xy - self.low) / CELL).astype(int).T)

    def sums(self, values: Float[np.ndarray, ' ground']) -> Float[np.ndarray, 'x y']:
        cells = np.ravel_multi_index(self.rows, self.shape)
        return np.bincount(cells, values, minlength=int(np.prod(self.shape))).reshape(self.shape)

    def between(
        self, grid: Float[np.ndarray, 'x y'], xy: Float[np.ndarray, '2 ground']
    ) -> Float[np.ndarray, ' ground']:
        """Values between the middles of the cells; 0 outside."""
        return np.asarray(map_coordinates(grid, (xy - self.low[:, None]) / CELL - 0.5, order=1))


def _above_plane(
    xyz: Float[np.ndarray, 'points 3'], ground: Float[np.ndarray, 'ground 3']
) -> Float[np.ndarray, ' points']:
    """Height above a plane through most ground points (least squares, reweighted for Cauchy noise)."""
    if not len(ground):
        return xyz[:, 2]
    columns, weights = np.column_stack([ground[:, :2], np.ones(len(ground))]), np.ones(len(ground))
    for _ in range(8):
        plane = np.linalg.lstsq(columns * weights[:, None], ground[:, 2] * weights)[0]
        weights = 1.0 / (1.0 + ((ground[:, 2] - columns @ plane) / PLANE_NOISE) ** 2)
    return np.asarray(xyz[:, 2] - xyz[:, :2] @ plane[:2] - plane[2])


def _deviation(
    squares: Float[np.ndarray, ' ground'], mean: Float[np.ndarray, ' ground']
) -> Float[np.ndarray, ' ground']:
    return np.sqrt(np.maximum(squares - mean**2, 0.0))
