import pytest
import torch
from mmengine.dataset import pseudo_collate

from rm3d_plugin.models import ScenePreprocessor
from rm3d_plugin.structures import SceneError, SceneSample


def item(n, rows=None):
    inputs = {'points': torch.arange(4.0 * n).reshape(n, 4)}
    if rows is not None:
        ids = torch.tensor(rows, dtype=torch.int64)
        inputs['views'] = [{'points': inputs['points'][ids], 'point_ids': ids}]
    return {'inputs': inputs, 'data_samples': SceneSample()}


def test_scenes_are_joined_and_index_made_global():
    out = ScenePreprocessor()(pseudo_collate([item(3, [2, 0]), item(2, [1])]))
    assert out['inputs']['points'].shape == (5, 4)
    assert out['inputs']['batch_offsets'].tolist() == [0, 3, 5]
    (view,) = out['inputs']['views']
    assert view['point_ids'].tolist() == [2, 0, 4]
    assert view['batch_offsets'].tolist() == [0, 2, 3]
    assert torch.equal(out['inputs']['points'][view['point_ids']], view['points'])
    assert len(out['data_samples']) == 2


def test_without_view_and_empty_scene():
    out = ScenePreprocessor()(pseudo_collate([item(0), item(1)]))
    assert set(out['inputs']) == {'points', 'batch_offsets', 'views'} and out['inputs']['views'] == []
    assert out['inputs']['batch_offsets'].tolist() == [0, 0, 1]


def test_a_batch_whose_views_are_all_empty_has_none():
    out = ScenePreprocessor()(pseudo_collate([item(3, []), item(2, [])]))
    assert out['inputs']['views'] == []
    (one,) = ScenePreprocessor()(pseudo_collate([item(3, []), item(2, [1])]))['inputs']['views']
    assert one['batch_offsets'].tolist() == [0, 0, 1] and one['point_ids'].tolist() == [4]


def test_each_view_is_joined_by_itself():
    items = [item(3, [2, 0]), item(2, [1])]
    for number, each in enumerate(items):
        points = each['inputs']['points']
        each['inputs']['views'].append({'points': points[:1] + 9, 'point_ids': torch.tensor([number])})
    first, second = ScenePreprocessor()(pseudo_collate(items))['inputs']['views']
    assert first['point_ids'].tolist() == [2, 0, 4] and second['point_ids'].tolist() == [0, 4]
    assert second['points'].tolist() == [[9, 10, 11, 12], [9, 10, 11, 12]]


def test_bad_view():
    data = item(3, [2, 0])
    data['inputs']['views'][0]['point_ids'] = torch.tensor([2, 3])
    with pytest.raises(SceneError, match=r'views\[0\].point_ids: expected rows of 3 points, or -1, got 2 to 3'):
        ScenePreprocessor()(pseudo_collate([data]))
    data['inputs']['views'][0]['point_ids'] = torch.tensor([2])
    with pytest.raises(SceneError, match='expected 2 ids'):
        ScenePreprocessor()(pseudo_collate([data]))
