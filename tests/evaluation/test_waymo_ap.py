"""Waymo's AP and APH, by hand and beside a slow twin."""

import doctest
from importlib import import_module

import numpy as np
import pytest
import torch
from mmengine.evaluator import Evaluator
from reference.waymo_ap_slow import waymo_ap_slow

from rm3d_plugin.datasets.waymo_format import WaymoBoxes
from rm3d_plugin.evaluation.functional import WaymoTruth, waymo_ap
from rm3d_plugin.evaluation.functional.waymo_ap import CUTOFFS, area_under_curve, match
from rm3d_plugin.registry import METRICS
from rm3d_plugin.structures import Boxes3D, SceneSample

CAR = np.array([0.0, 0, 1, 4, 2, 2, 0.3])


def cars(*shifts, yaw=0.3):
    rows = np.tile(CAR, (len(shifts), 1))
    rows[:, 0], rows[:, 6] = shifts, yaw
    return rows


def truth(boxes, level=None):
    return WaymoTruth(
        boxes, np.zeros(len(boxes), dtype=np.int64), np.array([1] * len(boxes) if level is None else level)
    )


def found(boxes, scores):
    return Boxes3D(boxes, np.zeros(len(boxes), dtype=np.int64), np.array(scores, dtype=np.float64))


def scores_of(truths, detections):
    return {
        (entry.level, what): getattr(entry, what)
        for entry in waymo_ap(truths, detections, ['Vehicle'])
        for what in ('ap', 'aph')
    }


def test_perfect_and_turned_around():
    boxes = cars(0, 10, 20)
    got = scores_of([truth(boxes)], [found(boxes, [0.9, 0.8, 0.7])])
    assert all(value == pytest.approx(1) for value in got.values())
    back = scores_of([truth(boxes)], [found(cars(0, 10, 20, yaw=0.3 + np.pi), [0.9, 0.8, 0.7])])
    assert back[1, 'ap'] == pytest.approx(1) and back[1, 'aph'] == pytest.approx(0)
    quarter = scores_of([truth(boxes)], [found(boxes + [0, 0, 0, 0, 0, 0, 2 * np.pi], [0.9, 0.8, 0.7])])
    assert quarter[2, 'aph'] == pytest.approx(1)  # a whole turn is none


def test_what_is_missed_at_level_two_costs_nothing_at_level_one_and_what_is_found_counts_at_both():
    boxes = cars(0, 10, 20)
    missed = scores_of([truth(boxes, [1, 1, 2])], [found(boxes[:2], [0.9, 0.9])])
    assert missed[1, 'ap'] == pytest.approx(1)
    assert missed[2, 'ap'] == pytest.approx(2 / 3, abs=1e-6)
    hit = scores_of([truth(boxes, [1, 2, 2])], [found(boxes[1:], [0.9, 0.9])])
    assert hit[1, 'ap'] == pytest.approx(2 / 3, abs=1e-6)  # two hits, one truth of level 1 missed


def test_matching_maximises_the_sum_not_the_first_choice():
    overlap = np.array([[0.9, 0.8], [0.85, 0.1]], dtype=np.float32)
    assert [pair.tolist() for pair in match(overlap, 0.7)] == [[0, 1], [1, 0]]
    assert [len(pair) for pair in match(overlap[:, 1:], 0.85)] == [0, 0]


def test_the_area_by_hand():
    assert area_under_curve(np.array([0.5, 1.0]), np.array([0.5, 0.0])) == pytest.approx(0.25)
    # from recall 1 down to .55 the precision is .5, then a slope up to 1 at .5, then 1
    assert area_under_curve(np.array([0.5, 1.0]), np.array([1.0, 0.5])) == pytest.approx(0.45 * 0.5 + 0.05 * 0.75 + 0.5)
    assert area_under_curve(np.array([0.5, 0.6]), np.array([0.48, 0.5])) == pytest.approx(0.3)


@pytest.mark.parametrize('seed', range(12))
def test_as_the_slow_twin(seed):
    rng = np.random.default_rng(seed)
    frames, truths, detections = [], [], []
    for _ in range(3):
        count = int(rng.integers(0, 4))
        boxes = cars(*rng.uniform(0, 12, count), yaw=rng.uniform(-3, 3, count)) if count else np.zeros((0, 7))
        level = rng.integers(1, 3, count)
        guesses = np.concatenate([boxes, boxes[:1]]) + rng.normal(0, 0.12, (len(boxes) + len(boxes[:1]), 7))
        scores = np.round(rng.random(len(guesses)), 3)
        frames.append((boxes, level, guesses, np.float32(scores)))
        truths.append(truth(boxes, level))
        detections.append(found(guesses, scores))
    got = scores_of(truths, detections)
    for level in (1, 2):
        if not any((t.level <= level).any() for t in truths):
            assert np.isnan(got[level, 'ap'])
            continue
        expected = waymo_ap_slow(frames, np.float32(0.7), level, np.float32(CUTOFFS))
        assert (got[level, 'ap'], got[level, 'aph']) == pytest.approx(expected, abs=2e-5)


def sample(annotation, boxes, labels, scores):
    out = SceneSample(metainfo={'scene_id': 's_1', 'annotation': annotation})
    out.pred_bboxes_3d = torch.as_tensor(boxes, dtype=torch.float32)
    out.pred_labels_3d = torch.as_tensor(labels)
    out.pred_scores_3d = torch.as_tensor(scores, dtype=torch.float32)
    return out


def test_the_metric_passes_over_signs_and_boxes_without_a_point():
    boxes = cars(0, 10, 20, 30)
    annotation = WaymoBoxes(boxes, np.array([1, 3, 2, 1]), np.array([50, 50, 4, 0]), np.array([1, 1, 2, 2]))
    evaluator = Evaluator([METRICS.build({'type': 'WaymoMetric'})])
    evaluator.dataset_meta = {'classes': ('Vehicle', 'Pedestrian', 'Cyclist')}
    evaluator.process([sample(annotation, boxes[[0, 2]], [0, 1], [0.9, 0.9])], None)
    got = evaluator.evaluate(1)
    assert got['Vehicle_L1_AP'] == got['Vehicle_L2_APH'] == pytest.approx(100, abs=1e-3)
    assert got['Pedestrian_L2_AP'] == pytest.approx(100, abs=1e-3)
    assert not any(name.startswith(('Cyclist', 'Pedestrian_L1')) for name in got)
    assert got['L1_mAPH'] == got['L2_mAP'] == pytest.approx(100, abs=1e-3)
    (metric,) = evaluator.metrics
    assert [record.headline for record in metric.records if record.headline] == ['L2 mAPH']


def test_scores_by_distance_split_both_sides_by_their_own_place():
    boxes = cars(10, 29, 40, 60)
    annotation = WaymoBoxes(boxes, np.array([1, 1, 1, 1]), np.array([50] * 4), np.array([1] * 4))
    evaluator = Evaluator([METRICS.build({'type': 'WaymoMetric', 'classes': ['Vehicle']})])
    shifted = (
        boxes + np.array([[0.0], [2.0], [0.0], [30.0]]) * np.eye(7)[0]
    )  # the second leaves its range, the last is wrong
    evaluator.process([sample(annotation, shifted, [0] * 4, [0.9] * 4)], None)
    got = evaluator.evaluate(1)
    assert got['Vehicle_L1_AP 0-30 m'] == pytest.approx(50, abs=1e-3)  # one of two, nothing false
    assert got['Vehicle_L1_AP 30-50 m'] == pytest.approx(50, abs=1e-3)  # found, and one false
    assert got['Vehicle_L2_APH 50 m+'] == 0
    (metric,) = evaluator.metrics
    assert {record.table for record in metric.records} == {'objects', 'ranges'}


def test_errors():
    with pytest.raises(ValueError, match='1 frames of truth, 0 of detections'):
        waymo_ap([truth(cars(0))], [], ['Vehicle'])
    with pytest.raises(ValueError, match="no value for class 'Boat'"):
        waymo_ap([], [], ['Boat'])
    with pytest.raises(ValueError, match='1 scores are NaN'):
        waymo_ap([truth(cars(0))], [found(cars(0), [np.nan])], ['Vehicle'])


def test_doctests():
    failed, tried = doctest.testmod(import_module('rm3d_plugin.evaluation.functional.waymo_ap'))
    assert tried >= 2 and failed == 0
