"""What a learned descriptor sees of a scan: one site a voxel, in units of voxels, and how its surroundings look."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.ops.geometric_features import geometric_features
from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.ops.scan_scale import scan_spacing
from rm3d_plugin.ops.segment import segment_mean
from rm3d_plugin.ops.voxel_grid import close_gaps, voxel_grid

VOXEL = 1.6  # distances between points that a voxel is wide: on a surface two to three points share one
LOOKS = (8, 32)  # nearest sites of each look at the surroundings
CHANNELS = 3 * len(LOOKS) + 1
PATCH = 8  # sites that a described one needs nearby
NEARBY = 10.0  # voxels
WIDEST = 60_000  # voxels along an axis, within what sparse convolutions count


class Sites(NamedTuple):
    """Where a scan is described.

    Attributes:
        places: (M, 3) float32 in units; one site a row.
        inputs: (M, C) float32 what the network sees of each.
        valid: (M,) False where there is too little around a site to describe it.
        rows: (N,) int64 site of each point of the scan.
        unit: Metres.
    """

    places: Float[np.ndarray, 'sites 3']
    inputs: Float[np.ndarray, 'sites channels']
    valid: Bool[np.ndarray, ' sites']
    rows: Int[np.ndarray, ' points']
    unit: float


def voxel_size_of(xyz: Float[np.ndarray, 'points 3']) -> float:
    """Edge of a voxel that suits a scan, metres: :data:`VOXEL` distances between its points, whatever the sensor.

    BUFFER-X (Seo et al., ICCV 2025) takes its lengths from the data, too, so that no number of a sensor is left.
    """
    return VOXEL * scan_spacing(xyz)


def voxel_sites(xyz: Float[np.ndarray, 'points 3'], voxel_size: float | None = None) -> Sites:
    """One site for each occupied voxel.

    Inputs are linearity, planarity and scattering among the nearest 8 and 32 sites, and a one: turning the scan
    changes them by where the voxels lie alone. The voxels begin at the least coordinates, so moving it changes nothing.

    Args:
        xyz: (N, 3) metres.
        voxel_size: Metres, the unit; None: :func:`voxel_size_of` the scan, doubled until it is at most
            :data:`WIDEST` voxels wide.

    Returns:
        Places are the middles of voxels, in voxels. No site where there is no point; one that is not valid where all
        points share one place.

    Raises:
        ValueError: More than :data:`WIDEST` voxels of the given size are occupied along an axis.
    """
    unit = voxel_size_of(xyz) if voxel_size is None else voxel_size
    if len(xyz) == 0 or not unit > 0:
        return _nothing(len(xyz), unit)
    points = _in_units(xyz, unit)
    while (width := _occupied_width(points)) > WIDEST:
        if voxel_size is not None:
            raise ValueError(f'the scan is {width} voxels of {unit:g} m wide, at most {WIDEST}; pass a larger voxel')
        unit *= 2.0
        points = _in_units(xyz, unit)
    grid = voxel_grid(points, 1.0)
    coords, rows = close_gaps(grid.coords, WIDEST), grid.point_to_voxel
    middles = segment_mean(points, rows, len(coords))
    inputs, valid = _looks(middles)
    return Sites((coords + 0.5).astype(np.float32), inputs, valid, rows, unit)


def _in_units(xyz: Float[np.ndarray, 'points 3'], unit: float) -> Float[np.ndarray, 'points 3']:
    points = xyz.astype(np.float64) / unit
    return np.asarray(points - points.min(axis=0))


def _occupied_width(points: Float[np.ndarray, 'points 3']) -> int:
    """Voxels along the longest axis; empty stretches count as one where there are more than :data:`WIDEST`."""
    return int(close_gaps(np.floor(points).astype(np.int64) + 1, WIDEST).max())


def _looks(
    middles: Float[np.ndarray, 'sites 3'],
) -> tuple[Float[np.ndarray, 'sites channels'], Bool[np.ndarray, ' sites']]:
    tree = Octree(middles)
    columns = [geometric_features(middles, k, tree).values[:, :3] for k in LOOKS]
    ones = np.ones((len(middles), 1), dtype=np.float32)
    farthest = tree.knn(middles, PATCH + 1).sq_dists[:, -1]  # infinite where there are fewer
    return np.concatenate([*columns, ones], axis=1), farthest <= NEARBY**2


def _nothing(points: int, unit: float) -> Sites:
    sites = min(points, 1)
    places, inputs = np.zeros((sites, 3), dtype=np.float32), np.zeros((sites, CHANNELS), dtype=np.float32)
    return Sites(places, inputs, np.zeros(sites, dtype=bool), np.zeros(points, dtype=np.int64), unit)
