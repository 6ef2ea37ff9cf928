"""The summary of a round, added up by hand."""

import json

import numpy as np
import pytest

from rm3d_plugin.evaluation.functional import SceneTruth
from rm3d_plugin.labeling.round_summary import (
    box_warnings,
    describe_round,
    summarise_boxes,
    with_agreement,
    with_steps,
)
from rm3d_plugin.structures import Boxes3D, PseudoLabels

CLASSES = ('Car', 'Pedestrian', 'Cyclist')  # 3 = background


def labels(semantic, is_annotated, boxes=(), box_labels=(), box_is_annotated=()):
    semantic, is_annotated = np.array(semantic), np.array(is_annotated, dtype=bool)
    return PseudoLabels(
        semantic=semantic,
        instance=np.full(len(semantic), -1),
        point_is_annotated=is_annotated,
        confidence=(semantic >= 0).astype(np.float32),
        boxes=Boxes3D(np.array(boxes, dtype=float).reshape(-1, 7), np.array(box_labels, dtype=np.int64)),
        box_is_annotated=np.array(box_is_annotated, dtype=bool),
    )


def car(x):
    return [x, 0, 0, 4, 2, 1.5, 0]


def walker(x):
    return [x, 5, 0, 0.8, 0.8, 1.8, 0]


FIRST = labels(
    [0, 0, 3, 3, 1, -1, -1, -1], [1, 0, 0, 0, 0, 0, 0, 0], [car(10), car(20), walker(9)], [0, 0, 1], [1, 0, 0]
)
SECOND = labels([3, -1], [0, 0])
TRUTHS = (
    SceneTruth(
        np.array([0, 0, 3, 0, 3, 3, 3, 3]),
        boxes=Boxes3D(np.array([car(10), car(20.5), walker(30)], dtype=float), np.array([0, 0, 1])),
    ),
    SceneTruth(np.array([3, 3]), boxes=Boxes3D.empty()),
)


def test_points_and_boxes_are_added_up_over_scenes():
    summary = summarise_boxes([(FIRST, TRUTHS[0]), (SECOND, TRUTHS[1])], CLASSES)
    assert summary['coverage'] == pytest.approx(6 / 10) and summary['truth_known'] is True
    assert {name: (row['pseudo'], row['precision']) for name, row in summary['points'].items()} == {
        'Car': (1, 1.0),
        'Pedestrian': (1, 0.0),
        'Cyclist': (0, None),
        'background': (3, pytest.approx(2 / 3)),
    }
    assert summary['precision'] == pytest.approx(3 / 5)
    assert summary['mean_precision'] == pytest.approx((1 + 0 + 2 / 3) / 3)
    assert summary['ranges']['>=0 m']['present'] == 9 and summary['ranges']['>=15 m']['precision'] is None
    assert summary['boxes'] == {
        'Car': {'annotated': 1, 'pseudo': 1, 'correct': 1, 'true': 2},
        'Pedestrian': {'annotated': 0, 'pseudo': 1, 'correct': 0, 'true': 1},
        'Cyclist': {'annotated': 0, 'pseudo': 0, 'correct': 0, 'true': 0},
    }
    json.dumps(summary)
    line = describe_round(summary)
    assert line.startswith('coverage 60.0 %, precision 60.0 %; Car 1 points (100 % correct); Pedestrian 1 po')
    assert (
        'Cyclist 0 points; background 3 points (67 % correct); Car boxes 1 annotated + 1 pseudo, 1 correct of 2' in line
    )


@pytest.mark.parametrize('scenes', [[(FIRST, None), (SECOND, None)], []])
def test_without_truth_only_what_there_is_is_counted(scenes):
    summary = summarise_boxes(scenes, CLASSES)
    assert summary['truth_known'] is False and summary['coverage'] == (0.6 if scenes else 0.0)
    assert [row['precision'] for row in summary['points'].values()] == [None] * 4
    there = 1 if scenes else 0
    assert summary['boxes']['Car'] == {'annotated': there, 'pseudo': there, 'correct': 0, 'true': there}
    assert 'correct' not in describe_round(summary)
    told = describe_round({**summary, 'estimate': {'miou': 68.2, 'low': 60.9, 'high': 75.0, 'clicks': 240}})
    assert told == f'about 68 (61 to 75) mIoU, from 240 of your clicks; {describe_round(summary)}'
    json.dumps(summary)


def test_scenes_without_truth_beside_scenes_with_it():
    summary = summarise_boxes([(FIRST, TRUTHS[0]), (FIRST, None)], CLASSES)
    assert summary['points']['Car']['pseudo'] == 2 and summary['points']['Car']['precision'] == 1.0
    assert summary['boxes']['Car']['pseudo'] == 2 and summary['boxes']['Car']['correct'] == 1


def test_a_class_without_boxes_or_with_too_many_is_told_with_the_steps():
    rows = {
        name: {'annotated': 1, 'pseudo': n, 'correct': 0, 'true': 5}
        for name, n in zip(CLASSES, (30, 0, 4), strict=True)
    }
    steps = {'found': np.array([40, 9, 4]), 'size': np.array([2, 3, 0]), 'doubt': np.array([8, 6, 0])}
    told = with_steps({'boxes': rows}, steps, np.array([10.04, 5.0, 2.0]))
    assert told['boxes']['Car']['expected'] == 10.0 and told['boxes']['Car']['steps']['doubt'] == 8
    assert box_warnings(told) == [
        'Car: 30 pseudo boxes, 10 expected; doubt took 8, size 2 of 40',
        'Pedestrian: no pseudo box; of 9 candidates doubt took 6, size 3',
    ]
    assert box_warnings({'boxes': rows}) == []  # nothing was counted
    none = with_steps({'boxes': {'Car': rows['Pedestrian']}}, {'found': np.array([0])})
    assert box_warnings(none) == ['Car: no pseudo box; no candidate was found']


def test_how_far_the_three_tasks_agree_is_told_class_by_class():
    summary = summarise_boxes([(FIRST, TRUTHS[0])], CLASSES)
    assert with_agreement(summary, {}) == summary and 'an instance' not in describe_round(summary)
    counts = {
        'boxes': [4, 1, 0], 'boxes_with_instance': [3, 0, 0], 'instances': [5, 0, 2], 'instances_with_box': [3, 0, 0],
        'points_in_boxes': [50, 8, 0], 'points_of_class': [20, 8, 0],
    }  # fmt: skip
    told = with_agreement(summary, {kind: np.array(row) for kind, row in counts.items()})
    assert told['boxes']['Cyclist']['agreement'] == {kind: row[2] for kind, row in counts.items()}
    assert told['boxes']['Car']['pseudo'] == summary['boxes']['Car']['pseudo']
    line = describe_round(told)
    assert '3 of 4 boxes are an instance, 3 of 5 instances a box, 40 % of the points in boxes have their class' in line
    json.dumps(told)
