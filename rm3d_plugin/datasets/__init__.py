"""One reader a data set; items are pure functions of (seed, epoch, index)."""

from rm3d_plugin.datasets import samplers as samplers
from rm3d_plugin.datasets import transforms as transforms
from rm3d_plugin.datasets.base import DatasetNotFoundError, SceneDataset, Truth
from rm3d_plugin.datasets.kitti import KittiDataset

__all__ = ['DatasetNotFoundError', 'KittiDataset', 'SceneDataset', 'Truth', 'samplers', 'transforms']
