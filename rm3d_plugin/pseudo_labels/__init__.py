"""Making labels: one scene in, labels out, and how good they are."""

from rm3d_plugin.pseudo_labels.common.annotated import AnnotatedLabels
from rm3d_plugin.pseudo_labels.common.quality import PseudoReport, SceneTruth, pseudo_report
from rm3d_plugin.pseudo_labels.common.refresh_result import RefreshResult
from rm3d_plugin.pseudo_labels.detection.objects import ObjectRules
from rm3d_plugin.pseudo_labels.detection.refresh import refresh_detection
from rm3d_plugin.pseudo_labels.segmentation.refresh import refresh_points

__all__ = [
    'ObjectRules',
    'PseudoReport',
    'RefreshResult',
    'SceneTruth',
    'AnnotatedLabels',
    'pseudo_report',
    'refresh_detection',
    'refresh_points',
]
