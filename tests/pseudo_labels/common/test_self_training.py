"""The most confident part of every class."""

import numpy as np
import pytest
from pseudo_labels import refreshing
from pseudo_labels.patches import CLASSES, make_patches

from rm3d_plugin.pseudo_labels import SegmentationRules, SelfTrainingRules
from rm3d_plugin.pseudo_labels.common.groups import GroupLabels
from rm3d_plugin.pseudo_labels.common.self_training import most_confident_groups
from rm3d_plugin.regions import MergeRules


def groups_of(classes, confidence, from_annotation=None):
    n = len(classes)
    known = np.zeros(n, dtype=bool) if from_annotation is None else np.asarray(from_annotation)
    return GroupLabels(np.array(classes), np.array(confidence, dtype=float), known, np.full((n, 2), np.nan))


def kept(groups, sizes, share, **more):
    out = most_confident_groups(groups, np.repeat(np.arange(len(sizes)), sizes), share, **more)
    assert (out.confidence[out.classes < 0] == 0).all()
    return np.flatnonzero(out.classes >= 0).tolist()


def test_each_class_keeps_its_best_up_to_the_share_of_its_points():
    groups = groups_of([0, 0, 0, 0, 1, 1], [0.9, 0.99, 0.8, 0.95, 0.6, 0.7])
    sizes = [10, 10, 10, 10, 5, 5]
    assert kept(groups, sizes, 0.5) == [1, 3, 5]
    assert kept(groups, sizes, 0.25) == [1, 5]
    assert kept(groups, sizes, 0.51) == [0, 1, 3, 4, 5]  # the group that reaches the share is still taken
    assert kept(groups, sizes, 0.01) == [1, 5]  # the best of each class always is
    assert kept(groups, sizes, 1.0) == [0, 1, 2, 3, 4, 5]


def test_annotated_groups_neither_count_nor_fall():
    groups = groups_of([0, 0, 0, -1], [0.2, 0.9, 0.8, 0.0], [True, False, False, False])
    assert kept(groups, [100, 1, 1, 1], 0.5) == [0, 1]


def test_ties_go_to_the_lower_group():
    assert kept(groups_of([0, 0, 0], [0.9, 0.9, 0.9]), [1, 1, 1], 0.3) == [0]


def test_ranges_have_a_share_of_their_own():
    groups = groups_of([0, 0, 0, 0], [0.99, 0.98, 0.7, 0.6])
    ranges = np.array([5.0, 6, 40, 41])
    assert kept(groups, [1] * 4, 0.5) == [0, 1]
    assert kept(groups, [1] * 4, 0.5, ranges=ranges, range_edges=(0, 30)) == [0, 2]
    assert kept(groups, [1] * 4, 0.5, ranges=ranges, range_edges=(10, 30)) == [0, 2]  # nearer: the first bin


def test_nothing_and_groups_without_points():
    assert kept(groups_of([], []), [], 0.5) == []
    assert kept(groups_of([-1, -1], [0, 0]), [3, 3], 0.5) == []
    assert kept(groups_of([0, 0], [0.8, 0.9]), [0, 0], 0.5) == [1]


@pytest.mark.parametrize('seed', range(8))
def test_equals_a_loop(seed):
    rng = np.random.default_rng(seed)
    n = 30
    classes = rng.integers(-1, 3, n)
    groups = groups_of(classes, np.where(classes < 0, 0, rng.integers(1, 6, n) / 5), rng.random(n) < 0.2)
    sizes = rng.integers(1, 20, n)
    share = float(rng.random())
    want = set(np.flatnonzero(groups.from_annotation & (groups.classes >= 0)).tolist())
    for c in range(3):
        mine = [g for g in range(n) if groups.classes[g] == c and not groups.from_annotation[g]]
        total, taken = sum(sizes[g] for g in mine), 0
        for g in sorted(mine, key=lambda g: (-groups.confidence[g], g)):
            if taken >= share * total and taken:
                break
            want.add(g)
            taken += sizes[g]
    assert set(kept(groups, sizes, share)) == want


def test_the_share_grows_to_one():
    rules = SelfTrainingRules(cbst_fraction=0.2)
    assert [round(rules.fraction(r, 8), 3) for r in (0, 1, 4, 7, 8)] == [0.2, 0.2, 0.6, 1.0, 1.0]
    assert SelfTrainingRules().fraction(1, 8) == 1.0


@pytest.mark.parametrize(
    ('field', 'value'),
    [
        ('cbst_fraction', 0),
        ('cbst_fraction', 1.5),
        ('cbst_ranges', (5, 5)),
        ('cbst_ranges', (-1, 5)),
        ('holdout', 1),
        ('holdout', -0.1),
        ('holdout_margin', 2),
    ],
)
def test_a_bad_value_is_named(field, value):
    with pytest.raises(ValueError, match=rf'SelfTrainingRules\.{field}: expected .* got'):
        SelfTrainingRules(**{field: value})


def test_refresh_takes_fewer_labels_that_are_more_often_right_and_in_the_end_all():
    patches = make_patches(share=0.0)
    rows = patches.softmax(np.random.default_rng(1), noise=1.5)
    scene = refreshing.inputs(patches, rows=rows)

    def labels(limits, number):
        rules = SegmentationRules(MergeRules(gamma=0.4, rounds=8), self_training=limits)
        return refreshing.points(scene, rules, number, np.ones(CLASSES, dtype=int)).labels.semantic

    free, balanced = None, SelfTrainingRules(cbst_fraction=0.3)
    everything, some = labels(free, 1), labels(balanced, 1)
    given = some >= 0
    assert 0 < given.sum() < 0.6 * (everything >= 0).sum()
    assert (some[given] == everything[given]).all()
    right = [(s[s >= 0] == patches.truth[s >= 0]).mean() for s in (some, everything)]
    assert right[0] > right[1]
    np.testing.assert_array_equal(labels(balanced, 7), labels(free, 7))
