"""Perturbed self-distillation."""

from rm3d_plugin.baselines.base import Baseline
from rm3d_plugin.baselines.psd.losses import RelationLoss, relation_loss

PSD = Baseline(
    name='psd',
    title='PSD',
    leaf='psd_{task}_{data}_{budget}',
    options={
        'sem': {
            'label_refreshes': 1,
            'propagate': False,
            'aug_prob': 1.0,
            'aug_loss': {'loss': {'type': 'DivergenceLoss', 'convention': 'psd'}, 'num_points': None},
            'method_loss': {'type': 'RelationLoss', 'channels': '${widths[0]}'},
            'losses': [
                '${point_loss}',
                {'type': 'ViewSupervision', 'loss': '${point_loss}'},
                '${aug_loss}',
                '${method_loss}',
            ],
        }
    },
)

__all__ = ['PSD', 'RelationLoss', 'relation_loss']
