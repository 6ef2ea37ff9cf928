"""Compared methods: a folder each, with a README (what it is, its source, what differs) and a :class:`Baseline`."""

from rm3d_plugin.baselines.base import LABELS, Baseline, Task
from rm3d_plugin.baselines.full_supervision import FULL_SUPERVISION
from rm3d_plugin.baselines.labelled_only import LABELLED_ONLY

BASELINES = {baseline.name: baseline for baseline in (LABELLED_ONLY, FULL_SUPERVISION)}

__all__ = ['BASELINES', 'FULL_SUPERVISION', 'LABELLED_ONLY', 'LABELS', 'Baseline', 'Task']
