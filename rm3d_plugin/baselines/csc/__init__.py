"""Contrastive Scene Contexts: pre-training that tells points apart within parts of the space around them."""

from rm3d_plugin.baselines.base import Task
from rm3d_plugin.baselines.csc.loss import SceneContexts
from rm3d_plugin.baselines.method import method

LOSS = {'type': 'SceneContexts', 'in_channels': '${widths[0]}'}
HOOK = {'type': 'PretrainingHook', 'loss': LOSS, 'cache': '${cache_dir}'}
TASKS: tuple[Task, ...] = ('sem', 'ins', 'votenet')

CSC = method('csc', 'CSC', {task: {'method_hook': HOOK} for task in TASKS}, declares=('pre-training',))

__all__ = ['CSC', 'SceneContexts']
