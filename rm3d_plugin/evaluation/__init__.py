"""Metrics: registered shells over the plain functions of ``functional``."""

from rm3d_plugin.evaluation.indoor_det_metric import IndoorDetMetric
from rm3d_plugin.evaluation.instance_seg_metric import InstanceSegMetric
from rm3d_plugin.evaluation.kitti_metric import KittiMetric
from rm3d_plugin.evaluation.overseg_metric import OversegMetric
from rm3d_plugin.evaluation.panoptic_quality import PanopticQuality
from rm3d_plugin.evaluation.pseudo_label_metric import PseudoLabelMetric
from rm3d_plugin.evaluation.records import RecordedMetric, ScoreRecord, records_of
from rm3d_plugin.evaluation.s3dis_instance_metric import S3DISInstanceMetric
from rm3d_plugin.evaluation.sem_seg_metric import SemSegMetric
from rm3d_plugin.evaluation.unlabelled_sem_seg_metric import UnlabelledSemSegMetric
from rm3d_plugin.evaluation.waymo_metric import WaymoMetric

__all__ = [
    'IndoorDetMetric',
    'InstanceSegMetric',
    'KittiMetric',
    'OversegMetric',
    'PanopticQuality',
    'PseudoLabelMetric',
    'RecordedMetric',
    'S3DISInstanceMetric',
    'ScoreRecord',
    'SemSegMetric',
    'UnlabelledSemSegMetric',
    'WaymoMetric',
    'records_of',
]
