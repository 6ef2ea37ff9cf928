"""Predator as a descriptor: each part of a cloud is its own other crop (METHOD 3, Predator)."""

from typing import final

from rm3d_plugin.descriptors.learned.base import LearnedDescriptor
from rm3d_plugin.ops.site_histograms import WIDTH as HISTOGRAMS
from rm3d_plugin.ops.site_histograms import with_histograms
from rm3d_plugin.ops.sites import Sites, voxel_sites
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import PointCloud


@final
@DESCRIPTORS.register_module()
class Predator(LearnedDescriptor):
    """Unit vectors of a sparse U-Net with overlap attention (Huang et al., CVPR 2021).

    Trained without labels by ``rm3d train predator_rooms`` or ``predator_streets``. The cubes in which a cloud is
    described are part of the descriptor and begin at its least coordinates; ``max_sites`` changes nothing. The
    arguments are those of :class:`LearnedDescriptor`.
    """

    network_type = 'PredatorNetwork'
    blocks = True
    in_channels = HISTOGRAMS

    def sites(self, cloud: PointCloud) -> Sites:
        """The voxels of the cloud, with the histograms of their points."""
        sites = voxel_sites(cloud.xyz, self.voxel_size)
        return with_histograms(sites, cloud.xyz, cloud.normals, cloud.sensor)
