"""Compared methods: a folder each, with a README (what it is, its source, what differs) and a :class:`Baseline`."""

from rm3d_plugin.baselines.aadnet import AADNET
from rm3d_plugin.baselines.base import LABELS, Baseline, Task
from rm3d_plugin.baselines.combinations import RM3D_CSC, RM3D_ERDA
from rm3d_plugin.baselines.cpcm import CPCM
from rm3d_plugin.baselines.csc import CSC
from rm3d_plugin.baselines.dgnet import DGNET
from rm3d_plugin.baselines.erda import ERDA
from rm3d_plugin.baselines.full_supervision import FULL_SUPERVISION
from rm3d_plugin.baselines.gpc import GPC
from rm3d_plugin.baselines.labelled_only import LABELLED_ONLY
from rm3d_plugin.baselines.otoc import OTOC
from rm3d_plugin.baselines.pointcontrast import POINTCONTRAST
from rm3d_plugin.baselines.psd import PSD
from rm3d_plugin.baselines.redal import REDAL
from rm3d_plugin.baselines.twist import TWIST
from rm3d_plugin.baselines.viewpoint_bottleneck import VIEWPOINT_BOTTLENECK
from rm3d_plugin.baselines.xu_lee import XU_LEE

REFERENCES = (LABELLED_ONLY, FULL_SUPERVISION)
METHODS = (  # by the year of their publication
    XU_LEE,
    POINTCONTRAST,
    CSC,
    VIEWPOINT_BOTTLENECK,
    OTOC,
    PSD,
    REDAL,
    GPC,
    TWIST,
    ERDA,
    CPCM,
    DGNET,
    AADNET,
)
COMBINATIONS = (RM3D_CSC, RM3D_ERDA)  # RM3D with what helps
BASELINES = {baseline.name: baseline for baseline in (*REFERENCES, *METHODS)}

__all__ = [
    'AADNET',
    'BASELINES',
    'COMBINATIONS',
    'CPCM',
    'CSC',
    'DGNET',
    'ERDA',
    'FULL_SUPERVISION',
    'GPC',
    'LABELLED_ONLY',
    'LABELS',
    'METHODS',
    'OTOC',
    'POINTCONTRAST',
    'PSD',
    'REDAL',
    'REFERENCES',
    'RM3D_CSC',
    'RM3D_ERDA',
    'TWIST',
    'VIEWPOINT_BOTTLENECK',
    'XU_LEE',
    'Baseline',
    'Task',
]
