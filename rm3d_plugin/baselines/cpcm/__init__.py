"""Contextual point cloud modelling."""

from rm3d_plugin.baselines.cpcm.loss import MaskedConsistency
from rm3d_plugin.baselines.cpcm.masking import MaskedView, hidden_points
from rm3d_plugin.baselines.method import method

VIEW = {'type': 'ViewSupervision', 'loss': '${point_loss}'}
RAMP = 0.028  # share of training: 5 of 180 epochs
MASKED = {'type': 'ScheduledLoss', 'ramp': RAMP, 'losses': [{'type': 'MaskedConsistency'}]}
PARTS = {
    'aug_prob': 1.0,
    'aug_loss': None,
    'method_view': {'type': 'MaskedView'},
    'method_loss': {'type': 'ScheduledLoss', 'losses': [VIEW, MASKED]},
}
CPCM = method('cpcm', 'CPCM', {'sem': PARTS}, declares=('second view',))

__all__ = ['CPCM', 'MaskedConsistency', 'MaskedView', 'hidden_points']
