"""Perturbed self-distillation."""

from rm3d_plugin.baselines.method import method
from rm3d_plugin.baselines.psd.losses import RelationLoss, relation_loss

VIEW = {'type': 'ViewSupervision', 'loss': '${point_loss}'}
PARTS = {
    'aug_prob': 1.0,
    'aug_loss': {'loss': {'type': 'DivergenceLoss', 'convention': 'psd'}},
    'method_loss': {
        'type': 'ScheduledLoss',
        'losses': [VIEW, {'type': 'RelationLoss', 'channels': '${widths[0]}'}],
    },
}
PSD = method('psd', 'PSD', {'sem': PARTS, 'ins': PARTS}, declares=('second view',))

__all__ = ['PSD', 'RelationLoss', 'relation_loss']
