"""Counts of the label report on a scene worked out by hand."""

import numpy as np

from rm3d_plugin.engine.label_report import describe_round, summarise
from rm3d_plugin.pseudo_labels.quality import SceneTruth
from rm3d_plugin.structures import Boxes3D, PseudoLabels


def box(x: float) -> list[float]:
    return [x, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0]


TRUTH = SceneTruth(
    semantic=np.array([0, 0, 0, 1, 1, 1, 1, 1]),
    boxes=Boxes3D(np.array([box(10), box(20), box(30)]), np.array([0, 0, 0])),
    ranges=np.array([5.0, 5.0, 5.0, 5.0, 40.0, 40.0, 50.0, 50.0]),
)
LABELS = PseudoLabels(
    semantic=np.array([0, 0, 0, 1, 0, 1, -1, -1]),  # point 0 revealed; of the pseudo cars 1, 2, 4 the last is wrong
    instance=np.array([0, 1, 1, -1, 2, -1, -1, -1]),
    point_is_true=np.array([True] + [False] * 7),
    confidence=np.ones(8, dtype=np.float32),
    boxes=Boxes3D(np.array([box(10), box(20.5), box(60)]), np.array([0, 0, 0])),
    box_is_true=np.array([True, False, False]),
)


def test_hand_worked_scene() -> None:
    found = summarise([(LABELS, TRUTH)], ['Car'])
    assert found['coverage'] == 6 / 8
    assert found['truth_known'] is True
    assert found['points']['Car'] == {'pseudo': 3, 'precision': 2 / 3}
    assert found['points']['background'] == {'pseudo': 2, 'precision': 1.0}
    assert found['boxes']['Car'] == {'revealed': 1, 'pseudo': 2, 'right': 1, 'true': 3}
    assert '1 right of 3 true' in describe_round(found)


def test_without_truth_nothing_is_judged() -> None:
    found = summarise([(LABELS, None)], ['Car'])
    assert found['truth_known'] is False
    assert found['coverage'] == 6 / 8
    assert found['points']['Car'] == {'pseudo': 3, 'precision': None}
    assert found['boxes']['Car'] == {'revealed': 1, 'pseudo': 2, 'right': 0, 'true': 1}
    assert 'right' not in describe_round(found)


def test_no_scene() -> None:
    assert summarise([], ['Car'])['coverage'] == 0.0
