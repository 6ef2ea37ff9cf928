"""One descriptor a file: points in, one feature vector a point out (METHOD 3). Importing the package registers them."""

from rm3d_plugin.descriptors.adapted_pfh import AdaptedPFH, adapted_pfh
from rm3d_plugin.descriptors.base import Descriptor, cloud_normals, cosine_similarity, region_means
from rm3d_plugin.descriptors.fpfh import FPFH, fpfh
from rm3d_plugin.descriptors.pfh import PFH, original_pfh
from rm3d_plugin.descriptors.shot import SHOT, shot
from rm3d_plugin.descriptors.superpoint_graph import SuperpointGraph

__all__ = [
    'FPFH',
    'PFH',
    'SHOT',
    'AdaptedPFH',
    'Descriptor',
    'SuperpointGraph',
    'adapted_pfh',
    'cloud_normals',
    'cosine_similarity',
    'fpfh',
    'original_pfh',
    'region_means',
    'shot',
]
