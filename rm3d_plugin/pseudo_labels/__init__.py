"""Making labels: one scene in, labels out."""

from rm3d_plugin.pseudo_labels.common.annotated import AnnotatedLabels
from rm3d_plugin.pseudo_labels.common.refresh_result import RefreshResult
from rm3d_plugin.pseudo_labels.detection.objects import ObjectRules
from rm3d_plugin.pseudo_labels.detection.refresh import refresh_detection
from rm3d_plugin.pseudo_labels.segmentation.refresh import refresh_points

__all__ = [
    'ObjectRules',
    'RefreshResult',
    'AnnotatedLabels',
    'refresh_detection',
    'refresh_points',
]
