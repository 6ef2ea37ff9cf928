"""PointContrast: pre-training that finds the same point in two views."""

from rm3d_plugin.baselines.base import Task
from rm3d_plugin.baselines.method import method
from rm3d_plugin.baselines.pointcontrast.loss import PointContrast

LOSS = {'type': 'PointContrast', 'in_channels': '${widths[0]}', 'voxel_size': '${voxel_size}'}
HOOK = {'type': 'PretrainingHook', 'loss': LOSS, 'cache': '${cache_dir}'}
TASKS: tuple[Task, ...] = ('sem', 'ins', 'votenet')

POINTCONTRAST = method(
    'pointcontrast', 'PointContrast', {task: {'method_hook': HOOK} for task in TASKS}, declares=('pre-training',)
)

__all__ = ['POINTCONTRAST', 'PointContrast']
