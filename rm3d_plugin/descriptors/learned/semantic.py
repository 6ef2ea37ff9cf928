"""Classes of other scans as a descriptor: what a network that was taught them says just before it names one."""

from typing import final

from rm3d_plugin.descriptors.learned.base import LearnedDescriptor
from rm3d_plugin.ops.site_heights import HEIGHTS, upright_sites
from rm3d_plugin.ops.site_histograms import WIDTH as HISTOGRAMS
from rm3d_plugin.ops.sites import Sites
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import PointCloud


@final
@DESCRIPTORS.register_module()
class Semantic(LearnedDescriptor):
    """Unit vectors of a sparse U-Net that tells the classes of labelled scans apart; not of the paper.

    Other scans have other classes, so its last layer is left out. It sees shapes alone, no colour and no intensity,
    and takes z for up and a unit for a metre. Trained by ``rm3d train semantic_both``: the weights of the package are
    from synthetic scans, whose labels cost nothing. The arguments are those of :class:`LearnedDescriptor`.
    """

    network_type = 'DescriptorNetwork'
    in_channels = HISTOGRAMS + HEIGHTS

    def sites(self, cloud: PointCloud) -> Sites:
        """The voxels of the cloud, with histograms and heights."""
        return upright_sites(cloud.xyz, self.voxel_size)
