"""Where a site is: how high, how upright its surface, how dense the scan; z points up, lengths are metres."""

import numpy as np
from jaxtyping import Float
from scipy.ndimage import minimum_filter

from rm3d_plugin.ops.normals import estimate_normals
from rm3d_plugin.ops.site_histograms import with_histograms
from rm3d_plugin.ops.sites import Sites, voxel_sites

HEIGHTS = 4  # inputs
CELL = 1.0  # m, columns in which the lowest site is looked for
COLUMNS = 5  # of them, side by side, in each direction
STOREY = 3.0  # m that count as one
HIGHEST = 4.0  # storeys; higher up all is alike
FLOOR_PERCENT = 1.0  # of the sites lie below the floor
NORMAL_NEIGHBORS = 12
USUAL_UNIT = 0.05  # m
MOST_CELLS = 1 << 22  # wider scans get wider columns


def upright_sites(xyz: Float[np.ndarray, 'points 3'], voxel_size: float | None = None) -> Sites:
    """Sites with histograms and heights: what a network of classes sees of a scan whose z points up.

    Normals turn to the scan's own viewpoint, wherever its sensor stood.

    Args:
        xyz: (N, 3) metres.
        voxel_size: Metres; None: by the distance between the points.
    """
    return with_heights(with_histograms(voxel_sites(xyz, voxel_size), xyz))


def with_heights(sites: Sites) -> Sites:
    """The sites with four further inputs: z points up, and lengths are metres.

    Height over the lowest site within two columns of about 1 m, height over the floor (both in storeys of 3 m, at most
    4, at least -1), how far the normal points up or down, and the logarithm of the unit. Turning the scan about z
    changes them by where the voxels lie alone.

    Args:
        sites: Of :func:`~rm3d_plugin.ops.sites.voxel_sites`.
    """
    count = len(sites.places)
    if not count:
        return sites._replace(inputs=np.zeros((0, sites.inputs.shape[1] + HEIGHTS), dtype=np.float32))
    z = sites.places[:, 2].astype(np.float64) * sites.unit
    found = estimate_normals(sites.places.astype(np.float64), NORMAL_NEIGHBORS)  # of middles of voxels: exact
    columns = [
        np.clip((z - _lowest_nearby(sites)) / STOREY, -1.0, HIGHEST),
        np.clip((z - np.percentile(z, FLOOR_PERCENT)) / STOREY, -1.0, HIGHEST),
        np.where(found.valid, np.abs(found.normals[:, 2]), 0.0),
        np.full(count, np.log(max(sites.unit, 1e-12) / USUAL_UNIT) / STOREY),
    ]
    return sites._replace(inputs=np.column_stack([sites.inputs, *columns]).astype(np.float32))


def _lowest_nearby(sites: Sites) -> Float[np.ndarray, ' sites']:
    """Lowest z of the columns around each site, metres; columns are whole voxels wide, so that rounding moves none.

    Sites that have too little around them do not count: single returns from below the ground. Where no other is near,
    it is the site's own.
    """
    places = np.floor(sites.places[:, :2]).astype(np.int64)
    places -= places.min(axis=0)
    wide = places.max(axis=0) + 1.0
    least = max(np.sqrt(wide.prod() / MOST_CELLS), wide.max() / MOST_CELLS)  # voxels
    cells = places // max(round(CELL / max(sites.unit, 1e-12)), int(np.ceil(least)), 1)
    lowest = np.full(cells.max(axis=0) + 1, np.inf)
    z = sites.places[:, 2].astype(np.float64) * sites.unit
    np.minimum.at(lowest, tuple(cells[sites.valid].T), z[sites.valid])
    found = minimum_filter(lowest, COLUMNS, mode='nearest')[tuple(cells.T)]
    return np.where(np.isfinite(found), found, z)
