"""Two-way inter-label self-training of instances."""

from rm3d_plugin.baselines.base import Baseline
from rm3d_plugin.baselines.twist.loss import TwistLoss
from rm3d_plugin.baselines.twist.pseudo import two_way_labels

TWIST = Baseline(
    name='twist',
    title='TWIST',
    leaf='twist_{task}_{data}_{budget}',
    options={
        'ins': {
            'label_refreshes': 1,
            'propagate': False,
            'dice_loss': None,
            'offset_weight': 0.0,
            'method_loss': {
                'type': 'TwistLoss',
                'num_classes': '${num_classes}',
                'channels': '${widths[0]}',
                'thing_classes': '${thing_classes}',
                'proposals': '${point_group.proposals}',
            },
            'method_hook': {'type': 'EMATeacherHook'},
        }
    },
)

__all__ = ['TWIST', 'TwistLoss', 'two_way_labels']
