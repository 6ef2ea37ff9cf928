"""Compared methods: a folder each, with a README (what it is, its source, what differs) and a :class:`Baseline`."""

from rm3d_plugin.baselines.aadnet import AADNET
from rm3d_plugin.baselines.base import LABELS, Baseline, Task
from rm3d_plugin.baselines.cpcm import CPCM
from rm3d_plugin.baselines.dgnet import DGNET
from rm3d_plugin.baselines.erda import ERDA
from rm3d_plugin.baselines.full_supervision import FULL_SUPERVISION
from rm3d_plugin.baselines.labelled_only import LABELLED_ONLY
from rm3d_plugin.baselines.otoc import OTOC
from rm3d_plugin.baselines.psd import PSD
from rm3d_plugin.baselines.twist import TWIST
from rm3d_plugin.baselines.xu_lee import XU_LEE

_METHODS = (LABELLED_ONLY, FULL_SUPERVISION, XU_LEE, OTOC, PSD, TWIST, ERDA, CPCM, DGNET, AADNET)
BASELINES = {baseline.name: baseline for baseline in _METHODS}

__all__ = [
    'AADNET',
    'BASELINES',
    'CPCM',
    'DGNET',
    'ERDA',
    'FULL_SUPERVISION',
    'LABELLED_ONLY',
    'LABELS',
    'OTOC',
    'PSD',
    'TWIST',
    'XU_LEE',
    'Baseline',
    'Task',
]
