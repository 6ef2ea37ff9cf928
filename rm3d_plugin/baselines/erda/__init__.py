"""The entropy-regularised distribution alignment of ERDA."""

from rm3d_plugin.baselines.base import Baseline
from rm3d_plugin.baselines.erda.loss import ERDALoss, erda_loss

ERDA = Baseline(
    name='erda',
    title='ERDA',
    leaf='erda_{task}_{data}_{budget}',
    options={
        'sem': {
            'label_refreshes': 1,
            'propagate': False,
            'method_loss': {'type': 'ERDALoss', 'num_classes': '${num_classes}', 'channels': '${widths[0]}'},
        }
    },
)

__all__ = ['ERDA', 'ERDALoss', 'erda_loss']
