"""Guided point contrast: a contrastive loss between views, whose negatives pseudo labels choose."""

from typing import Any

from rm3d_plugin.baselines.gpc.loss import GuidedContrast
from rm3d_plugin.baselines.method import method

START = 0.005  # share of training: 200 of 38 000 steps


def _loss(num_classes: str | int) -> dict[str, Any]:
    contrast = {'type': 'GuidedContrast', 'in_channels': '${widths[0]}', 'num_classes': num_classes}
    return {'type': 'ScheduledLoss', 'start': START, 'losses': [contrast]}


POINTS = {
    'aug_loss': None,
    'aug_prob': 0.0,
    'method_view': {'type': 'AugmentedView', 'crop': [0.4, 0.8]},
    'method_loss': _loss('${num_classes}'),
}

GPC = method(
    'gpc',
    'GPC',
    {'sem': POINTS, 'ins': POINTS, 'votenet': {'aug_loss': None, 'aug_prob': 1.0, 'method_loss': _loss(4)}},
    declares=('second view',),
)

__all__ = ['GPC', 'GuidedContrast']
