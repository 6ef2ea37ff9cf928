"""The network of a config takes other sizes, columns and tasks by options."""

import pytest
from configs.leaves import CONFIGS
from mmengine.registry import DefaultScope

from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.models.segmentors import RM3DSegmentor
from rm3d_plugin.registry import MODELS, SCOPE

LEAF = CONFIGS / 'rm3d_sem_scannet_0p2pct.py'
SMALL = {'widths': [16, 32, 48, 64], 'blocks': 1, 'voxel_size': 0.05}
WIDE = {'widths': [32, 64, 96, 128, 160, 192, 224]}


@pytest.mark.parametrize(
    ('options', 'voxel', 'levels', 'width'), [(SMALL, 0.05, 4, 16), ({}, 0.02, 7, 16), (WIDE, 0.02, 7, 32)]
)
@pytest.mark.parametrize('task', ['semantic', 'instances'])
def test_sizes(options, voxel, levels, width, task):
    data = {'num_classes': 4, 'thing_classes': [2, 3], 'point_columns': ['intensity', 'rgb'], 'use_columns': ['rgb']}
    config = load_config(LEAF, 'run', options={**options, **data, 'task': task, 'cluster_radius': 0.5})
    with DefaultScope.overwrite_default_scope(SCOPE):
        model = MODELS.build(config.model)
    assert type(model) is RM3DSegmentor and model.num_classes == 4 and model.thing_classes == (2, 3)
    assert (model.backbone.voxel_size, len(config.widths), model.backbone.out_channels) == (voxel, levels, width)
    assert model.inputs.point_columns == 7 and model.inputs.channels == 3 + 1 + 1  # rgb, height, one
    losses, metrics = ['WeakSupervision', 'ViewConsistency'], ['SemSegMetric']
    if task == 'instances':
        assert model.instance_head.rules.radius == 0.5
        losses, metrics = [*losses, 'InstanceOffsets', 'InstanceDice'], [*metrics, 'InstanceSegMetric']
    else:
        assert model.instance_head is None
    assert list(model.losses) == losses and [metric.type for metric in config.val_evaluator] == metrics


def test_a_task_that_there_is_not():
    with pytest.raises(ConfigError, match=r"Interpolation key 'tasks\.boxes\..*' not found"):
        load_config(LEAF, 'run', options={'task': 'boxes'})
