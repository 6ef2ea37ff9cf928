"""ScanNet's and S3DIS's instance scores, against hand-worked cases and slow twins."""

import numpy as np
import pytest
from reference.instance_seg_slow import s3dis as slow_s3dis
from reference.instance_seg_slow import scannet_ap as slow_ap

from rm3d_plugin.evaluation.functional import (
    instance_ap,
    instance_centres,
    instance_overlap,
    instance_precision_recall,
)
from rm3d_plugin.evaluation.functional.instance_ap import OVERLAPS, trapezoid_ap


def overlap_of(semantic, instance, found, classes):
    """found: [(points, class, score)]."""
    masks = np.zeros((len(found), len(semantic)), dtype=bool)
    for row, (points, _, _) in enumerate(found):
        masks[row, sorted(points)] = True
    labels = np.array([c for _, c, _ in found], dtype=np.int64)
    scores = np.array([s for _, _, s in found], dtype=np.float64)
    return instance_overlap(np.asarray(semantic), np.asarray(instance), masks, labels, scores, classes)


# Two chairs (class 1) of 10 points, a table (class 2) of 10, 5 points of wall (class 0), 5 unknown.
SEMANTIC = np.repeat([1, 1, 2, 0, -1], [10, 10, 10, 5, 5])
INSTANCE = np.repeat([0, 1, 2, -1, -1], [10, 10, 10, 5, 5])
THINGS = (1, 2)


def room(*found):
    return overlap_of(SEMANTIC, INSTANCE, [(set(range(*p)), c, s) for p, c, s in found], THINGS)


def ap_of(*found, min_points=1):
    return instance_ap([room(*found)], THINGS, min_points)


PERFECT = (((0, 10), 1, 0.9), ((10, 20), 1, 0.8), ((20, 30), 2, 0.7))


def test_perfect_is_one_and_empty_is_zero():
    got = ap_of(*PERFECT)
    assert (got.mean_ap, got.mean_ap50, got.mean_ap25) == (1.0, 1.0, 1.0)
    assert got.overlaps == (*OVERLAPS, 0.25)
    none = ap_of()
    assert (none.mean_ap, none.mean_ap50, none.mean_ap25) == (0.0, 0.0, 0.0)
    assert instance_ap([], THINGS).mean_ap == 0.0
    assert np.isnan(instance_ap([], THINGS).ap).all()


def test_a_class_without_truth_is_left_out_of_the_mean():
    got = instance_ap([room(*PERFECT, ((0, 10), 2, 0.1))], (1, 2, 3), 1)
    assert np.isnan(got.ap[2]) and got.mean_ap == pytest.approx((1 + got.ap[1]) / 2)


def test_a_duplicate_costs_precision():
    got = ap_of(*PERFECT, ((0, 10), 1, 0.85))
    # chairs by score: hit, duplicate, hit. (0, 1) (.5, 1) (.5, .5) (1, 2/3): .5 + .5 * (1/2 + 2/3) / 2
    assert got.ap[0] == pytest.approx(0.5 + 0.5 * (1 / 2 + 2 / 3) / 2)
    assert got.ap[1] == 1.0


def test_the_threshold_must_be_exceeded_and_stops_at_90():
    half = ap_of(((0, 5), 1, 1.0), ((10, 20), 1, 1.0), ((20, 30), 2, 1.0))  # overlap exactly .5
    assert half.ap50[0] < 1 and half.ap25[0] == 1.0
    nine = ap_of(((0, 9), 1, 1.0), ((10, 19), 1, 1.0), ((20, 29), 2, 1.0))  # exactly .9
    assert nine.table[OVERLAPS.index(0.85)].tolist() == [1.0, 1.0]
    assert nine.table[OVERLAPS.index(0.9)].tolist() == [0.0, 0.0]
    assert nine.mean_ap == pytest.approx(8 / 9)


def test_void_is_ignored_for_predictions_that_lie_on_it():
    assert ap_of(*PERFECT, ((30, 40), 1, 0.99)).mean_ap == 1.0  # on wall and unknown points
    half_on_table = ((25, 35), 1, 0.99)  # .5 on void, which is not more than .5: a false alarm there, none at .25
    got = ap_of(*PERFECT, half_on_table)
    assert got.ap50[0] < 1 and got.ap25[0] == 1.0
    assert ap_of(*PERFECT, ((20, 30), 1, 0.99)).ap[0] < 1  # a table is not void for a chair


def test_small_truth_is_ignored_and_so_is_what_lies_on_it():
    semantic, instance = np.repeat([1, 1, 0], [200, 50, 100]), np.repeat([0, 1, -1], [200, 50, 100])

    def score(*found):
        return instance_ap([overlap_of(semantic, instance, found, (1,))], (1,)).mean_ap50

    whole = (set(range(200)), 1, 0.5)
    assert score(whole) == 1.0
    assert score(whole, (set(range(200, 250)), 1, 0.9)) == 1.0  # under 100 points itself
    assert score(whole, (set(range(200, 310)), 1, 0.9)) == 1.0  # on the small one and void
    assert score(whole, (set(range(100, 210)), 1, 0.9)) < 1  # on the big one
    small = instance_ap([overlap_of(semantic, instance, [whole], (1,))], (1,), min_points=10)
    assert small.mean_ap50 == 0.5


def test_equal_scores_are_one_step_of_the_curve():
    assert trapezoid_ap(np.array([0.5, 0.5]), np.array([True, False]), 1) == 0.75
    assert trapezoid_ap(np.array([0.5, 0.5]), np.array([False, True]), 1) == 0.75
    assert trapezoid_ap(np.array([0.5]), np.array([False]), 2) == 0.0
    hits = np.array([True, False, True])
    assert trapezoid_ap(np.array([np.inf, np.inf, 0.1]), hits, 2) == trapezoid_ap(np.array([9, 9, 0.1]), hits, 2)
    assert trapezoid_ap(np.zeros(0), np.zeros(0, dtype=bool), 2) == 0.0


def test_at_25_the_better_score_chooses_first_whatever_the_order_of_rows():
    # One prediction overlaps both chairs by more than .25; the other only the first.
    both, first = (set(range(4, 15)), 1, 0.9), (set(range(0, 4)), 1, 0.8)
    rows = [
        instance_ap([overlap_of(SEMANTIC, INSTANCE, order, THINGS)], THINGS, 1).ap25[0]
        for order in ([both, first], [first, both])
    ]
    assert rows[0] == rows[1]


def scene(rng, exact):
    """A random scene; with ``exact`` predictions never overlap two true instances of a class."""
    n = 60
    instance = np.repeat(np.arange(6), 10)
    semantic = np.repeat(rng.integers(0, 3, 6), 10)
    semantic[rng.random(n) < 0.1] = -1
    instance[rng.random(n) < 0.05] = -1
    found = []
    for _ in range(int(rng.integers(0, 14))):
        start = rng.integers(0, 6) * 10 if exact else rng.integers(0, 50)
        points = set((start + np.flatnonzero(rng.random(10) < 0.85)).tolist())
        if exact and rng.random() < 0.5:
            points |= set(rng.choice(n, 2).tolist())
        common = int(semantic[start])
        found.append((points, common if common >= 0 and rng.random() < 0.8 else 1, float(rng.integers(1, 9)) / 8))
    return semantic, instance, [f for f in found if f[0]]


@pytest.mark.parametrize('seed', range(10))
@pytest.mark.parametrize('min_points', [1, 8])
def test_scannet_equals_the_slow_twin(seed, min_points):
    rng = np.random.default_rng(seed)
    scenes = [scene(rng, exact=False) for _ in range(3)]
    things = (1, 2)
    got = instance_ap([overlap_of(*s, things) for s in scenes], things, min_points)
    plain = [(s.tolist(), i.tolist(), f) for s, i, f in scenes]
    for row, overlap in enumerate(got.overlaps[:-1]):  # .25 is settled otherwise
        want = [slow_ap(plain, label, things, overlap, min_points) for label in things]
        np.testing.assert_allclose(got.table[row], [np.nan if w is None else w for w in want], atol=1e-12)


@pytest.mark.parametrize('seed', range(10))
@pytest.mark.parametrize('asis', [False, True])
def test_s3dis_equals_the_slow_twin(seed, asis):
    rng = np.random.default_rng(seed)
    scenes = [scene(rng, exact=False) for _ in range(3)]
    classes = (0, 1, 2)
    got = instance_precision_recall([overlap_of(*s, classes) for s in scenes], classes, asis_compat=asis)
    plain = [(s.tolist(), i.tolist(), f) for s, i, f in scenes]
    for column, label in enumerate(classes):
        want = slow_s3dis(plain, label, classes, asis=asis) or (np.nan,) * 4
        mine = [getattr(got, n)[column] for n in ('precision', 'recall', 'coverage', 'weighted_coverage')]
        np.testing.assert_allclose(mine, want, atol=1e-12)


def test_s3dis_by_hand():
    got = instance_precision_recall([room(*PERFECT)], THINGS)
    means = (got.mean_precision, got.mean_recall, got.mean_coverage, got.mean_weighted_coverage)
    assert means == (1.0, 1.0, 1.0, 1.0)
    double = [room(*PERFECT, ((0, 9), 1, 0.95))]
    strict = instance_precision_recall(double, THINGS)
    assert strict.precision.tolist() == [pytest.approx(2 / 3), 1.0] and strict.recall.tolist() == [1.0, 1.0]
    script = instance_precision_recall(double, THINGS, asis_compat=True)
    assert script.precision.tolist() == [1.0, 1.0] and script.recall.tolist() == [1.0, 1.0]
    half = [room(((0, 5), 1, 1.0))]
    assert instance_precision_recall(half, THINGS).mean_precision == 0
    assert instance_precision_recall(half, THINGS, asis_compat=True).precision[0] == 1.0
    assert instance_precision_recall(half, THINGS).coverage.tolist() == [0.25, 0.0]
    none = instance_precision_recall([room()], THINGS)
    assert (none.mean_precision, none.mean_recall, none.mean_coverage) == (0.0, 0.0, 0.0)


def test_s3dis_measures_without_unknown_points():
    got = instance_precision_recall([room(((20, 30), 2, 1.0), ((35, 40), 2, 1.0))], THINGS)
    assert got.found.tolist() == [0, 1] and got.precision[1] == 1.0
    walls = instance_precision_recall([room(((20, 30), 2, 1.0), ((30, 35), 2, 0.9))], THINGS)
    assert walls.precision[1] == 0.5  # wall is known, so a table on it is wrong


def test_weighted_coverage_weighs_by_points():
    semantic, instance = np.ones(40, dtype=int), np.repeat([0, 1], [30, 10])
    one = overlap_of(semantic, instance, [(set(range(30)), 1, 1.0)], (1,))
    got = instance_precision_recall([one], (1,))
    assert (got.mean_coverage, got.mean_weighted_coverage) == (0.5, 0.75)


def test_errors_name_what_does_not_fit():
    masks, labels, scores = np.ones((1, 4), dtype=bool), np.array([1]), np.array([0.5])
    with pytest.raises(ValueError, match=r'masks has shape \(1, 4\), expected \(1, 3\)'):
        instance_overlap(np.ones(3, dtype=int), np.ones(3, dtype=int), masks, labels, scores, (1,))
    with pytest.raises(ValueError, match='1 of 1 scores are NaN'):
        instance_overlap(np.ones(4, dtype=int), np.ones(4, dtype=int), masks, labels, np.array([np.nan]), (1,))


def test_one_number_under_two_classes_is_two_instances():
    got = overlap_of([1, 1, 2, 2], [7, 7, 7, 7], [({0, 1}, 1, 1.0)], (1, 2))
    assert got.truth_labels.tolist() == [1, 2] and got.shared.tolist() == [[2, 0]]


def test_ids_of_64_bits_are_told_apart():
    """Beside a signed class, uint64 became float64, which cannot tell 2^53 from 2^53 + 1."""
    big = np.array([2**53, 2**53 + 1, 2**64 - 1, 2**53], dtype=np.uint64)
    semantic = np.array([1, 1, 1, 2])
    got = instance_overlap(semantic, big, np.eye(4, dtype=bool), np.ones(4, int), np.ones(4), (1, 2))
    assert got.truth_labels.tolist() == [1, 1, 1, 2] and got.truth_sizes.tolist() == [1, 1, 1, 1]
    np.testing.assert_array_equal(got.shared, np.eye(4))
    xyz = np.arange(12.0).reshape(4, 3)
    np.testing.assert_array_equal(instance_centres(xyz, semantic, big), xyz)


@pytest.mark.parametrize(('scores', 'hits'), [([np.nan, 1.0], [True, False]), ([3.0, 2.0, 1.0], [True, True, True])])
def test_a_curve_of_no_scores_or_of_recall_above_one_is_refused(scores, hits):
    with pytest.raises(ValueError, match='trapezoid_ap: expected scores that are numbers and at most 2 hits'):
        trapezoid_ap(np.array(scores), np.array(hits), 2)
