"""Counts against hidden truth, and the ledger in words."""

import numpy as np
import pytest

from rm3d_plugin.pseudo_labels import SceneTruth, pseudo_report
from rm3d_plugin.pseudo_labels.common.ledger import sentence, summarise
from rm3d_plugin.pseudo_labels.common.quality import count_boxes, count_points
from rm3d_plugin.regions import MergeLedger, Reason
from rm3d_plugin.structures import Boxes3D, PseudoLabels

CAR = [0.0, 0, 0, 4, 2, 1.5, 0]


def test_points_by_class_and_range():
    labels = np.array([0, 1, -1, 1, 0, 0])
    truth = np.array([0, 0, 0, 1, -1, 1])
    counts = count_points(labels, truth, 2, np.array([1.0, 20, 20, 50, 1, 1]), range_edges=(0, 15, 45))
    assert counts.present.tolist() == [[1, 1], [2, 0], [0, 1]]
    assert counts.labelled.tolist() == [[1, 1], [1, 0], [0, 1]]
    assert counts.given.tolist() == [[2, 0], [0, 1], [0, 1]]
    assert counts.correct.tolist() == [[1, 0], [0, 0], [0, 1]]
    assert (counts + counts).present.sum() == 10
    with pytest.raises(ValueError, match='labels hold class 2'):
        count_points(np.array([2]), np.array([0]), 2)
    with pytest.raises(ValueError, match='1 labels, but 2 rows'):
        count_points(np.array([0]), np.array([0, 0]), 2)


def test_each_true_box_counts_once_and_for_its_class():
    truth = Boxes3D(np.array([CAR, [20.0, 0, 0, 4, 2, 1.5, 0]]), np.array([0, 0]))
    pseudo = Boxes3D(
        np.array([[0.1, 0, 0, 4, 2, 1.5, 0], CAR, [20.0, 0, 0, 4, 2, 1.5, 0], [40.0, 0, 0, 4, 2, 1.5, 0]]),
        np.array([0, 0, 1, 0]),
        np.array([0.9, 0.8, 0.9, 0.7]),
    )
    counts = count_boxes(pseudo, truth, (0.7, 0.5))
    assert (counts.present.tolist(), counts.given.tolist(), counts.correct.tolist()) == ([2, 0], [3, 1], [1, 0])
    lifted = Boxes3D(np.array([[0.0, 0, 1.4, 4, 2, 1.5, 0]]), np.array([0]))
    assert count_boxes(lifted, truth, (0.5, 0.5)).correct.tolist() == [0, 0]
    assert count_boxes(lifted, truth, (0.5, 0.5), 'bev').correct.tolist() == [1, 0]
    assert count_boxes(Boxes3D.empty(), Boxes3D.empty(), (0.5,)).present.tolist() == [0]


def test_a_report_leaves_out_what_was_annotated():
    boxes = Boxes3D(np.array([CAR, [20.0, 0, 0, 4, 2, 1.5, 0]]), np.array([0, 0]))
    labels = PseudoLabels(
        semantic=np.array([0, 1, 1, -1]),
        instance=np.array([0, -1, -1, -1]),
        point_is_annotated=np.array([True, False, False, False]),
        confidence=np.array([1, 0.9, 0.9, 0], dtype=np.float32),
        boxes=boxes,
        box_is_annotated=np.array([True, False]),
    )
    hidden = np.array([CAR, [20.0, 0, 0, 4, 2, 1.5, 0], [30.0, 0, 0, 4, 2, 1.5, 0]])
    truth = SceneTruth(np.array([0, 1, 0, 1]), Boxes3D(hidden, np.zeros(3, dtype=int)), np.array([1.0, 1, 1, 40]))
    report = pseudo_report([(labels, truth)], ('Car', 'background'), (0.7,)).as_dict()
    assert report['coverage'] == 0.75
    assert report['precision'] == 0.5
    assert report['classes']['Car'] == {'coverage': 1.0, 'precision': None, 'recall': 0.0, 'present': 1, 'given': 0}
    assert report['classes']['background']['precision'] == 0.5
    assert report['ranges']['>=30 m'] == {'coverage': 0.0, 'precision': None, 'recall': 0.0, 'present': 1, 'given': 0}
    assert report['boxes'] == {'Car': {'precision': 1.0, 'recall': 0.5, 'given': 1, 'present': 2}}
    assert 'boxes' not in pseudo_report([(labels, truth)], ('Car', 'background')).as_dict()
    assert pseudo_report([], ('Car',)).as_dict()['coverage'] == 0.0


def ledger():
    return MergeLedger(
        region_a=np.array([0, 0]),
        region_b=np.array([1, 2]),
        M_color=np.array([np.nan, np.nan]),
        M_scale=np.array([0.5, 1.0]),
        M_des=np.array([0.75, 0.25]),
        M_seg=np.array([1.0, 0.5]),
        A_n=np.array([1.0, 0.25]),
        A_des=np.array([0.5, 0.25]),
        S=np.array([1.5, 1.0]),
        Sbar=np.array([0.75, 0.5]),
        threshold=np.array([0.625, 0.625]),
        accepted=np.array([True, False]),
        became_seed=np.array([True, False]),
        round=np.array([4, 4]),
        reason=np.array([Reason.MERGED, Reason.NOT_SIMILAR]),
    )


def test_the_ledger_counts_and_explains():
    summary = summarise(ledger())
    assert summary.pairs == 2
    assert {k: v for k, v in summary.reasons.items() if v} == {'MERGED': 1, 'NOT_SIMILAR': 1}
    assert summary.merged_terms == {
        'M_color': None, 'M_scale': 0.5, 'M_des': 0.75, 'M_seg': 1.0, 'S': 1.5, 'Sbar': 0.75,
    }  # fmt: skip
    assert sentence(ledger(), 1) == (
        'round 4: regions 0 and 2 kept apart: not similar enough '
        '(scale 1.00, descriptor 0.25, semantics 0.50; S 1.00, mean 0.50, needed 0.625)'
    )
    assert sentence(ledger(), 0).endswith('needed 0.625); the group grows on from there')


def test_columns_must_fit():
    arrays = ledger().to_arrays() | {'S': np.zeros(3)}
    with pytest.raises(ValueError, match=r'MergeLedger\.S: expected 2 rows, got 3'):
        MergeLedger.from_arrays(arrays)
