"""Point-SIFT: orientation encoding at several scales, trained by contrast (METHOD 3, Point-SIFT)."""

from typing import final

from rm3d_plugin.descriptors.learned.base import LearnedDescriptor
from rm3d_plugin.ops.site_histograms import WIDTH as HISTOGRAMS
from rm3d_plugin.ops.site_histograms import with_histograms
from rm3d_plugin.ops.sites import Sites, voxel_sites
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import PointCloud


@final
@DESCRIPTORS.register_module()
class PointSIFT(LearnedDescriptor):
    """Unit vectors of orientation-encoding units (Jiang et al., arXiv 1807.00652).

    Octants have the scan's axes, so that a turned scan is described otherwise, as far as training has not taught it
    better. Trained without labels by ``rm3d train pointsift_rooms`` or ``pointsift_streets``. The arguments are those
    of :class:`LearnedDescriptor`.
    """

    network_type = 'DescriptorNetwork'
    backbone_type = 'PointSIFTBackbone'
    in_channels = HISTOGRAMS

    def sites(self, cloud: PointCloud) -> Sites:
        """The voxels of the cloud, with the histograms of their points."""
        sites = voxel_sites(cloud.xyz, self.voxel_size)
        return with_histograms(sites, cloud.xyz, cloud.normals, cloud.sensor)
