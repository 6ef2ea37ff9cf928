"""What a budget of points shows of a data set, and what a resumed run takes up."""

import json

import numpy as np
import pytest
from reference.toy_scenes import ToyRooms

from rm3d_plugin.label_budgets import BudgetError, clicks_of
from rm3d_plugin.labeling import PointBudgetSource
from rm3d_plugin.storage import write_clicks


def source(budget='20pts', seed=0, count=3, **settings):
    return PointBudgetSource(ToyRooms(count, **settings), budget, seed)


def test_annotated_points_alone_are_labelled():
    some = source()
    assert (some.classes, tuple(some.thing_classes)) == (('floor', 'box', 'wall'), (1,))
    for index in range(3):
        annotated, truth = some.annotated_labels(index), some.truth(index)
        shown = np.flatnonzero(annotated.semantic >= 0)
        assert len(shown) == 20 and not annotated.complete and len(annotated.boxes) == 0
        np.testing.assert_array_equal(shown, some.budget.annotated[f'room{index}'].points)
        np.testing.assert_array_equal(annotated.semantic[shown], truth.semantic[shown])
        np.testing.assert_array_equal(annotated.instance, np.where(annotated.semantic >= 0, truth.instance, -1))
        assert set(annotated.semantic[shown].tolist()) == {0, 1, 2}
    counts = some.point_counts()
    assert counts.sum() == 60
    np.testing.assert_array_equal(counts, super(PointBudgetSource, some).point_counts())
    assert '60 of' in some.describe() and 'box' in some.describe()


def test_everything_annotated_is_complete():
    annotated, truth = source('full').annotated_labels(1), source().truth(1)
    assert annotated.complete
    np.testing.assert_array_equal(annotated.semantic, truth.semantic)
    np.testing.assert_array_equal(annotated.instance, truth.instance)
    assert (source('full_no_instances').annotated_labels(1).instance == -1).all()


def test_whole_scenes():
    some = source('scenes20pct', count=5)
    kinds = [some.annotated_labels(index) for index in range(5)]
    assert sum(kind.complete for kind in kinds) == 1
    assert all((kind.semantic >= 0).any() == kind.complete for kind in kinds)


def test_the_draw_is_kept_for_resuming(tmp_path):
    first = source('0p2pct')
    first.open(tmp_path, resume=False)
    again = source('0p2pct')
    again.open(tmp_path, resume=True)
    assert again.budget.hash == first.budget.hash
    content = json.loads((tmp_path / 'budget.json').read_text())
    assert content['hash'] == first.budget.hash and content['seed'] == 0
    source({'percent': 0.2}).open(tmp_path, resume=True)  # the same amount under another name


@pytest.mark.parametrize(('budget', 'seed'), [('full', 0), ('20pts', 1), ('20pts_no_instances', 0)])
def test_a_run_is_not_resumed_with_another_budget(tmp_path, budget, seed):
    source('20pts').open(tmp_path, resume=False)
    with pytest.raises(BudgetError, match=rf'budget\.json: was drawn with seed 0.* but seed {seed} .*another work dir'):
        source(budget, seed).open(tmp_path, resume=True)


def test_nothing_to_resume_and_other_data_are_told(tmp_path):
    with pytest.raises(BudgetError, match=r'budget\.json: no such label budget'):
        source().open(tmp_path, resume=True)
    source().open(tmp_path, resume=False)
    denser = source(density=2)
    denser.open(tmp_path, resume=True)
    with pytest.raises(
        BudgetError, match='scene room0: the label budget was drawn from .* voxel downsampling or data changed'
    ):
        denser.annotated_labels(0)


@pytest.mark.parametrize('voxel', [None, 0.1])
def test_drawn_points_written_as_clicks_reveal_the_same(tmp_path, voxel):
    some = source('onept_instance', voxel_downsample=voxel)
    clicks = []
    for index, scene in enumerate(some.scene_ids):
        cloud = some.load_cloud(index)
        clicks += clicks_of(scene, some.annotated(index, len(cloud)), cloud, some.rows_of(scene))
    write_clicks(tmp_path / 'clicks.csv', clicks, some.classes)
    for truth in (True, False):
        clicked = source({'clicks': str(tmp_path / 'clicks.csv')}, voxel_downsample=voxel, truth=truth)
        for index in range(3):
            ours, theirs = some.annotated_labels(index), clicked.annotated_labels(index)
            np.testing.assert_array_equal(ours.semantic, theirs.semantic)
            np.testing.assert_array_equal(ours.instance, theirs.instance)
        assert (clicked.truth(0) is not None) == truth


def test_lists_count_the_points_of_the_file(tmp_path):
    dataset = ToyRooms(2, voxel_downsample=0.1)
    rows = dataset.original_index(1)
    labelled = [int(i) for i in np.flatnonzero(dataset.load_truth(1).semantic[rows] >= 0)[[7, 90]]]
    (tmp_path / 'list.json').write_text(json.dumps({'room1': labelled}))
    annotated = PointBudgetSource(dataset, {'point_list': str(tmp_path / 'list.json')}).annotated_labels(1)
    assert np.flatnonzero(annotated.semantic >= 0).tolist() == np.unique(rows[labelled]).tolist()


def clicked(path, clicks, add_clicks=False):
    """A source of three rooms and these clicks: (scene, index, class)."""
    lines = [','.join(map(str, click)) for click in clicks]
    path.write_text('\n'.join(['scene,index,class', *lines]) + '\n')
    return PointBudgetSource(ToyRooms(3), {'clicks': str(path)}, add_clicks=add_clicks)


FIRST = [('room0', 3, 'floor'), ('room0', 9, 'wall'), ('room1', 4, 'box')]
MORE = [*FIRST, ('room2', 5, 'box'), ('room0', 7, 'box'), ('room2', 6, 'floor')]


def test_clicks_that_were_added_wait_for_the_next_round(tmp_path):
    csv = tmp_path / 'clicks.csv'
    clicked(csv, FIRST).open(tmp_path, resume=False)
    same = clicked(csv, FIRST)
    same.open(tmp_path, resume=True)
    assert not same.grown and not same.extends(1)
    told = r'clicks\.csv: clicks were added: room0: 1 box; room2: 1 floor, 1 box; go on with them by --resume --add-cl'
    with pytest.raises(BudgetError, match=told):
        clicked(csv, MORE).open(tmp_path, resume=True)
    grown = clicked(csv, MORE, add_clicks=True)
    grown.open(tmp_path, resume=True)
    assert grown.extends(1) and grown.extends(2) and 'clicks were added: room0: 1 box; room2' in grown.describe()
    assert grown.point_counts().tolist() == [1, 1, 1]  # until a round is made
    killed = clicked(csv, MORE)
    with pytest.raises(BudgetError, match='clicks were added'):
        killed.open(tmp_path, resume=True)
    grown.extend(2, {})
    assert not grown.grown and grown.point_counts().tolist() == [2, 3, 1]
    assert np.flatnonzero(grown.annotated_labels(2).semantic >= 0).tolist() == [5, 6]
    again = clicked(csv, MORE)
    again.open(tmp_path, resume=True)
    assert again.budget.hash == grown.budget.hash and not again.grown
    with pytest.raises(BudgetError, match='no click was added since the run read it; resume without --add-clicks'):
        clicked(csv, MORE, add_clicks=True).open(tmp_path, resume=True)


@pytest.mark.parametrize(
    ('clicks', 'told'),
    [
        (MORE[1:], 'scene room0: point 3 was floor and is gone, but'),
        ([*MORE[1:], ('room0', 3, 'wall')], 'scene room0: point 3 was floor and is wall, but'),
        (MORE[3:], 'scene room0: point 3 was floor and is gone; point 9 was wall and is gone, but'),
    ],
)
@pytest.mark.parametrize('add', [True, False])
def test_clicks_that_training_has_seen_must_stay(tmp_path, clicks, told, add):
    csv = tmp_path / 'clicks.csv'
    clicked(csv, FIRST).open(tmp_path, resume=False)
    with pytest.raises(BudgetError, match=rf'clicks\.csv: {told} the run has learnt from them; put them back'):
        clicked(csv, clicks, add).open(tmp_path, resume=True)


def test_clicks_are_added_to_a_file_of_clicks_alone():
    with pytest.raises(BudgetError, match='add_clicks: the label budget is no file of clicks'):
        PointBudgetSource(ToyRooms(2), '20pts', add_clicks=True)
