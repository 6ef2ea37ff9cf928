"""RM3D with parts of compared methods: what helps it."""

from rm3d_plugin.baselines.csc import CSC, HOOK
from rm3d_plugin.baselines.erda import ERDA
from rm3d_plugin.baselines.method import with_rm3d

RM3D_CSC = with_rm3d(CSC, {task: {'method_hook': HOOK} for task in CSC.options})
RM3D_ERDA = with_rm3d(ERDA, {'sem': {'method_loss': ERDA.options['sem']['method_loss']}})
