"""Making labels: one scene in, labels out."""

from rm3d_plugin.pseudo_labels.common.annotated import AnnotatedLabels
from rm3d_plugin.pseudo_labels.common.inputs import PointPrediction, RoundContext, SceneInputs
from rm3d_plugin.pseudo_labels.common.refresh_result import RefreshResult
from rm3d_plugin.pseudo_labels.common.self_training import SelfTrainingRules
from rm3d_plugin.pseudo_labels.detection.refresh import ObjectKnowledge, refresh_detection
from rm3d_plugin.pseudo_labels.detection.rules import DetectionRules, ObjectRules, TeacherRules, detection_rules
from rm3d_plugin.pseudo_labels.ground.rules import GroundRules
from rm3d_plugin.pseudo_labels.region_prior.rules import RegionPriorRules
from rm3d_plugin.pseudo_labels.segmentation.propagation import PropagationRules
from rm3d_plugin.pseudo_labels.segmentation.refresh import SceneKnowledge, refresh_segmentation
from rm3d_plugin.pseudo_labels.segmentation.rules import SegmentationRules, segmentation_rules

__all__ = [
    'AnnotatedLabels',
    'DetectionRules',
    'GroundRules',
    'ObjectKnowledge',
    'ObjectRules',
    'PointPrediction',
    'PropagationRules',
    'RefreshResult',
    'RegionPriorRules',
    'RoundContext',
    'SceneInputs',
    'SceneKnowledge',
    'SegmentationRules',
    'SelfTrainingRules',
    'TeacherRules',
    'detection_rules',
    'refresh_detection',
    'refresh_segmentation',
    'segmentation_rules',
]
