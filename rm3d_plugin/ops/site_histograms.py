"""How normals turn around a site: the mean histogram of its points (FPFH), which descriptors learn to read."""

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.ops.fpfh import BINS, fast_histograms
from rm3d_plugin.ops.normals import estimate_normals
from rm3d_plugin.ops.octree import Neighbors, Octree
from rm3d_plugin.ops.segment import segment_mean
from rm3d_plugin.ops.sites import CHANNELS, VOXEL, Sites
from rm3d_plugin.ops.viewpoint import virtual_viewpoint

REACH = 5.0 / VOXEL  # voxels: five distances between points, some eighty points of a surface
NORMAL_NEIGHBORS = 20
WIDTH = CHANNELS + BINS
CROWD = 64  # points of a site that count: usually two to three lie in it, and more cost the square of their number


def with_histograms(
    sites: Sites,
    xyz: Float[np.ndarray, 'points 3'],
    normals: Float[np.ndarray, 'points 3'] | None = None,
    viewpoint: Float[np.ndarray, '3'] | tuple[float, float, float] | None = None,
) -> Sites:
    """The sites with 33 further inputs: the root of the shares of FPFH's bins, the mean over the points of a site.

    Of a site with more than :data:`CROWD` points so many stand for all. Turning and moving the scan change nothing but
    by where the voxels lie, as long as its normals turn along.

    Args:
        sites: Of the scan.
        xyz: (N, 3) metres, its points.
        normals: Of the points; zero where there is none. None: they are estimated.
        viewpoint: Metres; estimated normals turn there. None: :func:`virtual_viewpoint`.
    """
    if not len(sites.places):
        return sites._replace(inputs=np.zeros((0, WIDTH), dtype=np.float32))
    kept = _thinned(xyz, sites.rows)
    points = np.ascontiguousarray(xyz[kept], dtype=np.float64)
    tree = Octree(points)
    if normals is None:
        seen_from = virtual_viewpoint(xyz) if viewpoint is None else np.asarray(viewpoint, dtype=np.float64)
        found = estimate_normals(points, NORMAL_NEIGHBORS, viewpoint=seen_from, octree=tree)
        normals = np.where(found.valid[:, None], found.normals, np.float32(0))
    else:
        normals = normals[kept]
    reach = max(REACH * sites.unit, 1e-12)

    def search(rows: Int[np.ndarray, ' some']) -> Neighbors:
        return tree.radius(points[rows], reach, None, ordered=False)

    shares = np.sqrt(fast_histograms(points, normals, tree, search).values / 100)
    means = segment_mean(shares, sites.rows[kept], len(sites.places)).astype(np.float32)
    return sites._replace(inputs=np.concatenate([sites.inputs, means], axis=1))


def _thinned(xyz: Float[np.ndarray, 'points 3'], site: Int[np.ndarray, ' points']) -> Int[np.ndarray, ' kept']:
    """All points, but of crowded sites :data:`CROWD` only, evenly from left to right; their order does not matter."""
    counts = np.bincount(site)
    if counts.max() <= CROWD:
        return np.arange(len(site))
    order = np.lexsort((*xyz.T[::-1], site))
    rank, count = np.arange(len(site)) - np.repeat(np.cumsum(counts) - counts, counts), np.repeat(counts, counts)
    chosen = (count <= CROWD) | ((rank + 1) * CROWD // count > rank * CROWD // count)
    return np.sort(order[chosen])
