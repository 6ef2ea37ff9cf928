"""The entropy-regularised distribution alignment of ERDA."""

from rm3d_plugin.baselines.erda.loss import ERDALoss, erda_loss
from rm3d_plugin.baselines.method import method

PARTS = {'method_loss': {'type': 'ERDALoss', 'num_classes': '${num_classes}', 'channels': '${widths[0]}'}}
ERDA = method('erda', 'ERDA', {'sem': PARTS})

__all__ = ['ERDA', 'ERDALoss', 'erda_loss']
