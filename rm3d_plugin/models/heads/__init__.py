"""Heads: what is read from the features of points."""

from rm3d_plugin.models.heads.batch_labels import BatchLabels, join_labels
from rm3d_plugin.models.heads.scene_class_head import SceneClassHead
from rm3d_plugin.models.heads.vote_head import VoteHead, VoteOutput
from rm3d_plugin.models.heads.vote_targets import ProposalTargets, VoteTargets

__all__ = [
    'BatchLabels',
    'ProposalTargets',
    'SceneClassHead',
    'VoteHead',
    'VoteOutput',
    'VoteTargets',
    'join_labels',
]
