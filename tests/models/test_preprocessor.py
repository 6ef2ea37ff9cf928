import pytest
import torch
from mmengine.dataset import pseudo_collate

from rm3d_plugin.models import ScenePreprocessor
from rm3d_plugin.structures import SceneError, SceneSample


def item(n, rows=None):
    inputs = {'points': torch.arange(4.0 * n).reshape(n, 4)}
    if rows is not None:
        inputs.update(aug_points=inputs['points'][rows], aug_index=torch.tensor(rows, dtype=torch.int64))
    return {'inputs': inputs, 'data_samples': SceneSample()}


def test_scenes_are_joined_and_index_made_global():
    out = ScenePreprocessor()(pseudo_collate([item(3, [2, 0]), item(2, [1])]))
    assert out['inputs']['points'].shape == (5, 4)
    assert out['inputs']['batch_offsets'].tolist() == [0, 3, 5]
    assert out['inputs']['aug_index'].tolist() == [2, 0, 4]
    assert out['inputs']['aug_batch_offsets'].tolist() == [0, 2, 3]
    assert torch.equal(out['inputs']['points'][out['inputs']['aug_index']], out['inputs']['aug_points'])
    assert len(out['data_samples']) == 2


def test_without_view_and_empty_scene():
    out = ScenePreprocessor()(pseudo_collate([item(0), item(1)]))
    assert set(out['inputs']) == {'points', 'batch_offsets'}
    assert out['inputs']['batch_offsets'].tolist() == [0, 0, 1]


def test_a_batch_whose_views_are_all_empty_has_none():
    out = ScenePreprocessor()(pseudo_collate([item(3, []), item(2, [])]))
    assert set(out['inputs']) == {'points', 'batch_offsets'}
    one = ScenePreprocessor()(pseudo_collate([item(3, []), item(2, [1])]))['inputs']
    assert one['aug_batch_offsets'].tolist() == [0, 0, 1] and one['aug_index'].tolist() == [4]


def test_bad_view():
    data = item(3, [2, 0])
    data['inputs']['aug_index'] = torch.tensor([2, 3])
    with pytest.raises(SceneError, match='rows of 3 points'):
        ScenePreprocessor()(pseudo_collate([data]))
    data['inputs']['aug_index'] = torch.tensor([2])
    with pytest.raises(SceneError, match='expected 2 rows'):
        ScenePreprocessor()(pseudo_collate([data]))
