"""Heads: what is read from the features of points."""

from rm3d_plugin.models.heads.batch_labels import BatchLabels, FitPairs, ProposalTargets, join_labels
from rm3d_plugin.models.heads.box_iou_head import BoxIoUHead
from rm3d_plugin.models.heads.point_group_head import PointGroupHead
from rm3d_plugin.models.heads.point_labels import PointLabels, join_point_labels
from rm3d_plugin.models.heads.proposals import Instances, ProposalRules, find_instances
from rm3d_plugin.models.heads.scene_class_head import SceneClassHead
from rm3d_plugin.models.heads.semantic_head import SemanticHead
from rm3d_plugin.models.heads.vote_head import VoteHead, VoteOutput
from rm3d_plugin.models.heads.vote_targets import VoteTargets

__all__ = [
    'BatchLabels',
    'BoxIoUHead',
    'FitPairs',
    'Instances',
    'PointGroupHead',
    'PointLabels',
    'ProposalRules',
    'ProposalTargets',
    'SceneClassHead',
    'SemanticHead',
    'VoteHead',
    'VoteOutput',
    'VoteTargets',
    'find_instances',
    'join_labels',
    'join_point_labels',
]
