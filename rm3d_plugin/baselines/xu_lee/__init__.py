"""Siamese, inexact and smoothness losses, and propagation at test time, of Xu and Lee."""

from rm3d_plugin.baselines.method import method
from rm3d_plugin.baselines.xu_lee.losses import XuLeeLoss, inexact_loss, smoothness_loss
from rm3d_plugin.baselines.xu_lee.propagation import XuLeePropagation, propagated

SIAMESE = {
    'type': 'ViewConsistency',
    'loss': {'type': 'DivergenceLoss', 'convention': 'xu_lee', 'loss_weight': 10.0},
}
PARTS = {
    'aug_prob': 1.0,
    'aug_loss': None,
    'method_loss': {'type': 'ScheduledLoss', 'start': 0.5, 'losses': [SIAMESE, {'type': 'XuLeeLoss'}]},
    'model.refine': {'type': 'XuLeePropagation'},
}
XU_LEE = method('xu_lee', 'Xu and Lee', {'sem': PARTS}, declares=('second view',))

__all__ = ['XU_LEE', 'XuLeeLoss', 'XuLeePropagation', 'inexact_loss', 'propagated', 'smoothness_loss']
