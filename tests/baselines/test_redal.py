"""ReDAL: its score and order by hand, and a budget that grows to that of all."""

import json
from pathlib import Path

import numpy as np
import pytest
from reference.toy_scenes import ToyRooms

from rm3d_plugin.baselines.redal import (
    DECAY,
    RegionRoundsSource,
    RegionView,
    alike,
    asked_of_regions,
    class_entropy,
    decayed,
)
from rm3d_plugin.label_budgets import BudgetError, load_point_budget
from rm3d_plugin.labeling import PointBudgetSource
from rm3d_plugin.pseudo_labels import PointPrediction

ROUNDS = 3
BUDGET = {'per_scene': 20}


def test_entropy_is_the_mean_over_the_classes_in_bits():
    shares = np.array([[0.25] * 4, [0.5, 0.5, 0, 0], [1.0, 0, 0, 0], [np.nan] * 4])
    np.testing.assert_allclose(class_entropy(shares), [0.5, 0.25, 0.0, np.nan], atol=1e-9)


def test_scores_decay_down_the_list_of_a_cluster():
    scores, clusters = np.array([3.0, 5.0, 4.0, 4.0, 1.0]), np.array([0, 0, 0, 1, 0])
    np.testing.assert_allclose(decayed(scores, clusters), [3 * DECAY**2, 5, 4 * DECAY, 4, 1 * DECAY**3])


def test_regions_that_are_alike_share_a_cluster():
    rng = np.random.default_rng(0)
    features = np.repeat([[0.0, 9.0, 1.0], [5.0, 0.0, 1.0]], 10, axis=0) + rng.normal(0, 0.01, (20, 3))
    features[:, 2] = 1.0  # a channel without spread
    found = alike(features, rng, count=2)
    assert len(set(found[:10])) == len(set(found[10:])) == 1 and found[0] != found[10]
    assert alike(features[:1], rng).tolist() == [0]


@pytest.mark.parametrize(
    ('shown', 'free', 'count', 'asked'),
    [
        ([0, 0, 0, 0], [9, 9, 9, 9], 2, [1, 0, 1, 0]),  # 10, then 9.6 before 9.9 * .95
        ([0, 0, 0, 0], [9, 9, 9, 9], 5, [2, 1, 1, 1]),  # all once, then the best
        ([1, 0, 1, 0], [9, 9, 9, 9], 2, [0, 1, 0, 1]),  # those that were not asked first
        ([0, 0, 0, 0], [0, 1, 0, 3], 9, [0, 1, 0, 3]),  # there are no more
        ([0, 0, 0, 0], [9, 9, 9, 9], 0, [0, 0, 0, 0]),
        ([0, 0, 0, 0], [9, 9, 9, 9], -1, [0, 0, 0, 0]),
    ],
)
def test_the_best_regions_are_asked(shown, free, count, asked):
    scores, clusters = np.array([10.0, 9.9, 9.6, 1.0]), np.array([0, 0, 1, 1])
    assert asked_of_regions(scores, clusters, np.array(shown), np.array(free), count).tolist() == asked


@pytest.fixture(scope='module')
def geometry(tmp_path_factory):
    return {
        'cache': str(tmp_path_factory.mktemp('geometry')),
        'descriptor': {'type': 'AdaptedPFH', 'radius': 0.3},
        'oversegmenter': {'type': 'VCCS'},
    }


def source_of(geometry, budget=BUDGET, rooms=2):
    return RegionRoundsSource(ToyRooms(rooms), budget, 0, ROUNDS, geometry)


def predictions(source):
    """Of every scene: sure of what lies low, not of what lies high; features are places."""
    for index, scene in enumerate(source.scene_ids):
        xyz = source.load_cloud(index).xyz
        unsure = np.clip(xyz[:, 2], 0, 1)[:, None] / 3
        yield scene, PointPrediction(np.hstack([1 - 2 * unsure, unsure, unsure]), None, None, xyz)


def grow(source, number):
    source.extend(number, {scene: source.look(scene, said) for scene, said in predictions(source)})
    return source.budget


@pytest.fixture
def opened(geometry, tmp_path):
    source = source_of(geometry)
    source.open(tmp_path, resume=False)
    return source


def test_it_grows_to_the_budget_of_all(opened, tmp_path):
    drawn = PointBudgetSource(ToyRooms(2), BUDGET, 0).budget
    first = opened.budget
    assert drawn.annotated_count == 40 and first.annotated_count == 13
    assert all(np.isin(first.annotated[name].points, drawn.annotated[name].points).all() for name in drawn.annotated)
    assert [opened.extends(number) for number in range(4)] == [False, True, True, False]
    before = first
    for number, count in ((1, 27), (2, 40)):
        now = grow(opened, number)
        assert now.annotated_count == count  # another in place of a point without a class
        for index, name in enumerate(now.annotated):
            points, semantic, instance = now.annotated[name]
            truth = opened.truth(index)
            np.testing.assert_array_equal(semantic, truth.semantic[points])
            np.testing.assert_array_equal(instance, truth.instance[points])
            assert (np.diff(points) > 0).all() and np.isin(before.annotated[name].points, points).all()
            assert (opened.annotated_labels(index).semantic >= 0).sum() == len(points)
        assert sum(now.annotated_per_class.values()) == sum(map(len, (s.points for s in now.annotated.values())))
        assert load_point_budget(tmp_path / 'budget.json').hash == now.hash
        before = now


def test_it_asks_where_the_network_is_unsure(opened):
    before = opened.budget
    now = grow(opened, 1)
    heights = [
        opened.load_cloud(index).xyz[np.setdiff1d(now.annotated[name].points, before.annotated[name].points), 2]
        for index, name in enumerate(opened.scene_ids)
    ]
    rooms = np.concatenate([opened.load_cloud(index).xyz[:, 2] for index in range(2)])
    assert np.concatenate(heights).mean() > rooms.mean() + 0.3


def test_the_score_of_a_region_is_the_mean_of_its_points(opened):
    scene, said = next(predictions(opened))
    view = opened.look(scene, said)
    prepared = opened._scenes.get(scene)
    inside = prepared.regions.labels == 3
    lengths = opened._surface[scene]
    expected = class_entropy(said.probabilities)[inside].mean() + lengths[3]
    assert view.score[3] == pytest.approx(expected) and 0 < lengths[3] <= 0.015
    np.testing.assert_allclose(view.features[3], said.features[inside].mean(axis=0), rtol=1e-5)


def test_a_round_that_is_made_again_asks_for_the_same(opened, geometry, tmp_path):
    once = grow(opened, 1).hash
    assert grow(opened, 1).hash == once  # a refresh that was interrupted
    again = source_of(geometry)
    again.open(tmp_path, resume=True)
    assert again.budget.hash == once and grow(again, 1).hash == once
    assert grow(again, 2).hash == grow(opened, 2).hash


def test_hidden_labels_are_not_read(opened, geometry, tmp_path):
    found = [grow(opened, number).hash for number in (1, 2)]
    shown = opened.budget.annotated
    other = source_of(geometry)
    load = other.dataset.load_truth

    def noisy(index):
        truth = load(index)
        hidden = np.setdiff1d(np.flatnonzero(truth.semantic >= 0), shown[other.scene_ids[index]].points)
        truth.semantic[hidden] = (truth.semantic[hidden] + 1) % 3
        return truth

    other._budget, other._total = load_point_budget(Path(tmp_path) / 'budget_round0.json'), 40
    other.dataset.load_truth = noisy
    (tmp_path / 'noisy').mkdir()
    other.open(tmp_path / 'noisy', resume=False)
    assert [grow(other, number).hash for number in (1, 2)] == found


def test_whole_scenes_are_refused(geometry):
    with pytest.raises(BudgetError, match='cannot begin with a part of its points'):
        _ = source_of(geometry, {'scene_percent': 50.0}).budget


def test_features_are_needed(opened):
    scene, said = next(predictions(opened))
    with pytest.raises(ValueError, match='has no pred_point_features'):
        opened.look(scene, PointPrediction(said.probabilities))


def test_a_view_is_small(opened):
    scene, said = next(predictions(opened))
    view = opened.look(scene, said)
    assert isinstance(view, RegionView) and len(view.score) == len(opened._scenes.get(scene).regions)
    assert json.loads((opened._kept(0)).read_text())['kind'] == 'points'
