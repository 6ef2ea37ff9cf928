"""Supervised superpoints: embeddings that change where objects end (METHOD 3, S-SPG)."""

from typing import final

from rm3d_plugin.descriptors.learned.base import LearnedDescriptor
from rm3d_plugin.ops.sites import CHANNELS, Sites, voxel_sites
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import PointCloud


@final
@DESCRIPTORS.register_module()
class SupervisedSuperpoint(LearnedDescriptor):
    """Unit vectors of four values that are alike within an object and differ across its border.

    Landrieu and Boussaha (CVPR 2019); their superpoints are ``CutPursuit`` with ``xyz_weight=0.2`` on these. It
    learns from labels: of points, or regions that have taken theirs (``rm3d train superpoint_rooms``).
    The arguments are those of :class:`LearnedDescriptor`.
    """

    network_type = 'DescriptorNetwork'
    backbone_type = 'LocalCloudEmbedder'
    in_channels = CHANNELS

    def sites(self, cloud: PointCloud) -> Sites:
        """The voxels of the cloud."""
        return voxel_sites(cloud.xyz, self.voxel_size)
