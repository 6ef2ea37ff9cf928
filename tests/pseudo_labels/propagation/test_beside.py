import numpy as np
import pytest
from steps_scene import FLOOR, SHELF, WALL, clicks, scene

from rm3d_plugin.pseudo_labels.propagation import Beside, WalkerRules, examples_of, prepare_cloud, propagate_prepared
from rm3d_plugin.pseudo_labels.propagation.network import trial_of, walk_without
from rm3d_plugin.pseudo_labels.propagation.propagate import labels_of
from rm3d_plugin.pseudo_labels.propagation.rules import NetworkSay
from rm3d_plugin.pseudo_labels.propagation.scores import painted, unlabelled_miou


def network_of(semantic, right, classes=4, sure=0.9):
    """Probabilities of a network that names the true class, or the next one."""
    named = semantic if right else (semantic + 1) % 3
    out = np.full((len(semantic), classes), (1.0 - sure) / (classes - 1), dtype=np.float32)
    out[np.arange(len(semantic)), named] = sure
    return out


def test_examples_of_other_scans_name_a_class_without_a_label_if_it_may_be_there():
    cloud, semantic = scene(seed=1)
    lent = examples_of(prepare_cloud(cloud), clicks(semantic, 20))
    here, there = scene(seed=2)
    annotated = clicks(there, 5)
    annotated[annotated == WALL] = -1
    prepared, possible = prepare_cloud(here), np.array([False, False, True, False])
    closed = propagate_prepared(prepared, annotated, 4, beside=Beside(*lent))
    assert WALL not in closed.semantic
    opened = propagate_prepared(prepared, annotated, 4, beside=Beside(*lent, possible=possible))
    assert unlabelled_miou(opened.semantic, there, np.flatnonzero(annotated >= 0)) > 80.0
    assert 3 not in opened.semantic


def test_examples_alone_label_a_scan():
    cloud, semantic = scene(seed=1)
    lent = examples_of(prepare_cloud(cloud), clicks(semantic, 20))
    here, there = scene(seed=2)
    beside = Beside(*lent, possible=np.ones(3, dtype=bool))
    result = propagate_prepared(prepare_cloud(here), np.full(len(here), -1), 3, beside=beside)
    assert np.mean(result.semantic == there) > 0.9


@pytest.mark.parametrize('right', [True, False])
def test_a_network_speaks_if_labels_that_it_was_not_taught_are_for_it(right):
    cloud, semantic = scene()
    annotated = np.where(np.isin(semantic, (FLOOR, SHELF)), clicks(semantic, 2), -1)
    annotated[np.flatnonzero(semantic == WALL)[:1]] = WALL
    judged = clicks(semantic, 10, seed=3)
    unseen = (judged >= 0) & (annotated < 0)
    annotated = np.where(unseen, judged, annotated)
    network = network_of(semantic, right)
    network[::7] = np.nan
    prepared = prepare_cloud(cloud)
    beside = Beside(network=network, unseen=unseen, possible=np.ones(4, dtype=bool))
    result = propagate_prepared(prepared, annotated, 4, beside=beside)
    alone = propagate_prepared(prepared, annotated, 4)
    scores = [unlabelled_miou(each.semantic, semantic, np.flatnonzero(annotated >= 0)) for each in (result, alone)]
    assert np.isfinite(result.probabilities).all()
    assert scores[0] >= scores[1] - 1.0
    assert 'network' in result.remark
    if not right:
        assert result.network_weight == 0.0


@pytest.mark.parametrize('others', [False, True])
def test_a_network_that_alone_knows_a_class_is_heard_if_labels_of_others_judge_it_too(others):
    cloud, semantic = scene()
    judged = clicks(semantic, 12, seed=3)
    unseen = judged == WALL
    if others:
        unseen[np.flatnonzero(judged == FLOOR)[:6]] = True
        unseen[np.flatnonzero(judged == SHELF)[:6]] = True
    network = network_of(semantic, right=True, classes=3)
    beside = Beside(network=network, unseen=unseen)
    result = propagate_prepared(prepare_cloud(cloud), judged, 3, beside=beside)
    assert (result.network_weight > 0.0) == others


def test_a_say_without_a_network_is_none():
    cloud, semantic = scene()
    prepared, annotated = prepare_cloud(cloud), clicks(semantic, 5)
    result = propagate_prepared(prepared, annotated, 3, beside=Beside(say=NetworkSay(1.0, 1.0, 9)))
    assert result.network_weight == 0.0
    np.testing.assert_array_equal(result.semantic, propagate_prepared(prepared, annotated, 3).semantic)


def test_without_labels_that_it_was_not_taught_a_network_has_no_say():
    cloud, semantic = scene()
    prepared, annotated = prepare_cloud(cloud), clicks(semantic, 5)
    network = network_of(semantic, right=True, classes=3)
    result = propagate_prepared(prepared, annotated, 3, beside=Beside(network=network))
    assert result.network_weight == 0.0
    np.testing.assert_array_equal(result.semantic, propagate_prepared(prepared, annotated, 3).semantic)


def test_what_does_not_fit_is_named():
    cloud, semantic = scene()
    prepared, annotated = prepare_cloud(cloud), clicks(semantic, 1)
    features, classes = examples_of(prepared, annotated)
    wrong = {
        'features': Beside(features[:, 1:], classes),
        'go together': Beside(features),
        '0 to 2': Beside(features, classes + 1),
        'possible': Beside(possible=np.ones(4, dtype=bool)),
        'network': Beside(network=np.zeros((3, 3), np.float32)),
        'unseen': Beside(unseen=np.zeros(3, dtype=bool)),
    }
    for name, beside in wrong.items():
        with pytest.raises(ValueError, match=name):
            propagate_prepared(prepared, annotated, 3, beside=beside)


def test_of_a_stroke_one_label_judges_and_none_is_told():
    cloud, semantic = scene()
    annotated = clicks(semantic, 4)
    stroke = painted(cloud.xyz, semantic, np.flatnonzero(annotated == WALL)[:1], 0.3)
    annotated[stroke] = semantic[stroke]
    unseen = np.zeros(len(semantic), dtype=bool)
    unseen[stroke] = True
    prepared = prepare_cloud(cloud)
    present, labels = labels_of(prepared, annotated, 3, Beside())
    trial = trial_of(prepared, labels, network_of(semantic, right=True, classes=3)[:, present], unseen)
    assert len(stroke) > 10 and trial.hidden.sum() == len(stroke) and trial.judges.sum() == 1
    told = labels.select(~trial.hidden)
    assert not np.isin(stroke, told.points).any() and len(told.points) == len(labels.points) - len(stroke)
    assert walk_without(trial, WalkerRules()).shares.shape == (1, 3)
    network = network_of(semantic, right=True, classes=3)[:, present]
    network[stroke[1:]] = np.nan  # it saw one point of the stroke alone: that is asked, and none of the others is told
    half = trial_of(prepared, labels, network, unseen)
    assert labels.points[half.judges].tolist() == [stroke[0]] and (half.hidden == trial.hidden).all()
    unseen[stroke[0]] = False  # the network was taught a part of the stroke: it knows the rest
    assert trial_of(prepared, labels, network_of(semantic, right=True, classes=3)[:, present], unseen) is None


def test_an_example_of_other_scans_is_a_region_and_not_each_point_of_a_stroke():
    cloud, semantic = scene()
    prepared, stroke = prepare_cloud(cloud), np.full(len(cloud), -1)
    own = prepared.scales[0].region == prepared.scales[0].region[np.flatnonzero(semantic == WALL)[0]]
    stroke[own] = WALL
    features, classes = examples_of(prepared, stroke)
    assert own.sum() > 1 and classes.tolist() == [WALL] and len(features) == 1
