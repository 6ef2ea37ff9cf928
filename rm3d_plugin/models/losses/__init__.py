"""Losses: a plain function each, a thin registered class with its weight, and the entries of a model's list.

``JSAugLoss``, ``MSEAugLoss``, ``DiceLoss``, ``OffsetLoss``, ``PointCrossEntropyLoss`` and ``SceneClassLoss`` compare
tensors and know no model. A :class:`LossTerm` says what of a batch they compare.
"""

from rm3d_plugin.models.losses.aug_loss import JSAugLoss, MSEAugLoss, js_aug_loss, js_divergence, mse_aug_loss
from rm3d_plugin.models.losses.box_overlap import BoxOverlap, overlap_loss
from rm3d_plugin.models.losses.circle import balanced_bce, circle_loss
from rm3d_plugin.models.losses.class_prototypes import ClassPrototypes, even_assignment, prototype_loss
from rm3d_plugin.models.losses.contrastive import contrastive_loss
from rm3d_plugin.models.losses.descriptor_contrast import (
    hardest_contrastive_loss,
    info_nce_loss,
    pair_loss,
    triplet_loss,
)
from rm3d_plugin.models.losses.dice_loss import DiceLoss, dice_loss
from rm3d_plugin.models.losses.divergences import (
    CONVENTIONS,
    Convention,
    DivergenceLoss,
    divergence,
    soft_cross_entropy,
)
from rm3d_plugin.models.losses.graph_contrast import GraphContrast, border_weights, graph_contrast_loss
from rm3d_plugin.models.losses.instance_dice import InstanceDice
from rm3d_plugin.models.losses.instance_offsets import InstanceOffsets
from rm3d_plugin.models.losses.loss_term import LossTerm
from rm3d_plugin.models.losses.offset_loss import OffsetLoss, offset_loss
from rm3d_plugin.models.losses.pair_circle import PairCircle
from rm3d_plugin.models.losses.pair_contrast import PairContrast
from rm3d_plugin.models.losses.point_cross_entropy import PointCrossEntropyLoss, class_weights, point_cross_entropy
from rm3d_plugin.models.losses.proposal_dice import ProposalDice
from rm3d_plugin.models.losses.reduction import ReducedLoss, Reduction, reduce_loss
from rm3d_plugin.models.losses.scene_class_loss import SceneClassLoss, scene_class_loss
from rm3d_plugin.models.losses.scene_classes import SceneClasses
from rm3d_plugin.models.losses.scheduled_loss import ScheduledLoss
from rm3d_plugin.models.losses.site_classes import SiteClasses
from rm3d_plugin.models.losses.view_consistency import ViewConsistency
from rm3d_plugin.models.losses.view_supervision import ViewSupervision, labels_of_rows
from rm3d_plugin.models.losses.votenet_loss import VoteNetLoss
from rm3d_plugin.models.losses.weak_supervision import WeakSupervision

__all__ = [
    'CONVENTIONS',
    'Convention',
    'BoxOverlap',
    'ClassPrototypes',
    'DiceLoss',
    'DivergenceLoss',
    'GraphContrast',
    'InstanceDice',
    'InstanceOffsets',
    'JSAugLoss',
    'LossTerm',
    'MSEAugLoss',
    'OffsetLoss',
    'PairCircle',
    'PairContrast',
    'PointCrossEntropyLoss',
    'ProposalDice',
    'ReducedLoss',
    'Reduction',
    'SceneClassLoss',
    'SceneClasses',
    'ScheduledLoss',
    'SiteClasses',
    'ViewConsistency',
    'ViewSupervision',
    'VoteNetLoss',
    'WeakSupervision',
    'balanced_bce',
    'border_weights',
    'circle_loss',
    'class_weights',
    'contrastive_loss',
    'dice_loss',
    'divergence',
    'graph_contrast_loss',
    'even_assignment',
    'hardest_contrastive_loss',
    'info_nce_loss',
    'js_aug_loss',
    'js_divergence',
    'labels_of_rows',
    'mse_aug_loss',
    'offset_loss',
    'overlap_loss',
    'pair_loss',
    'point_cross_entropy',
    'prototype_loss',
    'reduce_loss',
    'scene_class_loss',
    'soft_cross_entropy',
    'triplet_loss',
]
