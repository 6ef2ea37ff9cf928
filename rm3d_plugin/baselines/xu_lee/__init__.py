"""Siamese, inexact and smoothness losses, and propagation at test time, of Xu and Lee."""

from rm3d_plugin.baselines.base import Baseline
from rm3d_plugin.baselines.xu_lee.losses import XuLeeLoss, inexact_loss, smoothness_loss
from rm3d_plugin.baselines.xu_lee.propagation import XuLeePropagation, propagated

XU_LEE = Baseline(
    name='xu_lee',
    title='Xu and Lee',
    leaf='xu_lee_{task}_{data}_{budget}',
    options={
        'sem': {
            'label_refreshes': 1,
            'propagate': False,
            'aug_prob': 1.0,
            'aug_loss': {
                'loss': {'type': 'DivergenceLoss', 'convention': 'xu_lee', 'loss_weight': 10.0},
                'num_points': None,
            },
            'method_loss': {'type': 'ScheduledLoss', 'start': 0.5, 'losses': ['${aug_loss}', {'type': 'XuLeeLoss'}]},
            'losses': ['${point_loss}', '${method_loss}'],
            'model.refine': {'type': 'XuLeePropagation'},
        }
    },
)

__all__ = ['XU_LEE', 'XuLeeLoss', 'XuLeePropagation', 'inexact_loss', 'propagated', 'smoothness_loss']
