"""Networks, heads and losses: everything that learns from labels."""

from rm3d_plugin.models import backbones, consistency, descriptors, detectors, heads, losses, segmentors
from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.consistency import Teacher, View
from rm3d_plugin.models.losses import LossTerm
from rm3d_plugin.models.outputs import DetectorOutput, PointOutput, SegmentorOutput
from rm3d_plugin.models.point_model import PointModel
from rm3d_plugin.models.preprocessor import ScenePreprocessor, join_scenes

__all__ = [
    'Batch',
    'DetectorOutput',
    'LossTerm',
    'PointModel',
    'PointOutput',
    'ScenePreprocessor',
    'SegmentorOutput',
    'Teacher',
    'View',
    'backbones',
    'consistency',
    'descriptors',
    'detectors',
    'heads',
    'join_scenes',
    'losses',
    'segmentors',
]
