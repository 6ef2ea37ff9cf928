"""Parts by their type names: in our scope, in mmengine's, and by scoped names where only the package was imported."""

import subprocess
import sys

import pytest
from mmengine import registry as parent
from mmengine.registry import DefaultScope

from rm3d_plugin import registry
from rm3d_plugin.models.heads import SceneClassHead
from rm3d_plugin.models.losses import DiceLoss, JSAugLoss, SceneClassLoss


@pytest.mark.parametrize('scope', ['mmengine', 'rm3d_plugin'])
def test_our_parts_build_their_own_parts_under_any_scope(scope):
    with DefaultScope.overwrite_default_scope(scope):
        head = parent.MODELS.build({'type': 'rm3d_plugin.SceneClassHead', 'num_classes': 2})
        assert type(head) is SceneClassHead and type(head.loss_fn) is SceneClassLoss
        assert type(registry.MODELS.build({'type': 'JSAugLoss', 'loss_weight': 0.5})) is JSAugLoss
        assert type(parent.MODELS.build({'type': 'rm3d_plugin.DiceLoss'})) is DiceLoss
        provider = registry.DESCRIPTORS.build({'type': 'AdaptedPFH', 'radius': 0.25})
        assert type(provider).__name__ == 'AdaptedPFH'


def test_parts_of_mmengine_build_through_our_registries():
    with DefaultScope.overwrite_default_scope('rm3d_plugin'):
        hook = registry.HOOKS.build({'type': 'IterTimerHook'})
    assert type(hook).__module__ == 'mmengine.hooks.iter_timer_hook'


def test_an_unknown_part_is_an_error():
    with pytest.raises(KeyError, match='Nonsense is not in the .* registry'):
        registry.MODELS.build({'type': 'Nonsense'})


SCRIPT = """
import sys
from mmengine.registry import HOOKS, METRICS, MODELS, TASK_UTILS, DefaultScope
import rm3d_plugin
assert not any(name.split('.')[0] in ('torch', 'numba', 'open3d') for name in sys.modules), 'not light'
assert sorted(m for m in sys.modules if m.startswith('rm3d_plugin')) == ['rm3d_plugin', 'rm3d_plugin.registry']
with DefaultScope.overwrite_default_scope('mmengine'):
    for registry, name in (
        (MODELS, 'JSAugLoss'), (MODELS, 'DiceLoss'), (MODELS, 'SparseUNet'), (METRICS, 'KittiMetric'),
        (HOOKS, 'RegionMergeHook'), (TASK_UTILS, 'DetectionLabelMaker'), (MODELS, 'RM3DVoteNet'),
    ):
        print(registry.get(f'rm3d_plugin.{name}').__name__)
"""


def test_importing_the_package_is_light_and_makes_every_scoped_type_known():
    done = subprocess.run([sys.executable, '-c', SCRIPT], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    names = 'JSAugLoss DiceLoss SparseUNet KittiMetric RegionMergeHook DetectionLabelMaker RM3DVoteNet'
    assert done.stdout.split() == names.split()
