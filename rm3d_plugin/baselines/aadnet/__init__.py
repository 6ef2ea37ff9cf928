"""The entropy-weighted loss of AADNet."""

from rm3d_plugin.baselines.aadnet.loss import EntropyWeightedLoss
from rm3d_plugin.baselines.base import Baseline

AADNET = Baseline(
    name='aadnet',
    title='AADNet',
    leaf='aadnet_{task}_{data}_{budget}',
    options={
        'sem': {
            'label_refreshes': 1,
            'propagate': False,
            'point_loss.loss': {'type': 'EntropyWeightedLoss'},
        }
    },
)

__all__ = ['AADNET', 'EntropyWeightedLoss']
