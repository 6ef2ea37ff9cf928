"""Contextual point cloud modelling."""

from rm3d_plugin.baselines.base import Baseline
from rm3d_plugin.baselines.cpcm.loss import MaskedConsistency
from rm3d_plugin.baselines.cpcm.masking import MaskedView, hidden_points

CPCM = Baseline(
    name='cpcm',
    title='CPCM',
    leaf='cpcm_{task}_{data}_{budget}',
    options={
        'sem': {
            'label_refreshes': 1,
            'propagate': False,
            'aug_prob': 1.0,
            'method_view': {'type': 'MaskedView'},
            'method_loss': {'type': 'ScheduledLoss', 'ramp': 0.028, 'losses': [{'type': 'MaskedConsistency'}]},
            'losses': ['${point_loss}', {'type': 'ViewSupervision', 'loss': '${point_loss}'}, '${method_loss}'],
        }
    },
)

__all__ = ['CPCM', 'MaskedConsistency', 'MaskedView', 'hidden_points']
