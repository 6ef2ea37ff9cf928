"""One reader a data set; items are pure functions of (seed, epoch, index)."""

from rm3d_plugin.datasets import samplers as samplers
from rm3d_plugin.datasets import transforms as transforms
from rm3d_plugin.datasets.base import DatasetNotFoundError, SceneDataset, Truth
from rm3d_plugin.datasets.box_files import BoxFilesDataset
from rm3d_plugin.datasets.boxes import BoxDataset
from rm3d_plugin.datasets.files import FilesDataset
from rm3d_plugin.datasets.instance_boxes import InstanceBoxDataset
from rm3d_plugin.datasets.joined import JoinedScenes
from rm3d_plugin.datasets.kitti import KittiDataset
from rm3d_plugin.datasets.oakland import OaklandDataset
from rm3d_plugin.datasets.other_classes import OtherClassesDataset
from rm3d_plugin.datasets.s3dis import S3DISDataset
from rm3d_plugin.datasets.scannet import ScanNetDataset
from rm3d_plugin.datasets.segmentation import SegmentationDataset
from rm3d_plugin.datasets.semantic3d import Semantic3DDataset
from rm3d_plugin.datasets.semantickitti import SemanticKittiDataset
from rm3d_plugin.datasets.vkitti import VKITTI3DDataset
from rm3d_plugin.datasets.waymo import WaymoDataset

__all__ = [
    'BoxDataset',
    'BoxFilesDataset',
    'DatasetNotFoundError',
    'FilesDataset',
    'InstanceBoxDataset',
    'JoinedScenes',
    'KittiDataset',
    'OaklandDataset',
    'OtherClassesDataset',
    'S3DISDataset',
    'ScanNetDataset',
    'SceneDataset',
    'SegmentationDataset',
    'Semantic3DDataset',
    'SemanticKittiDataset',
    'Truth',
    'VKITTI3DDataset',
    'WaymoDataset',
    'samplers',
    'transforms',
]
