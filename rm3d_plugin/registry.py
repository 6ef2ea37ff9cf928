"""Child registries of mmengine's, plus the two that only making labels needs.

A part is built from a config by its type name: ``MODELS.build(dict(type='SparseUNet', ...))``. Another mmengine
project reaches the same parts with ``custom_imports = dict(imports=['rm3d_plugin'])`` and
``type='rm3d_plugin.SparseUNet'``. The scope is the package name; mmengine finds no part under any other.
"""

from collections.abc import Mapping
from typing import Any

from mmengine import registry as parent

SCOPE = 'rm3d_plugin'
BASELINES = 'rm3d_plugin.baselines'  # parts of the compared methods


class PartRegistry(parent.Registry):
    """Builds our own parts by their plain names whatever the default scope is.

    mmengine looks a plain name up in the default scope. In another project that is another package, so a part of ours
    could not build the parts inside it. Names that are not ours are looked up as usual.
    """

    def build(self, cfg: Any, *args: Any, **kwargs: Any) -> Any:
        """Build a part from its config."""
        if isinstance(cfg, Mapping) and '_scope_' not in cfg:
            self.import_from_location()
            if cfg.get('type') in self.module_dict:
                cfg = {**cfg, '_scope_': SCOPE}
        return super().build(cfg, *args, **kwargs)


MODELS = PartRegistry('model', parent=parent.MODELS, scope=SCOPE, locations=['rm3d_plugin.models', BASELINES])
DATASETS = PartRegistry('dataset', parent=parent.DATASETS, scope=SCOPE, locations=['rm3d_plugin.datasets'])
DATA_SAMPLERS = PartRegistry(
    'data sampler', parent=parent.DATA_SAMPLERS, scope=SCOPE, locations=['rm3d_plugin.datasets']
)
TRANSFORMS = PartRegistry(
    'transform',
    parent=parent.TRANSFORMS,
    scope=SCOPE,
    locations=['rm3d_plugin.datasets', 'rm3d_plugin.inference.region_numbers', BASELINES],
)
METRICS = PartRegistry('metric', parent=parent.METRICS, scope=SCOPE, locations=['rm3d_plugin.evaluation'])
HOOKS = PartRegistry(
    'hook',
    parent=parent.HOOKS,
    scope=SCOPE,
    locations=['rm3d_plugin.engine.hooks', 'rm3d_plugin.reporting.report_hook', BASELINES],
)
LOOPS = PartRegistry('loop', parent=parent.LOOPS, scope=SCOPE, locations=['rm3d_plugin.engine.loops'])
TASK_UTILS = PartRegistry(
    'task util', parent=parent.TASK_UTILS, scope=SCOPE, locations=['rm3d_plugin.labeling', BASELINES]
)

DESCRIPTORS = PartRegistry('descriptor', scope=SCOPE, locations=['rm3d_plugin.descriptors'])
OVERSEGMENTERS = PartRegistry('oversegmenter', scope=SCOPE, locations=['rm3d_plugin.oversegmentation'])

# Where mmengine's own parts are built under our scope; without a child of that scope it warns every time.
_BORROWED = tuple(
    parent.Registry(borrowed.name, parent=borrowed, scope=SCOPE)
    for borrowed in (
        parent.VISUALIZERS,
        parent.VISBACKENDS,
        parent.OPTIMIZERS,
        parent.OPTIM_WRAPPERS,
        parent.OPTIM_WRAPPER_CONSTRUCTORS,
        parent.PARAM_SCHEDULERS,
        parent.EVALUATOR,
        parent.MODEL_WRAPPERS,
    )
)
