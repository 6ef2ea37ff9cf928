"""Making labels: one scene in, labels out, and how good they are."""

from rm3d_plugin.pseudo_labels.objects import ObjectRules
from rm3d_plugin.pseudo_labels.quality import PseudoReport, SceneTruth, pseudo_report
from rm3d_plugin.pseudo_labels.refresh_detection import refresh_detection
from rm3d_plugin.pseudo_labels.refresh_points import refresh_points
from rm3d_plugin.pseudo_labels.refresh_result import RefreshResult
from rm3d_plugin.pseudo_labels.weak import WeakLabels

__all__ = [
    'ObjectRules',
    'PseudoReport',
    'RefreshResult',
    'SceneTruth',
    'WeakLabels',
    'pseudo_report',
    'refresh_detection',
    'refresh_points',
]
