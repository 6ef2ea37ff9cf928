"""The model bases of segmentation build once a data set says what it has."""

from pathlib import Path

import pytest
from mmengine.registry import DefaultScope

from rm3d_plugin.engine.config import load_config
from rm3d_plugin.models.segmentors import RM3DSegmentor
from rm3d_plugin.registry import MODELS, SCOPE

BASES = Path(__file__).resolve().parents[2] / 'configs' / '_base_' / 'models'
LEAF = """
_base_ = ['{base}']
num_classes = 4
thing_classes = [2, 3]
point_columns = ['intensity', 'rgb']
rounds = sigma = 1
"""


@pytest.mark.parametrize(
    ('name', 'voxel', 'levels', 'width'), [('small', 0.05, 4, 16), ('paper', 0.02, 7, 16), ('large', 0.02, 7, 32)]
)
@pytest.mark.parametrize('instances', [False, True])
def test_a_base_builds(name, voxel, levels, width, instances, tmp_path):
    leaf = tmp_path / 'leaf.py'
    leaf.write_text(LEAF.format(base=BASES / f'segmentor_{name}.py'))
    options = {'use_columns': ['rgb']} | (
        {'instance_head': '${point_group}', 'cluster_radius': 0.5} if instances else {}
    )
    config = load_config(leaf, options=options)
    with DefaultScope.overwrite_default_scope(SCOPE):
        model = MODELS.build(config.model)
    assert type(model) is RM3DSegmentor and model.num_classes == 4 and model.thing_classes == (2, 3)
    assert (model.backbone.voxel_size, len(config.widths), model.backbone.out_channels) == (voxel, levels, width)
    assert model.inputs.point_columns == 7 and model.inputs.channels == 3 + 1 + 1  # rgb, height, one
    if instances:
        assert model.instance_head.rules.radius == 0.5
    else:
        assert model.instance_head is None
