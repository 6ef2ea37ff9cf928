"""Metrics as plain functions: numpy in, named results out."""

from rm3d_plugin.evaluation.functional.boundary import (
    BoundaryCounts,
    BoundaryScores,
    boundary_counts,
    boundary_scores,
    scores_of,
)
from rm3d_plugin.evaluation.functional.box_ap import BoxAp, box_ap
from rm3d_plugin.evaluation.functional.instance_ap import InstanceAp, instance_ap
from rm3d_plugin.evaluation.functional.instance_overlap import InstanceOverlap, instance_overlap
from rm3d_plugin.evaluation.functional.instance_precision_recall import (
    InstancePrecisionRecall,
    instance_precision_recall,
)
from rm3d_plugin.evaluation.functional.kitti_ap import (
    DIFFICULTIES,
    LOOSE_IOU,
    METRICS,
    OFFICIAL_IOU,
    ApEntry,
    KittiAp,
    KittiDetections,
    KittiTruth,
    kitti_ap,
)
from rm3d_plugin.evaluation.functional.offset_error import OffsetError, instance_centres, offset_error
from rm3d_plugin.evaluation.functional.panoptic_quality import (
    PanopticCounts,
    PanopticScores,
    panoptic_counts,
    panoptic_scores,
)
from rm3d_plugin.evaluation.functional.pseudo_label_counts import (
    BoxMatch,
    PseudoLabelCounts,
    SceneTruth,
    count_pseudo_labels,
)
from rm3d_plugin.evaluation.functional.pseudo_label_scores import PseudoLabelScores, pseudo_label_scores
from rm3d_plugin.evaluation.functional.semantic_iou import (
    SemanticScores,
    confusion_counts,
    semantic_iou,
    semantic_scores,
)
from rm3d_plugin.evaluation.functional.waymo_ap import WAYMO_IOU, WaymoEntry, WaymoTruth, waymo_ap

__all__ = [
    'DIFFICULTIES',
    'LOOSE_IOU',
    'METRICS',
    'OFFICIAL_IOU',
    'WAYMO_IOU',
    'ApEntry',
    'BoundaryCounts',
    'BoundaryScores',
    'BoxAp',
    'BoxMatch',
    'InstanceAp',
    'InstanceOverlap',
    'InstancePrecisionRecall',
    'KittiAp',
    'KittiDetections',
    'KittiTruth',
    'OffsetError',
    'PanopticCounts',
    'PanopticScores',
    'PseudoLabelCounts',
    'PseudoLabelScores',
    'SceneTruth',
    'SemanticScores',
    'WaymoEntry',
    'WaymoTruth',
    'boundary_counts',
    'boundary_scores',
    'box_ap',
    'confusion_counts',
    'count_pseudo_labels',
    'instance_ap',
    'instance_centres',
    'instance_overlap',
    'instance_precision_recall',
    'kitti_ap',
    'offset_error',
    'panoptic_counts',
    'panoptic_scores',
    'pseudo_label_scores',
    'scores_of',
    'semantic_iou',
    'semantic_scores',
    'waymo_ap',
]
