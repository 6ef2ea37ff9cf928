"""Rules (a), (b), (c), pooling, ties, instances, by hand."""

import numpy as np
import pytest

from rm3d_plugin.pseudo_labels.common.annotated import (
    AnnotatedLabels,
    PointAnnotation,
    annotated_regions,
    points_of_boxes,
)
from rm3d_plugin.pseudo_labels.common.groups import (
    count_votes,
    label_groups,
    nearest_instances,
    pool_rows,
    seen_rows,
)
from rm3d_plugin.pseudo_labels.detection.parts import PartLimits, split_mixed
from rm3d_plugin.structures import Boxes3D, Regions

NAN = np.full(2, np.nan)


def test_rows_of_nan_or_zero_are_not_seen():
    assert seen_rows(np.array([[0.2, 0.8], NAN, [0, 0], [0.5, np.nan]])).tolist() == [True, False, False, False]


def test_pooling():
    values = np.array([[0.6, 0.4], [0.2, 0.8], NAN, [1, 0], [0.3, 0.7]])
    labels = np.array([0, 0, 0, 1, -1])
    mean = pool_rows(values, seen_rows(values), labels, 3)
    assert mean.values[:2].tolist() == [pytest.approx([0.4, 0.6]), [1, 0]]
    assert np.isnan(mean.values[2]).all()
    assert mean.seen.tolist() == [2, 1, 0]
    largest = pool_rows(values, seen_rows(values), labels, 3, 'max')
    assert largest.values[0] == pytest.approx([0.6 / 1.4, 0.8 / 1.4])
    assert np.isnan(largest.values[2]).all()
    assert pool_rows(np.zeros((0, 2)), np.zeros(0, bool), np.zeros(0, int), 0).values.shape == (0, 2)


def test_rules_a_b_c():
    regions = Regions(np.array([0, 0, 1, 2, 2, 3, -1]))
    rows = np.array([[0.1, 0.9]] * 2 + [[0.9, 0.1]] + [[0.7, 0.3]] * 2 + [[0.8, 0.2], [1, 0]])
    pooled = pool_rows(rows, seen_rows(rows), regions.labels, 4)
    votes = count_votes(np.array([0, -1, -1, -1, -1, -1, -1]), regions.labels, 4, 2)
    out = label_groups(np.array([0, 1, 1, 2]), pooled, votes, np.array([1, 1]), 0.75)
    # (a) truth beats a confident prediction; (b) (.9 + 2 * .7) / 3 = .767; and .8
    assert out.classes.tolist() == [0, 0, 0]
    assert out.confidence == pytest.approx([1.0, 2.3 / 3, 0.8])
    assert out.from_annotation.tolist() == [True, False, False]
    stricter = label_groups(np.array([0, 1, 1, 2]), pooled, votes, np.array([1, 1]), 0.78)
    assert stricter.classes.tolist() == [0, -1, 0]
    assert stricter.confidence[1] == 0


def test_nothing_seen_is_nothing_labelled():
    pooled = pool_rows(np.full((2, 2), np.nan), np.zeros(2, bool), np.array([0, 1]), 2)
    out = label_groups(np.array([0, 1]), pooled, np.zeros((2, 2), int), np.array([1, 1]), 0.1)
    assert out.classes.tolist() == [-1, -1]
    assert np.isnan(out.probabilities).all()


def test_instance_of_the_nearest_labelled_seed_of_the_group():
    xyz = np.array([[0.0, 0, 0], [1, 0, 0], [4, 0, 0], [5, 0, 0], [4.9, 0, 0]])
    truth, instance = np.array([1, -1, -1, 1, -1]), np.array([7, -1, -1, 3, -1])
    out = nearest_instances(xyz, np.array([0, 0, 0, 0, 1]), np.ones(5, int), truth, instance)
    assert out.tolist() == [7, 7, 3, 3, -1]


def test_a_confident_part_is_cut_out_of_a_mixed_region():
    region = np.array([0] * 8 + [1] * 8)
    rows = np.tile([0.1, 0.9], (16, 1))
    rows[:4] = [0.9, 0.1]  # half of region 0: its mean is sure of nothing
    rows[8:10] = [0.9, 0.1]  # too few of region 1
    pooled = pool_rows(rows, seen_rows(rows), region, 2)
    groups = label_groups(np.array([0, 1]), pooled, np.zeros((2, 2), int), np.array([1, 1]), 0.7)
    assert groups.classes.tolist() == [-1, 1]
    more, points = split_mixed(groups, region.copy(), region, rows, PartLimits(0.7, 0.3, 3))
    assert more.classes.tolist() == [-1, 1, 0, 1]
    assert points.tolist() == [2] * 4 + [3] * 4 + [1] * 8
    assert more.confidence[2:] == pytest.approx([0.9, 0.9])
    same, unmoved = split_mixed(groups, region.copy(), region, rows, PartLimits(0.95, 0.3, 3))
    assert same.classes.tolist() == [-1, 1] and unmoved.tolist() == region.tolist()


def test_a_box_tells_exactly_which_points_are_its_object():
    xyz = np.array([[0.0, 0, 0], [0.9, 0, 0], [1.2, 0, 0], [1.4, 0, 0], [9, 9, 9]])
    box = Boxes3D(np.array([[0, 0, 0, 2, 2, 2, 0.0]]), np.array([1]))
    annotated = AnnotatedLabels(np.full(5, -1), np.full(5, -1), box)
    truth = points_of_boxes(xyz, annotated, 3)
    assert truth.semantic.tolist() == [1, 1, -1, -1, -1]
    assert truth.instance.tolist() == [0, 0, -1, -1, -1]
    assert truth.shell.tolist() == [False, False, True, False, False]
    assert truth.seeds.tolist() == [-1] * 5
    complete = points_of_boxes(xyz, AnnotatedLabels(annotated.semantic, annotated.instance, box, complete=True), 3)
    assert complete.semantic.tolist() == [1, 1, 3, 3, 3]
    assert not complete.shell.any()


def test_a_region_is_named_by_a_box_that_holds_most_of_it_or_by_any_seed():
    regions = Regions(np.array([0, 0, 0, 1, 1, 1, 2, 2, 2]))
    semantic = np.array([1, 1, -1, 1, -1, -1, 2, -1, -1])
    instance = np.array([0, 0, -1, 0, -1, -1, -1, -1, -1])
    seeds = np.array([-1] * 6 + [2, -1, -1])
    known = annotated_regions(
        regions, PointAnnotation(semantic, instance, seeds, np.zeros(9, bool)), np.array([0, 4, 4]), 0.5
    )
    assert known.labels.tolist() == [1, -1, 2]
    assert known.instances.tolist() == [0, -1, -1]


def test_a_tie_names_a_region_by_the_class_that_training_has_more_of():
    regions = Regions(np.array([0, 0, 1, 1, 1]))
    semantic = np.array([0, 1, 2, 1, -1])
    points = PointAnnotation(semantic, np.array([3, 5, 7, 9, -1]), semantic, np.zeros(5, bool))
    known = annotated_regions(regions, points, np.array([5, 9, 9]), 0.5)
    assert known.labels.tolist() == [1, 1] and known.instances.tolist() == [5, 9]
    assert annotated_regions(regions, points, np.array([9, 5, 9]), 0.5).labels.tolist() == [0, 2]


def test_annotated_labels_are_checked():
    with pytest.raises(ValueError, match='expected 3 rows'):
        AnnotatedLabels(np.full(3, -1), np.full(2, -1), Boxes3D.empty())
    box = Boxes3D(np.array([[0, 0, 0, 2, 2, 2, 0.0]]), np.array([1]))
    with pytest.raises(ValueError, match='names box 1, but 1 boxes'):
        AnnotatedLabels(np.array([1]), np.array([1]), box)
    assert len(AnnotatedLabels.nothing(4)) == 4
