"""Two-way inter-label self-training of instances."""

from rm3d_plugin.baselines.method import method
from rm3d_plugin.baselines.twist.loss import TwistLoss
from rm3d_plugin.baselines.twist.pseudo import two_way_labels

PARTS = {
    'point_group.proposals.coordinates': 'both',
    'method_loss': {
        'type': 'TwistLoss',
        'num_classes': '${num_classes}',
        'channels': '${widths[0]}',
        'thing_classes': '${thing_classes}',
        'proposals': '${point_group.proposals}',
    },
    'method_hook': {'type': 'EMATeacherHook'},
}
TWIST = method('twist', 'TWIST', {'ins': PARTS})

__all__ = ['TWIST', 'TwistLoss', 'two_way_labels']
