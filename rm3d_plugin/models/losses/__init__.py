"""Losses: a plain function each, and a thin registered class that holds its weight."""

from rm3d_plugin.models.losses.aug_loss import JSAugLoss, MSEAugLoss, js_aug_loss, js_divergence, mse_aug_loss
from rm3d_plugin.models.losses.dice_loss import DiceLoss, dice_loss
from rm3d_plugin.models.losses.offset_loss import OffsetLoss, offset_loss
from rm3d_plugin.models.losses.point_cross_entropy import PointCrossEntropyLoss, class_balance, point_cross_entropy
from rm3d_plugin.models.losses.scene_class_loss import SceneClassLoss, scene_class_loss

__all__ = [
    'DiceLoss',
    'JSAugLoss',
    'MSEAugLoss',
    'OffsetLoss',
    'PointCrossEntropyLoss',
    'SceneClassLoss',
    'class_balance',
    'dice_loss',
    'js_aug_loss',
    'js_divergence',
    'mse_aug_loss',
    'offset_loss',
    'point_cross_entropy',
    'scene_class_loss',
]
