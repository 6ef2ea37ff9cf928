import numpy as np
import pytest
from steps_scene import clicks, scene

from rm3d_plugin.pseudo_labels.propagation import WalkerRules, propagate
from rm3d_plugin.pseudo_labels.propagation.prepared import prepare_cloud
from rm3d_plugin.pseudo_labels.propagation.scores import (
    BUDGETS,
    draw_clicks,
    painted,
    propagation_scores,
    shown,
    unlabelled_miou,
)
from rm3d_plugin.structures import PointCloud


@pytest.mark.parametrize('colors', [True, False])
def test_labels_spread_over_surfaces_and_pass_the_nearest_label(colors):
    cloud, semantic = scene(colors=colors)
    score = propagation_scores(prepare_cloud(cloud), semantic, np.flatnonzero(clicks(semantic, 3) >= 0))
    assert score.propagated > 95.0
    assert score.propagated > score.nearest + 10.0
    assert np.isnan(score.place_and_colour) == (not colors)


def test_labelled_points_keep_their_labels_even_where_they_contradict_all_others():
    cloud, semantic = scene()
    annotated = clicks(semantic, 5)
    odd = np.flatnonzero(annotated == 0)[0]
    annotated[odd] = 2
    result = propagate(cloud, annotated, 4)
    known = annotated >= 0
    np.testing.assert_array_equal(result.semantic[known], annotated[known])
    np.testing.assert_array_equal(result.confidence[known], 1.0)
    np.testing.assert_allclose(result.probabilities.sum(axis=1), 1.0, atol=1e-5)
    np.testing.assert_array_equal(result.probabilities[:, 3], 0.0)  # nobody showed that class
    np.testing.assert_allclose(result.confidence, result.probabilities.max(axis=1))


def test_the_same_labels_give_the_same_answer_bit_for_bit():
    cloud, semantic = scene()
    annotated = clicks(semantic, 8)
    first, second = (propagate(cloud, annotated, 3) for _ in range(2))
    np.testing.assert_array_equal(first.probabilities, second.probabilities)
    assert first.estimate == second.estimate
    assert first.remark == second.remark


def test_enough_labels_give_an_estimate_and_one_a_class_does_not():
    cloud, semantic = scene()
    many = propagate(cloud, clicks(semantic, 15), 3)
    assert many.estimate is not None
    assert many.estimate.low <= unlabelled_miou(many.semantic, semantic, np.zeros(0, int)) <= 100.0
    assert 'mIoU, from 45 labels' in many.remark
    few = propagate(cloud, clicks(semantic, 1), 3)
    assert few.estimate is None
    assert 'no estimate' in few.remark


def strokes(cloud, semantic, each, radius=0.4):
    """Classes of the points round some of each class, -1 elsewhere."""
    middles = np.flatnonzero(clicks(semantic, each) >= 0)
    return shown(semantic, painted(cloud.xyz, semantic, middles, radius))


def test_a_stroke_is_one_label_however_many_points_it_has():
    cloud, semantic = scene()
    one = strokes(cloud, semantic, 1)
    assert np.bincount(one[one >= 0]).min() > 20
    assert propagate(cloud, one, 3).estimate is None  # nothing can be left out
    some = propagate(cloud, strokes(cloud, semantic, 6, radius=0.2), 3)
    assert some.estimate is not None and 9 <= some.estimate.labels <= 18


def test_strokes_are_no_worse_than_the_clicks_in_their_middles():
    cloud, semantic = scene()
    prepared = prepare_cloud(cloud)
    for each in (1, 6):
        painted_points = np.flatnonzero(strokes(cloud, semantic, each) >= 0)
        alone = propagate(cloud, clicks(semantic, each), 3)
        score = propagation_scores(prepared, semantic, painted_points)
        assert score.result.choice.candidate == 'walker and features'
        assert score.propagated >= unlabelled_miou(alone.semantic, semantic, painted_points) - 1.0


def test_nothing_labelled_one_class_and_everything_labelled():
    cloud, semantic = scene()
    nothing = propagate(cloud, np.full(len(cloud), -1), 3)
    assert (nothing.semantic == -1).all()
    assert (nothing.confidence == 0.0).all()
    one = propagate(cloud, np.where(np.arange(len(cloud)) == 7, 1, -1), 3)
    assert (one.semantic == 1).all()
    every = propagate(cloud, semantic, 3)
    np.testing.assert_array_equal(every.semantic, semantic)


@pytest.mark.parametrize('count', [0, 1, 2, 4])
def test_few_points(count):
    annotated = np.full(count, -1, dtype=np.int64)
    annotated[:2] = np.arange(2)[:count]
    result = propagate(PointCloud(np.arange(3.0 * count).reshape(count, 3)), annotated, 2)
    assert len(result.semantic) == count
    np.testing.assert_array_equal(result.semantic[:2], annotated[:2])


def test_points_in_one_place_and_points_far_away():
    cloud, semantic = scene()
    xyz = np.concatenate([cloud.xyz, cloud.xyz[:300], [[500.0, 0.0, 0.0]] * 40])
    annotated = np.concatenate([clicks(semantic, 5), np.full(340, -1)])
    result = propagate(PointCloud(xyz), annotated, 3)
    assert (result.semantic >= 0).all()
    assert np.isfinite(result.probabilities).all()


def test_wrong_input_is_named():
    cloud, semantic = scene()
    with pytest.raises(ValueError, match='one class a point'):
        propagate(cloud, semantic[:-1], 3)
    with pytest.raises(ValueError, match='classes below 2'):
        propagate(cloud, semantic, 2)


def test_settings_without_leaving_out():
    cloud, semantic = scene()
    assert propagate(cloud, clicks(semantic, 15), 3, WalkerRules(folds=0)).estimate is None


def test_draws_are_what_they_say():
    _, semantic = scene()
    semantic = np.where(np.arange(len(semantic)) % 5 == 0, -1, semantic)
    sizes = [len(draw_clicks(semantic, budget, np.random.default_rng(0))) for budget in BUDGETS]
    assert sizes == [3, 20, 60]
