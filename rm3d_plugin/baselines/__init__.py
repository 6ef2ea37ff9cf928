"""Compared methods: a folder each, with a README (what it is, its source, what differs) and a :class:`Baseline`."""

from rm3d_plugin.baselines.base import LABELS, Baseline, Task
from rm3d_plugin.baselines.csc import CSC, RM3D_CSC
from rm3d_plugin.baselines.full_supervision import FULL_SUPERVISION
from rm3d_plugin.baselines.gpc import GPC
from rm3d_plugin.baselines.labelled_only import LABELLED_ONLY
from rm3d_plugin.baselines.pointcontrast import POINTCONTRAST
from rm3d_plugin.baselines.viewpoint_bottleneck import VIEWPOINT_BOTTLENECK

REFERENCES = (LABELLED_ONLY, FULL_SUPERVISION)
METHODS = (  # by the year of their publication
    POINTCONTRAST,
    CSC,
    VIEWPOINT_BOTTLENECK,
    GPC,
)
COMBINATIONS = (RM3D_CSC,)  # RM3D with what helps
BASELINES = {baseline.name: baseline for baseline in (*REFERENCES, *METHODS)}

__all__ = [
    'BASELINES',
    'COMBINATIONS',
    'FULL_SUPERVISION',
    'LABELLED_ONLY',
    'LABELS',
    'METHODS',
    'REFERENCES',
    'Baseline',
    'Task',
]
