"""Viewpoint Bottleneck: pre-training that makes channels agree between views, and independent of each other."""

from rm3d_plugin.baselines.base import Task
from rm3d_plugin.baselines.method import method
from rm3d_plugin.baselines.viewpoint_bottleneck.loss import ViewpointBottleneck

LOSS = {'type': 'ViewpointBottleneck', 'in_channels': '${widths[0]}'}
HOOK = {'type': 'PretrainingHook', 'loss': LOSS, 'cache': '${cache_dir}'}
TASKS: tuple[Task, ...] = ('sem', 'ins', 'votenet')

VIEWPOINT_BOTTLENECK = method(
    'viewpoint_bottleneck',
    'Viewpoint Bottleneck',
    {task: {'method_hook': HOOK} for task in TASKS},
    declares=('pre-training',),
)

__all__ = ['VIEWPOINT_BOTTLENECK', 'ViewpointBottleneck']
