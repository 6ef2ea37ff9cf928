"""Scenes as learned descriptors see them: one site a voxel, in units of the scan's own density."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.datasets.transforms.augmented_view import View
from rm3d_plugin.ops.site_histograms import with_histograms
from rm3d_plugin.ops.sites import Sites, voxel_sites
from rm3d_plugin.registry import TRANSFORMS


def site_ids(
    point_ids: Int[np.ndarray, ' view'], own: Int[np.ndarray, ' view'], first: Int[np.ndarray, ' points']
) -> Int[np.ndarray, ' sites']:
    """For each site of a view the site of the scene in which its first copied point lies; -1 where none is a copy.

    Args:
        point_ids: (m,) the scene's point that each of the view is a copy of, -1 = none.
        own: (m,) site of the view's points.
        first: (n,) site of the scene's points.
    """
    out = np.full(int(own.max(initial=-1)) + 1, -1, dtype=np.int64)
    copies = np.flatnonzero(point_ids >= 0)[::-1]  # the first of a site is written last
    out[own[copies]] = first[point_ids[copies]]
    return out


@TRANSFORMS.register_module()
class VoxelUnits:
    """The scene and its views become sites, each in units of its own voxels, as a learned descriptor takes a scan.

    Comes last before PackScene. Points become places (in voxels) and what
    :func:`~rm3d_plugin.ops.sites.voxel_sites` tells of them; other columns are left out.

    Args:
        voxel_size: Metres; None: by the distance between the points of each.
        histograms: Whether sites tell how normals turn around them, too (:func:`with_histograms`).
    """

    def __init__(self, voxel_size: float | None = None, histograms: bool = False) -> None:
        self.voxel_size, self.histograms = voxel_size, histograms

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Find the sites of the scene and of each view."""
        sites = self._sites(results['points'], results.get('viewpoint'))
        views = []
        for view in results.get('views', ()):
            seen = self._sites(view.points, view.viewpoint)
            views.append(View(_columns(seen), site_ids(view.point_ids, seen.rows, sites.rows)))
        first = np.unique(sites.rows, return_index=True)[1]
        return results | {'points': _columns(sites), 'views': views, 'point_index': results['point_index'][first]}

    def _sites(self, points: Float[np.ndarray, 'n channels'], viewpoint: Float[np.ndarray, '3'] | None) -> Sites:
        sites = voxel_sites(points[:, :3], self.voxel_size)
        return with_histograms(sites, points[:, :3], None, viewpoint) if self.histograms else sites


def _columns(sites: Sites) -> np.ndarray:
    return np.concatenate([sites.places, sites.inputs], axis=1)
