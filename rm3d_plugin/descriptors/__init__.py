"""One descriptor a file: points in, one feature vector a point out (METHOD 3). Importing the package registers them."""

from rm3d_plugin.descriptors.adapted_pfh import AdaptedPFH, adapted_pfh
from rm3d_plugin.descriptors.base import Descriptor, cloud_normals, cosine_similarity
from rm3d_plugin.descriptors.external import External
from rm3d_plugin.descriptors.fpfh import FPFH, fpfh
from rm3d_plugin.descriptors.hks import HKS, heat_kernel_signature
from rm3d_plugin.descriptors.learned import (
    Contrastive,
    LearnedDescriptor,
    PointSIFT,
    Predator,
    Semantic,
    SupervisedSuperpoint,
)
from rm3d_plugin.descriptors.pfh import PFH, original_pfh
from rm3d_plugin.descriptors.shot import SHOT, shot
from rm3d_plugin.descriptors.sihks import SIHKS, scale_invariant_heat_kernel_signature
from rm3d_plugin.descriptors.spectral import SpectralDescriptor
from rm3d_plugin.descriptors.superpoint_graph import SuperpointGraph
from rm3d_plugin.descriptors.turned_scene import TurnedScene
from rm3d_plugin.descriptors.vccs import VCCS
from rm3d_plugin.descriptors.visual_similarity import LightFields, VisualSimilarity, light_fields
from rm3d_plugin.descriptors.wks import WKS, wave_kernel_signature

__all__ = [
    'FPFH',
    'HKS',
    'PFH',
    'SHOT',
    'SIHKS',
    'VCCS',
    'WKS',
    'AdaptedPFH',
    'Contrastive',
    'Descriptor',
    'External',
    'LearnedDescriptor',
    'LightFields',
    'PointSIFT',
    'Predator',
    'Semantic',
    'SpectralDescriptor',
    'SuperpointGraph',
    'SupervisedSuperpoint',
    'TurnedScene',
    'VisualSimilarity',
    'adapted_pfh',
    'cloud_normals',
    'cosine_similarity',
    'fpfh',
    'heat_kernel_signature',
    'light_fields',
    'original_pfh',
    'scale_invariant_heat_kernel_signature',
    'shot',
    'wave_kernel_signature',
]
