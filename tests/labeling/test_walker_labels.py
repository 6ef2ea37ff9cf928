"""Labels that spread by a random walk, round by round; the network must be judged."""

import shutil

import numpy as np
import pytest
from labeling import rounds
from labeling.test_segmentation_labels import certain
from reference.toy_scenes import ToyRooms

from rm3d_plugin.labeling import (
    AnnotatedLabelMaker,
    PointBudgetSource,
    SegmentationLabelMaker,
    WalkerLabelMaker,
    point_label_maker,
)
from rm3d_plugin.labeling.scan_knowledge import share_of_each
from rm3d_plugin.labeling.walker import few_of_each
from rm3d_plugin.pseudo_labels import PointPrediction

GEOMETRY = {'descriptor': {'type': 'AdaptedPFH'}, 'oversegmenter': {'type': 'RegionGrowing'}}


def label_maker(tmp_path, budget='20pts', **settings):
    source = PointBudgetSource(ToyRooms(3), budget, 0)
    return WalkerLabelMaker(tmp_path / 'labels', source, cache=tmp_path / 'cache', **GEOMETRY, **settings)


def refresh(made, number, prediction_of, log=rounds.quiet):
    made.begin(number)
    said = [(scene, prediction_of(made.source.truth(index))) for scene, index in made.index_of.items()]
    made.refresh_all(number, said)
    rounds.close(made, number, log)


def wrong(truth):
    """A prediction that names the next class, surely."""
    shares = certain(truth).probabilities
    return PointPrediction(np.roll(shares, 1, axis=1), None)


def of(made, number):
    return [made.store.read(scene, number) for scene in made.index_of]


def test_first_labels_are_pure_and_cover_most(tmp_path):
    made = label_maker(tmp_path, rounds=3)
    rounds.start(made)
    summary = made.store.summary(0)
    assert summary['precision'] > 0.9 and summary['coverage'] > 0.5
    assert summary['estimate'] is None or 0 <= summary['estimate']['low'] <= summary['estimate']['high'] <= 100
    shown = made.told(0, 'room0').semantic
    labels = made.store.read('room0', 0)
    np.testing.assert_array_equal(labels.semantic[shown >= 0], shown[shown >= 0])
    assert (labels.confidence[labels.semantic >= 0] >= made.rules.accept).all()


def test_training_is_not_told_the_labels_that_judge_until_the_last_round(tmp_path):
    made = label_maker(tmp_path, rounds=3)
    judges = made.known.judges['room0']
    everything = made.annotated('room0').semantic
    assert len(judges) and (everything[judges] >= 0).all()
    for number in (0, 1):
        assert (made.told(number, 'room0').semantic[judges] == -1).all()
    np.testing.assert_array_equal(made.told(2, 'room0').semantic, everything)


def test_a_network_that_is_wrong_changes_nothing(tmp_path):
    made, told = label_maker(tmp_path, rounds=3), []
    rounds.start(made)
    refresh(made, 1, wrong, told.append)
    assert any('geometry stand' in line for line in told)
    for first, second in zip(of(made, 0), of(made, 1), strict=True):
        np.testing.assert_array_equal(first.semantic, second.semantic)
    assert made.store.summary(1)['estimate'] == made.store.summary(0)['estimate']


def test_a_run_that_is_taken_up_makes_the_same_labels(tmp_path):
    unbroken = label_maker(tmp_path / 'a', rounds=4)
    rounds.start(unbroken)
    refresh(unbroken, 1, certain)
    shutil.copytree(tmp_path / 'a' / 'labels', tmp_path / 'b' / 'labels')
    resumed = label_maker(tmp_path / 'b', rounds=4)
    for each in (unbroken, resumed):
        refresh(each, 2, wrong)
    for first, second in zip(of(unbroken, 2), of(resumed, 2), strict=True):
        np.testing.assert_array_equal(first.semantic, second.semantic)
        np.testing.assert_array_equal(first.confidence, second.confidence)
    assert unbroken.store.summary(2) == resumed.store.summary(2)


def test_labels_of_a_version_that_says_no_weight_are_made_again(tmp_path):
    made = label_maker(tmp_path, rounds=4)
    rounds.start(made)
    old = {key: value for key, value in made.store.summary(0).items() if key != 'network_weight'}
    made.store.finish_round(0, old | {'network_pull': 0.0})
    refresh(made, 1, wrong)
    for first, second in zip(of(made, 0), of(made, 1), strict=True):
        np.testing.assert_array_equal(first.semantic, second.semantic)
    assert made.store.summary(1)['network_weight'] == 0.0


def test_a_network_that_is_right_is_heard_where_labels_are_few(tmp_path):
    made = label_maker(tmp_path, 'onept', rounds=3, walker={'judging': 0.4})
    rounds.start(made)
    refresh(made, 1, certain)
    if made._say.weight:
        assert made.store.summary(1)['precision'] >= made.store.summary(0)['precision'] - 0.01
    assert made._say.labels == sum(len(rows) for rows in made.known.judges.values())


def test_complete_scenes_keep_their_labels(tmp_path):
    made = label_maker(tmp_path, 'scenes34pct', rounds=2)
    rounds.start(made)
    (complete,) = made.source.budget.complete
    truth = made.source.truth(made.index_of[complete])
    np.testing.assert_array_equal(made.store.read(complete, 0).semantic, truth.semantic)
    others = [scene for scene in made.index_of if scene != complete]
    assert all(made.store.read(scene, 0).coverage > 0.2 for scene in others)  # what the complete one teaches


def test_instances_spread_where_they_are_asked_for(tmp_path):
    without, made = label_maker(tmp_path / 'a'), label_maker(tmp_path / 'b', instances=True)
    for each in (without, made):
        rounds.start(each)
    alone, spread = without.store.read('room1', 0), made.store.read('room1', 0)
    truth = made.source.truth(made.index_of['room1'])
    given = spread.instance >= 0
    assert np.count_nonzero(given) > np.count_nonzero(alone.instance >= 0)
    things = np.isin(spread.semantic, made.source.thing_classes)
    assert (things | spread.point_is_annotated)[given].all()
    right = given & (truth.semantic == spread.semantic)
    assert np.mean(spread.instance[right] == truth.instance[right]) > 0.8


@pytest.mark.parametrize(
    ('settings', 'kind'),
    [
        ({}, WalkerLabelMaker),
        ({'strategy': 'regions'}, SegmentationLabelMaker),
        ({'strategy': 'paper'}, SegmentationLabelMaker),
        ({'propagate': False}, AnnotatedLabelMaker),
    ],
)
def test_a_config_chooses_how_labels_are_made(tmp_path, settings, kind):
    source = PointBudgetSource(ToyRooms(2), '20pts')
    made = point_label_maker(tmp_path, source, merge={'rounds': 4}, cache=tmp_path, **GEOMETRY, **settings)
    assert type(made) is kind


def test_a_strategy_that_there_is_not_is_told(tmp_path):
    with pytest.raises(ValueError, match='strategy: expected one of default, regions, paper'):
        point_label_maker(tmp_path, PointBudgetSource(ToyRooms(2), '20pts'), strategy='best')


def test_a_share_of_each_class():
    classes = np.repeat([0, 1, 2], [50, 10, 4])
    kept = share_of_each(classes, 0.2, 0)
    assert np.bincount(classes[kept], minlength=3).tolist() == [10, 2, 0]
    np.testing.assert_array_equal(kept, share_of_each(classes, 0.2, 0))


def test_few_of_each_class():
    few = few_of_each(np.array([0, 0, 0, -1, 1, 1]), 2)
    assert few.tolist() == [0, -1, 0, -1, 1, 1]
