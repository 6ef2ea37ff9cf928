"""Metrics as plain functions: numpy in, named results out."""

from rm3d_plugin.evaluation.functional.boundary import (
    BoundaryCounts,
    BoundaryScores,
    boundary_counts,
    boundary_scores,
    scores_of,
)
from rm3d_plugin.evaluation.functional.box_ap import BoxAp, box_ap
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

__all__ = [
    'DIFFICULTIES',
    'LOOSE_IOU',
    'METRICS',
    'OFFICIAL_IOU',
    'ApEntry',
    'BoundaryCounts',
    'BoundaryScores',
    'BoxAp',
    'KittiAp',
    'KittiDetections',
    'KittiTruth',
    'boundary_counts',
    'boundary_scores',
    'box_ap',
    'kitti_ap',
    'scores_of',
]
