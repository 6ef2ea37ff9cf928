"""The distribution guidance network."""

from rm3d_plugin.baselines.dgnet.losses import fit_mixture, mixture_losses
from rm3d_plugin.baselines.dgnet.terms import DGNetLoss, TruncatedCrossEntropyLoss
from rm3d_plugin.baselines.method import method

MIXTURE = {'type': 'DGNetLoss', 'num_classes': '${num_classes}', 'channels': '${widths[0]}'}
PARTS = {
    'point_loss.loss': {'type': 'TruncatedCrossEntropyLoss'},
    'method_loss': {'type': 'ScheduledLoss', 'start': 0.5, 'losses': [MIXTURE]},
}
DGNET = method('dgnet', 'DGNet', {'sem': PARTS})

__all__ = ['DGNET', 'DGNetLoss', 'TruncatedCrossEntropyLoss', 'fit_mixture', 'mixture_losses']
