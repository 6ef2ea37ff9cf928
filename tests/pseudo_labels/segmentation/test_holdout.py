"""Points kept aside: never used, and a round that contradicts more of them is taken back."""

from functools import reduce
from operator import add

import numpy as np
import pytest
from pseudo_labels import refreshing
from pseudo_labels.patches import CLASSES, make_patches

from rm3d_plugin.pseudo_labels import AnnotatedLabels
from rm3d_plugin.pseudo_labels.segmentation.holdout import (
    Holdout,
    HoldoutErrors,
    got_worse,
    holdout_errors,
    split_holdout,
    without_new_labels,
)
from rm3d_plugin.regions import MergeRules
from rm3d_plugin.structures import Boxes3D, PseudoLabels


def annotated_of(semantic, instance=None, **more):
    semantic = np.asarray(semantic, dtype=np.int64)
    instance = np.full(len(semantic), -1) if instance is None else np.asarray(instance)
    return AnnotatedLabels(semantic, instance, Boxes3D.empty(), **more)


def rng(seed=0):
    return np.random.default_rng(seed)


def test_the_share_is_kept_aside_and_removed_from_what_is_known():
    annotated = annotated_of(np.repeat([0, 1, -1], [60, 40, 900]))
    held = split_holdout(annotated, 0.1, rng())
    assert len(held.points) == 10 and (np.diff(held.points) > 0).all()
    assert (held.annotated.semantic[held.points] == -1).all() and (held.annotated.instance[held.points] == -1).all()
    np.testing.assert_array_equal(held.classes, annotated.semantic[held.points])
    rest = np.setdiff1d(np.arange(1000), held.points)
    np.testing.assert_array_equal(held.annotated.semantic[rest], annotated.semantic[rest])
    np.testing.assert_array_equal(split_holdout(annotated, 0.1, rng()).points, held.points)
    assert split_holdout(annotated, 0.1, rng(1)).points.tolist() != held.points.tolist()


@pytest.mark.parametrize('seed', range(5))
def test_every_class_and_instance_keeps_a_point(seed):
    semantic = np.array([0, 0, 1, 1, 2, 0, 0, -1])
    instance = np.array([0, 0, -1, -1, 3, 1, 1, -1])
    held = split_holdout(annotated_of(semantic, instance), 0.9, rng(seed))
    assert len(held.points) == 3
    left = held.annotated.semantic >= 0
    assert set(zip(held.annotated.semantic[left], held.annotated.instance[left], strict=True)) == {
        (0, 0),
        (0, 1),
        (1, -1),
        (2, 3),
    }


def test_nothing_is_kept_aside_of_few_points_or_complete_scenes():
    assert len(split_holdout(annotated_of([0, 1, 2, -1]), 0.5, rng()).points) == 0
    assert len(split_holdout(annotated_of([0] * 50, complete=True), 0.5, rng()).points) == 0
    assert len(split_holdout(annotated_of([0] * 50), 0.0, rng()).points) == 0
    assert len(split_holdout(annotated_of(np.zeros(0, dtype=int)), 0.5, rng()).points) == 0
    with pytest.raises(ValueError, match=r'share: expected a number in \[0, 1\), got 1'):
        split_holdout(annotated_of([0]), 1, rng())


def test_errors_by_hand():
    held = Holdout(annotated_of([-1] * 6), np.array([0, 1, 2, 3]), np.array([0, 0, 1, 1]))
    got = holdout_errors(np.array([0, 1, 1, -1, 2, 2]), held, 3)
    assert got.compared.tolist() == [1, 2, 0] and got.wrong.tolist() == [0, 1, 0]
    assert got.share[:2].tolist() == [0.0, 0.5] and np.isnan(got.share[2])
    both = got + got
    assert both.compared.tolist() == [2, 4, 0]
    assert (got.whole().compared.tolist(), got.whole().wrong.tolist()) == ([3], [1])


def test_worse_needs_a_margin_and_evidence():
    old = HoldoutErrors(np.array([100, 100, 100, 0]), np.array([10, 10, 10, 0]))
    new = HoldoutErrors(np.array([100, 100, 4, 10]), np.array([14, 16, 4, 1]))
    assert got_worse(new, old, 0.05).tolist() == [False, True, False, True]
    assert got_worse(new, old, 0.05, min_compared=1).tolist() == [False, True, True, True]
    nothing = HoldoutErrors(np.zeros(2, dtype=int), np.zeros(2, dtype=int))
    assert got_worse(nothing, nothing, 0.0).tolist() == [False, False]


def labels_of(semantic, instance=None, is_annotated=None, confidence=None):
    n = len(semantic)
    return PseudoLabels(
        semantic=np.array(semantic),
        instance=np.full(n, -1) if instance is None else np.array(instance),
        point_is_annotated=np.zeros(n, dtype=bool) if is_annotated is None else np.array(is_annotated),
        confidence=np.full(n, 0.9, dtype=np.float32) if confidence is None else np.array(confidence, dtype=np.float32),
        boxes=Boxes3D.empty(),
        box_is_annotated=np.zeros(0, dtype=bool),
    )


def test_new_labels_of_a_class_go_and_everything_else_stays():
    previous = labels_of([0, -1, -1, 1, 1], [4, -1, -1, 5, 6], confidence=[0.8, 0, 0, 0.7, 0.7])
    now = labels_of([0, 0, 1, 0, 0], [4, 7, 8, 7, 7], [True, False, False, False, True])
    got = without_new_labels(now, previous, np.array([True, False]))
    assert got.semantic.tolist() == [0, -1, 1, 1, 0]
    assert got.confidence.tolist() == pytest.approx([0.9, 0, 0.9, 0.7, 0.9])
    assert got.instance[[0, 1, 2, 4]].tolist() == [4, -1, 8, 7]
    assert got.instance[3] not in (4, 7, 8)  # back, under a number that this round does not use
    same = without_new_labels(now, previous, np.array([False, False]))
    assert same.semantic.tolist() == now.semantic.tolist() and same.instance.tolist() == now.instance.tolist()
    first = without_new_labels(now, None, np.array([True, True]))
    assert first.semantic.tolist() == [0, -1, -1, -1, 0]


def test_points_kept_aside_do_not_reach_the_labels():
    patches = make_patches(share=0.1)
    held = split_holdout(patches.annotated, 0.2, rng())
    assert len(held.points) > 5
    lied = AnnotatedLabels(patches.annotated.semantic.copy(), patches.annotated.instance.copy(), Boxes3D.empty())
    lied.semantic[held.points] = (lied.semantic[held.points] + 1) % CLASSES

    def labels(annotated):
        rows = patches.softmax(rng(1))
        scene = refreshing.inputs(patches, annotated, rows)
        return refreshing.points(scene, MergeRules(), 3, patches.counts).labels

    # The split does not look at which class a kept-aside point has where the others keep theirs.
    blind = AnnotatedLabels(held.annotated.semantic, held.annotated.instance, Boxes3D.empty())
    np.testing.assert_array_equal(labels(held.annotated).semantic, labels(blind).semantic)
    assert not labels(held.annotated).point_is_annotated[held.points].any()
    errors = holdout_errors(labels(held.annotated).semantic, held, CLASSES)
    assert errors.compared.sum() > 0
    wrong = holdout_errors(
        labels(held.annotated).semantic, Holdout(held.annotated, held.points, lied.semantic[held.points]), CLASSES
    )
    assert got_worse(wrong, errors, 0.05, min_compared=1).any() and not got_worse(errors, errors, 0.05).any()


def test_a_spoilt_round_is_taken_back_and_coverage_stays():
    rules, scenes = MergeRules(gamma=0.5), []
    for seed in range(6):
        patches = make_patches(seed, share=0.1)
        held = split_holdout(patches.annotated, 0.3, rng())
        scene = refreshing.inputs(patches, held.annotated)
        first = refreshing.points(scene, rules, 0, patches.counts).labels
        rows = patches.softmax(rng(seed), noise=0.1)[:, [1, 0, 2]]  # a network that takes class 0 for 1 and 1 for 0
        scene = refreshing.inputs(patches, held.annotated, rows, previous=first)
        second = refreshing.points(scene, rules, 4, patches.counts).labels
        scenes.append((patches.truth, held, first, second))
    old, new = (reduce(add, (holdout_errors(s[i].semantic, s[1], CLASSES) for s in scenes)) for i in (2, 3))
    bad = got_worse(new, old, 0.05)
    assert bad.tolist() == [True, True, False]
    for truth, _, first, second in scenes:
        mended = without_new_labels(second, first, bad)
        assert first.coverage <= mended.coverage <= second.coverage
        pseudo = [(x.semantic >= 0) & ~x.point_is_annotated for x in (first, mended)]
        right = [(x.semantic == truth)[p].mean() for x, p in zip((first, mended), pseudo, strict=True)]
        assert right[1] >= right[0] - 1e-9
