"""Child registries of mmengine's, plus the two that only making labels needs.

A part is built from a config by its type name: ``MODELS.build(dict(type='SparseUNet', ...))``. Another mmengine
project reaches the same parts with ``custom_imports = dict(imports=['rm3d_plugin'])`` and
``type='rm3d_plugin.SparseUNet'``. The scope is the package name; mmengine finds no part under any other.
"""

from mmengine import registry as parent

SCOPE = 'rm3d_plugin'

MODELS = parent.Registry('model', parent=parent.MODELS, scope=SCOPE, locations=['rm3d_plugin.models'])
DATASETS = parent.Registry('dataset', parent=parent.DATASETS, scope=SCOPE, locations=['rm3d_plugin.datasets'])
DATA_SAMPLERS = parent.Registry(
    'data sampler', parent=parent.DATA_SAMPLERS, scope=SCOPE, locations=['rm3d_plugin.datasets']
)
TRANSFORMS = parent.Registry('transform', parent=parent.TRANSFORMS, scope=SCOPE, locations=['rm3d_plugin.datasets'])
METRICS = parent.Registry('metric', parent=parent.METRICS, scope=SCOPE, locations=['rm3d_plugin.evaluation'])
HOOKS = parent.Registry('hook', parent=parent.HOOKS, scope=SCOPE, locations=['rm3d_plugin.engine'])
VISUALIZERS = parent.Registry('visualizer', parent=parent.VISUALIZERS, scope=SCOPE)
VISBACKENDS = parent.Registry('vis_backend', parent=parent.VISBACKENDS, scope=SCOPE)
LOOPS = parent.Registry('loop', parent=parent.LOOPS, scope=SCOPE, locations=['rm3d_plugin.engine'])
TASK_UTILS = parent.Registry('task util', parent=parent.TASK_UTILS, scope=SCOPE, locations=['rm3d_plugin.engine'])

DESCRIPTORS = parent.Registry('descriptor', scope=SCOPE, locations=['rm3d_plugin.descriptors'])
OVERSEGMENTERS = parent.Registry('oversegmenter', scope=SCOPE, locations=['rm3d_plugin.oversegmentation'])
