"""The entropy-weighted loss of AADNet."""

from rm3d_plugin.baselines.aadnet.loss import EntropyWeightedLoss
from rm3d_plugin.baselines.method import method

PARTS = {'point_loss.loss': {'type': 'EntropyWeightedLoss'}}
AADNET = method('aadnet', 'AADNet', {'sem': PARTS})

__all__ = ['AADNET', 'EntropyWeightedLoss']
