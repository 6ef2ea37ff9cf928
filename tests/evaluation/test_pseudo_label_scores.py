"""Pseudo labels against the hidden truth, counted by hand."""

import numpy as np
import pytest

from rm3d_plugin.evaluation.functional import (
    BoxMatch,
    PseudoLabelCounts,
    SceneTruth,
    count_pseudo_labels,
    instance_centres,
    offset_error,
    pseudo_label_scores,
)
from rm3d_plugin.evaluation.functional.pseudo_label_counts import count_boxes, count_points
from rm3d_plugin.structures import Boxes3D, PseudoLabels

CAR = [0.0, 0, 0, 4, 2, 1.5, 0]


def labels(semantic, instance=None, is_annotated=None, boxes=None, box_is_annotated=()):
    count = len(semantic)
    return PseudoLabels(
        semantic=np.array(semantic, dtype=np.int64),
        instance=np.full(count, -1) if instance is None else np.array(instance),
        point_is_annotated=np.zeros(count, dtype=bool) if is_annotated is None else np.array(is_annotated, dtype=bool),
        confidence=np.ones(count, dtype=np.float32),
        boxes=Boxes3D.empty() if boxes is None else boxes,
        box_is_annotated=np.array(box_is_annotated, dtype=bool),
    )


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
    counts = count_boxes(labels([], boxes=pseudo, box_is_annotated=[False] * 4), truth, BoxMatch((0.7, 0.5)))
    assert (counts.present.tolist(), counts.given.tolist(), counts.correct.tolist()) == ([2, 0], [3, 1], [1, 0])
    lifted = labels([], boxes=Boxes3D(np.array([[0.0, 0, 1.4, 4, 2, 1.5, 0]]), np.array([0])), box_is_annotated=[False])
    assert count_boxes(lifted, truth, BoxMatch((0.5, 0.5))).correct.tolist() == [0, 0]
    assert count_boxes(lifted, truth, BoxMatch((0.5, 0.5), 'bev')).correct.tolist() == [1, 0]
    assert count_boxes(labels([]), Boxes3D.empty(), BoxMatch((0.5,))).present.tolist() == [0]


def test_what_was_annotated_does_not_count():
    boxes = Boxes3D(np.array([CAR, [20.0, 0, 0, 4, 2, 1.5, 0]]), np.array([0, 0]))
    scene = labels([0, 1, 1, -1], [0, -1, -1, -1], [1, 0, 0, 0], boxes, [True, False])
    hidden = np.array([CAR, [20.0, 0, 0, 4, 2, 1.5, 0], [30.0, 0, 0, 4, 2, 1.5, 0]])
    truth = SceneTruth(
        np.array([0, 1, 0, 1]), boxes=Boxes3D(hidden, np.zeros(3, dtype=int)), ranges=np.array([1.0, 1, 1, 40])
    )
    counts = count_pseudo_labels(scene, truth, 2, (0.0, 30.0), BoxMatch((0.7,)))
    scores = pseudo_label_scores(counts)
    assert scores.coverage == 0.75 and scores.precision == scores.mean_precision == 0.5
    assert counts.pseudo.tolist() == [0, 2] and counts.scenes_with_truth == 1
    np.testing.assert_array_equal(scores.class_precision, [np.nan, 0.5])
    np.testing.assert_array_equal(scores.class_coverage, [1.0, 0.5])
    np.testing.assert_array_equal(scores.class_recall, [0.0, 0.5])
    np.testing.assert_array_equal(scores.range_coverage, [1.0, 0.0])
    np.testing.assert_array_equal(scores.range_precision, [0.5, np.nan])
    found = counts.boxes
    assert [found.annotated[0], found.given[0], found.correct[0], found.present[0]] == [1, 1, 1, 2]
    twice = counts + counts
    assert twice.total == 8 and twice.boxes.present[0] == 4 and twice.points.present.sum() == 6
    assert count_pseudo_labels(scene, truth, 2).boxes is None
    unknown = count_pseudo_labels(scene, None, 2, match=BoxMatch((0.7,)))
    assert unknown.scenes_with_truth == 0 and unknown.boxes.given[0] == 1 and unknown.boxes.present[0] == 0
    assert pseudo_label_scores(PseudoLabelCounts.none(2)).coverage == 0.0
    assert np.isnan(pseudo_label_scores(PseudoLabelCounts.none(2)).precision)


XYZ = np.array([[0, 0, 0], [2, 0, 0], [4, 0, 0], [6, 0, 0], [0, 9, 0], [0, 9, 0]], dtype=np.float32)
TRUTH = SceneTruth(np.array([1, 1, 1, 1, 0, 255]), np.array([0, 0, 0, 0, -1, -1]), XYZ)


def test_truth_of_any_integer_type():
    half = labels([1, 1, -1, 0, 0, 1], [3, 3, -1, -1, -1, 3])
    small = SceneTruth(TRUTH.semantic.astype(np.uint8), (TRUTH.instance + 2**40).astype(np.uint64), XYZ)
    want, got = (count_pseudo_labels(half, truth, 2) for truth in (TRUTH, small))
    assert got.points.present.tolist() == want.points.present.tolist() == [[1, 4]]
    assert got.points.correct.tolist() == want.points.correct.tolist()


def offsets(scene):
    found = count_pseudo_labels(scene, TRUTH, 2).offsets
    return found.metres.tolist(), found.points.tolist()


def test_offset_error_by_hand():
    half = labels([1, 1, -1, 0, 0, 1], [3, 3, -1, -1, -1, 3])  # the last point, of unknown truth, belongs to it too
    off = np.linalg.norm(np.array([2 / 3, 3.0, 0]) - [3, 0, 0])  # centre of three points; the true one is (3, 0, 0)
    assert offsets(half) == (pytest.approx([0, 2 * off]), [0, 2])
    assert offsets(labels([1, 1, 1, 1, 0, -1], [7, 7, 7, 7, -1, -1])) == ([0, 0], [0, 4])
    annotated = labels([1, 1, -1, 0, 0, 1], [3, 3, -1, -1, -1, 3], [1, 0, 0, 0, 0, 0])
    assert offsets(annotated) == (pytest.approx([0, off]), [0, 1])  # an annotated point is no pseudo label


def test_a_point_of_the_wrong_class_has_the_offset_that_it_was_given():
    wrong = labels([1, 1, 1, 0, 0, -1], [7, 7, 7, 7, -1, -1])  # point 3: class 0, so an instance of its own at x = 6
    assert offsets(wrong) == ([0, 3 * 1.0 + 3.0], [0, 4])
    goal = instance_centres(XYZ, TRUTH.semantic, TRUTH.instance)
    assert np.isnan(goal[4:]).all() and goal[0].tolist() == [3, 0, 0]
    found = offset_error(goal + [0, 0, 2], goal, TRUTH.semantic, 2)
    assert (found.metres.tolist(), found.points.tolist()) == ([0, 8], [0, 4])
