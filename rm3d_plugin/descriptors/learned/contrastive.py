"""The paper's own learned descriptor: a sparse U-Net trained by contrast (METHOD 3, Contrastive)."""

from typing import final

from rm3d_plugin.descriptors.learned.base import LearnedDescriptor
from rm3d_plugin.ops.site_histograms import WIDTH as HISTOGRAMS
from rm3d_plugin.ops.site_histograms import with_histograms
from rm3d_plugin.ops.sites import Sites, voxel_sites
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import PointCloud


@final
@DESCRIPTORS.register_module()
class Contrastive(LearnedDescriptor):
    """Unit vectors of a sparse U-Net for which the same place in two crops is near, and places apart are far.

    Trained without labels by ``rm3d train contrastive_rooms`` or ``contrastive_streets``. The arguments are those of
    :class:`LearnedDescriptor`.
    """

    network_type = 'DescriptorNetwork'
    in_channels = HISTOGRAMS

    def sites(self, cloud: PointCloud) -> Sites:
        """The voxels of the cloud, with the histograms of their points."""
        sites = voxel_sites(cloud.xyz, self.voxel_size)
        return with_histograms(sites, cloud.xyz, cloud.normals, cloud.sensor)
