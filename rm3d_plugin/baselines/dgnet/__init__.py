"""The distribution guidance network."""

from rm3d_plugin.baselines.base import Baseline
from rm3d_plugin.baselines.dgnet.losses import fit_mixture, mixture_losses
from rm3d_plugin.baselines.dgnet.terms import DGNetLoss, TruncatedCrossEntropyLoss

DGNET = Baseline(
    name='dgnet',
    title='DGNet',
    leaf='dgnet_{task}_{data}_{budget}',
    options={
        'sem': {
            'label_refreshes': 1,
            'propagate': False,
            'point_loss.loss': {'type': 'TruncatedCrossEntropyLoss'},
            'method_loss': {
                'type': 'ScheduledLoss',
                'start': 0.5,
                'losses': [{'type': 'DGNetLoss', 'num_classes': '${num_classes}', 'channels': '${widths[0]}'}],
            },
        }
    },
)

__all__ = ['DGNET', 'DGNetLoss', 'TruncatedCrossEntropyLoss', 'fit_mixture', 'mixture_losses']
