"""Labels of a scene from predicted boxes: an annotated car, an accepted one, a doubtful one, and background."""

from dataclasses import replace

import numpy as np
import pytest
from pseudo_labels.region_graphs import make_graph

from rm3d_plugin.pseudo_labels import (
    AnnotatedLabels,
    ObjectKnowledge,
    PointPrediction,
    RoundContext,
    SceneInputs,
    detection_rules,
    refresh_detection,
)
from rm3d_plugin.pseudo_labels.detection.clusters import ObjectClusters
from rm3d_plugin.pseudo_labels.detection.refresh import find_candidates
from rm3d_plugin.pseudo_labels.detection.teacher import BoxLimits
from rm3d_plugin.regions.prepare import PreparedScene
from rm3d_plugin.structures import Boxes3D, PointCloud, Regions

PLACES, EACH = (10.0, 20.0, 30.0, 40.0), 9  # the annotated car, three others
SIZES = np.array([[4.0, 2.0, 1.5]])
GROUND, FREE = slice(36, 40), slice(40, 44)  # points without a region; the last hang in the air


def car(x):
    return [x, 0.0, 0.75, 4.0, 2.0, 1.5, 0.0]


def scene(previous=None, scores=(0.9, 0.6, 0.2), background=0.99):
    along = np.linspace(-1.0, 1.0, EACH)
    cars = np.concatenate([np.c_[x + along, 0 * along, 0.75 + 0.7 * along] for x in PLACES])  # up to 1.45 m
    rest = np.array([[x, 8.0, z] for z in (0.0, 1.0) for x in (5.0, 15.0, 25.0, 35.0)])
    xyz = np.concatenate([cars, rest])
    region = np.r_[np.repeat(np.arange(4), EACH), np.full(8, -1)]
    geometry = PreparedScene(PointCloud(xyz), Regions(region), make_graph(4))
    known = np.where(region == 0, 0, -1)
    rows = np.tile([0.8, 0.2], (len(xyz), 1))
    rows[FREE] = [1 - background, background]
    boxes = Boxes3D(np.array([car(x) for x in (10.2, *PLACES[1:])]), np.zeros(4, int), np.array([0.8, *scores]))
    annotated = AnnotatedLabels(known, known, Boxes3D(np.array([car(10.0)]), np.zeros(1, int)))
    return SceneInputs(geometry, annotated, PointPrediction(rows, None, boxes), previous)


def refresh(inputs, accept=0.5, clusters=None, **teacher):
    rules = detection_rules(teacher={'top': 0.95} | teacher)
    limits = BoxLimits(np.array([accept]), np.array([0.3]), np.array([2.0]))
    knowledge = ObjectKnowledge(SIZES, inputs.xyz[:, 2], box_limits=limits, clusters=clusters)
    return refresh_detection(inputs, RoundContext(1, rules, np.array([1])), knowledge)


def test_labels_by_hand():
    got = refresh(scene())
    labels = got.labels
    assert labels.boxes.tensor[:, 0].tolist() == [10.0, 20.0, 30.0]
    assert labels.box_is_annotated.tolist() == [True, False, False]
    assert labels.semantic.tolist() == [0] * 27 + [-1] * 9 + [1] * 8  # of the car at 40 nobody says anything
    assert labels.instance.tolist() == [0] * 9 + [1] * 9 + [2] * 9 + [-1] * 17
    assert {step: int(lost[0]) for step, lost in got.steps.items()} == {
        'found': 4, 'size': 0, 'looks': 0, 'collision': 1, 'points': 0, 'above': 0, 'low': 0, 'high': 0,
        'unrecognised': 0, 'doubt': 0, 'score': 1
    }  # fmt: skip


def test_what_is_too_low_for_any_object_is_background():
    inputs = scene()
    inputs.geometry.cloud.xyz[27:36, 2] *= 0.5  # what the box at 40 holds ends at .73 m
    got = refresh(inputs, seen_height=0.85)
    assert got.labels.semantic.tolist() == [0] * 27 + [1] * 17 and got.steps['low'].tolist() == [1]
    assert (refresh(inputs, top=0.0).labels.semantic[27:36] == -1).all()


def test_a_label_falls_again():
    first = refresh(scene())
    second = refresh(scene(first.labels, scores=(0.9, 0.4, 0.2)))
    assert second.labels.boxes.tensor[:, 0].tolist() == [10.0, 20.0]
    assert (second.labels.semantic[18:27] == -1).all()  # doubtful now


def test_the_network_makes_background_only_where_it_is_sure_and_allowed():
    assert (refresh(scene(background=0.9)).labels.semantic[FREE] == -1).all()
    alone = refresh(scene(), background=None).labels.semantic
    assert (alone[FREE] == -1).all() and (alone[GROUND] == 1).all()


def test_instances_propose_boxes_where_that_is_asked():
    """Points of one class that vote for one place are an object, whatever boxes the network predicts."""
    inputs = scene(scores=(0.0, 0.0, 0.0))
    votes = inputs.xyz + [0.0, 0.0, 0.3]
    votes[:36] = np.repeat([[x, 0.0, 1.0] for x in PLACES], EACH, axis=0)
    rows = inputs.probabilities.copy()
    rows[36:] = [0.1, 0.9]
    inputs = replace(inputs, prediction=PointPrediction(rows, votes, inputs.prediction.boxes))
    got = refresh(inputs, source='instances').labels
    assert got.boxes.tensor[0, 0] == 10.0 and got.box_is_annotated.tolist() == [True, False, False, False]
    assert got.boxes.scores.tolist() == pytest.approx([1.0, 0.8, 0.8, 0.8])
    assert got.boxes.tensor[1:, 0] == pytest.approx(PLACES[1:], abs=1.3)  # its front or its back is seen
    blind = replace(inputs, prediction=PointPrediction(rows, None, inputs.prediction.boxes))
    with pytest.raises(ValueError, match=r"predicted_boxes\.source: 'instances' needs where points vote"):
        refresh(blind, source='instances')


def clusters_of_cars(*likeness):
    """Each car is a cluster, the annotated one first; its likeness to the others is .8."""
    point = np.r_[np.repeat(np.arange(4), EACH), np.full(8, -1)]
    return ObjectClusters(point, np.array([1.0, *likeness])[:, None], np.array([0.8]))


def test_what_has_no_shape_of_a_class_is_background():
    got = refresh(scene(), clusters=clusters_of_cars(0.9, 0.2, 0.5), least_likeness=0.3)
    assert got.labels.boxes.tensor[:, 0].tolist() == [10.0, 20.0] and got.steps['looks'].tolist() == [1]
    assert got.labels.semantic.tolist() == [0] * 18 + [1] * 9 + [-1] * 9 + [1] * 8
    unasked = refresh(scene(), clusters=clusters_of_cars(0.9, 0.2, 0.5)).labels
    assert unasked.boxes.tensor[:, 0].tolist() == [10.0, 20.0, 30.0]


def test_the_network_makes_no_background_of_what_looks_like_an_object():
    """It is sure that the last two cars are background; the last is not like the annotated one."""
    inputs = scene(scores=(0.9, 0.0, 0.0))
    rows = inputs.prediction.probabilities.copy()
    rows[18:36] = [0.01, 0.99]
    inputs = replace(inputs, prediction=PointPrediction(rows, None, inputs.prediction.boxes))
    alone = refresh(inputs, clusters=clusters_of_cars(0.9, 0.7, 0.4)).labels
    assert alone.semantic[18:36].tolist() == [1] * 18  # where clusters are not asked the network is believed
    asked = refresh(inputs, clusters=clusters_of_cars(0.9, 0.7, 0.4), least_likeness=0.3).labels
    assert asked.semantic[18:36].tolist() == [-1] * 9 + [1] * 9 and asked.semantic[36:].tolist() == [1] * 8
    all_spared = refresh(inputs, clusters=clusters_of_cars(0.9, 0.7, 0.4), least_likeness=0.3, usual_likeness=0.35)
    assert all_spared.labels.semantic[18:36].tolist() == [-1] * 18
    with pytest.raises(ValueError, match=r'usual_likeness: expected a share from least_likeness, 0.6, to 1'):
        refresh(inputs, least_likeness=0.6)


def test_shapes_make_background_before_any_network_is_asked():
    inputs = replace(scene(), prediction=None)
    knowledge = ObjectKnowledge(SIZES, inputs.xyz[:, 2], clusters=clusters_of_cars(0.9, 0.2, 0.5))
    rules = detection_rules(teacher={'least_likeness': 0.3})
    got = refresh_detection(inputs, RoundContext(0, rules, np.array([1])), knowledge).labels
    assert len(got.boxes) == 1 and got.semantic[:36].tolist() == [0] * 9 + [-1] * 9 + [1] * 9 + [-1] * 9


def test_clusters_propose_boxes_where_that_is_asked():
    """A cluster's score is what the network says of its points, times how like annotated objects it is."""
    inputs = scene(scores=(0.0, 0.0, 0.0))
    clusters = clusters_of_cars(2.0, 0.75, 0.4)
    got = refresh(inputs, clusters=clusters, source='clusters').labels
    assert got.boxes.scores.tolist() == pytest.approx([1.0, 0.8, 0.6])  # .32 is in doubt
    assert got.boxes.tensor[1:, 0] == pytest.approx(PLACES[1:3], abs=1.3)
    knowledge = ObjectKnowledge(SIZES, inputs.xyz[:, 2], clusters=clusters)
    shown = find_candidates(inputs, detection_rules(teacher={'source': 'clusters'}), knowledge).shown
    assert shown.scores.tolist() == pytest.approx([0.8 * 0.8])
    with pytest.raises(ValueError, match=r'predicted_boxes\.source: needs clusters, but nobody gave them'):
        refresh(inputs, source='clusters')
    with pytest.raises(ValueError, match=r'predicted_boxes\.least_likeness: needs clusters'):
        refresh(inputs, least_likeness=0.2)


def test_without_limits_nothing_is_accepted():
    inputs = scene()
    knowledge = ObjectKnowledge(SIZES, inputs.xyz[:, 2])
    got = refresh_detection(inputs, RoundContext(0, detection_rules(teacher={}), np.array([1])), knowledge)
    assert len(got.labels.boxes) == 1 and got.steps['unrecognised'].tolist() == [3]


def test_candidates_and_what_annotated_objects_tell():
    inputs = scene()
    knowledge = ObjectKnowledge(SIZES, inputs.xyz[:, 2])
    got = find_candidates(inputs, detection_rules(teacher={}), knowledge)
    assert got.boxes.tensor[:, 0].tolist() == [20.0, 30.0, 40.0]
    assert got.shown.scores.tolist() == [0.8] and got.shown.probs.tolist() == pytest.approx([0.8])
    with pytest.raises(ValueError, match='teacher is None'):
        find_candidates(inputs, detection_rules(), knowledge)


def test_a_refitted_box_touches_the_points():
    got = refresh(scene(), refit=True).labels.boxes.tensor
    assert got[1:, 3:6].tolist() == [[4.0, 2.0, 1.5]] * 2
    assert got[1, 0] > 20.5  # the points begin at 19, and the sensor is at 0: the rest of the car lies behind them
