"""Backbones: per-point features from raw points."""

from rm3d_plugin.models.backbones.local_cloud_embedder import LocalCloudEmbedder as LocalCloudEmbedder
from rm3d_plugin.models.backbones.point_sift import PointSIFTBackbone as PointSIFTBackbone
from rm3d_plugin.models.backbones.sparse_unet import SparseUNet as SparseUNet
