"""A region with annotated points of several classes gives each point the class of the near and alike one."""

from dataclasses import replace

import numpy as np
import pytest
from pseudo_labels import refreshing
from pseudo_labels.patches import make_patches

from rm3d_plugin.pseudo_labels import PropagationRules, SegmentationRules
from rm3d_plugin.pseudo_labels.common.annotated import annotated_region_classes, usual_lengths
from rm3d_plugin.pseudo_labels.common.groups import confident_parts
from rm3d_plugin.pseudo_labels.segmentation.propagation import (
    NEAR_COLOR,
    NEAR_PLACE,
    differs_from_seed,
    mixed_regions,
    nearest_seeds,
    seeds_of_long_regions,
)
from rm3d_plugin.pseudo_labels.segmentation.propagation import nearest_classes as classes_by_seeds
from rm3d_plugin.regions import MergeLedger, MergeRules
from rm3d_plugin.reporting.replay import decide_again
from rm3d_plugin.structures import PointCloud, Regions

MERGE = MergeRules(gamma=0.5, rounds=4)
NEAREST = SegmentationRules(MERGE, PropagationRules())


def nearest_classes(xyz, colors, region, truth):
    return classes_by_seeds(region, truth, nearest_seeds(PointCloud(xyz, colors=colors), region, truth))


def by_hand(where, regions, truth):
    """Slow twin: every point looks at every labelled point of its region."""
    out = np.full(len(where), -1)
    for i, region in enumerate(regions):
        own = [j for j in range(len(where)) if regions[j] == region and truth[j] >= 0]
        if region >= 0 and len({truth[j] for j in own}) > 1:
            out[i] = truth[min(own, key=lambda j: (np.square(where[i] - where[j]).sum(), j))]
    return out


def test_a_window_in_a_wall():
    x = np.arange(8.0)
    xyz = np.stack([x, 0 * x, 0 * x], axis=1)
    grey, blue = [0.5, 0.5, 0.5], [0.2, 0.4, 0.9]
    colors = np.array([grey, grey, grey, blue, blue, blue, grey, grey])
    truth = np.array([0, -1, -1, -1, -1, 1, -1, -1])
    region = np.zeros(8, dtype=int)
    place_alone = nearest_classes(xyz, None, region, truth)
    assert place_alone.tolist() == [0, 0, 0, 1, 1, 1, 1, 1]
    with_color = nearest_classes(xyz / 8, colors, region, truth)
    assert with_color.tolist() == [0, 0, 0, 1, 1, 1, 0, 0]


@pytest.mark.parametrize('seed', range(4))
def test_as_by_hand(seed):
    rng = np.random.default_rng(seed)
    xyz, colors = rng.random((2, 60, 3)).astype(np.float32)
    region, truth = rng.integers(-1, 5, 60), np.where(rng.random(60) < 0.3, rng.integers(0, 3, 60), -1)
    found = nearest_classes(xyz, colors, region, truth)
    assert found.tolist() == by_hand(np.c_[xyz / NEAR_PLACE, colors / NEAR_COLOR], region, truth).tolist()
    assert set(mixed_regions(region, truth)) == {
        r for r in range(5) if len(set(truth[(region == r) & (truth >= 0)])) > 1
    }


def test_nothing_known_or_nothing_there():
    empty = np.zeros(0, dtype=int)
    assert nearest_classes(np.zeros((0, 3)), None, empty, empty).tolist() == []
    unknown = np.full(3, -1)
    assert nearest_classes(np.zeros((3, 3)), None, np.zeros(3, dtype=int), unknown).tolist() == [-1] * 3


def test_only_mixed_regions_change_and_a_replay_keeps_them():
    patches = make_patches(1, share=0.05)
    # Every four patches in a row are one region, so that many hold two classes.
    regions = Regions(np.asarray(patches.regions.labels) // 4)
    graph = replace(
        patches.graph,
        **{
            name: getattr(patches.graph, name)[::4]
            for name in ('centroids', 'normals', 'curvatures', 'descriptors', 'colors', 'extents', 'sizes')
        },
        edges=np.array([[i, i + 1] for i in range(15)]),
    )
    cloud = PointCloud(patches.cloud.xyz, colors=np.random.default_rng(0).random((len(patches.truth), 3)))

    scene = refreshing.inputs(replace(patches, cloud=cloud, regions=regions, graph=graph))
    majority, nearest = (refreshing.points(scene, rules, 0, patches.counts, (0,)) for rules in (MERGE, NEAREST))
    mixed = np.isin(regions.labels, mixed_regions(regions.labels, patches.annotated.semantic))
    assert mixed.any() and not mixed.all()
    assert (majority.labels.semantic == nearest.labels.semantic)[~mixed].all()
    assert (majority.labels.semantic != nearest.labels.semantic)[mixed].any()
    assert nearest.labels.coverage == majority.labels.coverage
    ledger = MergeLedger.from_arrays(nearest.merge.ledger.to_arrays())
    assert (decide_again(ledger, nearest.labels, None).semantic == nearest.labels.semantic).all()


def test_a_picture_does_not_name_the_wall_around_it():
    x = np.arange(6.0)
    xyz = np.stack([x, 0 * x, 0 * x], axis=1)
    colors = np.array([[0.9, 0.2, 0.1]] * 2 + [[0.5, 0.5, 0.5]] * 4)
    truth = np.array([3, -1, -1, -1, -1, -1])
    region = np.array([0, 0, 0, 0, 1, -1])
    seeds = nearest_seeds(PointCloud(xyz, colors=colors), region, truth)
    assert seeds.tolist() == [0, 0, 0, 0, -1, -1]
    unlike = differs_from_seed(colors, seeds, 0.3)
    assert unlike.tolist() == [False, False, True, True, False, False]
    rows = np.array([[0.9, 0.1], [0.9, 0.1], [0.2, 0.8], [0.4, 0.6], [0.0, 1.0], [np.nan, np.nan]])
    classes, confidence = confident_parts(rows, region, unlike, 0.7)
    assert classes.tolist() == [-1, -1, 1, 1, -1, -1]
    np.testing.assert_allclose(confidence, [0, 0, 0.7, 0.7, 0, 0])
    assert confident_parts(rows, region, unlike, 0.71)[0].tolist() == [-1] * 6
    assert confident_parts(np.full((6, 2), np.nan), region, unlike, 0.5)[0].tolist() == [-1] * 6


def test_points_of_another_colour_wait_for_the_network_and_a_replay_keeps_that():
    patches = make_patches(1, share=0.05)
    rng = np.random.default_rng(0)
    colors = np.where(rng.random(len(patches.truth))[:, None] < 0.5, 0.2, 0.8) * np.ones(3)
    cloud = PointCloud(patches.cloud.xyz, colors=colors)
    rules = SegmentationRules(replace(MERGE, gamma=0.9), PropagationRules(max_color=0.3))

    def refresh(rows, previous, round):
        scene = refreshing.inputs(patches, rows=rows, previous=previous, cloud=cloud)
        return refreshing.points(scene, rules, round, patches.counts, (0,))

    first = refresh(None, None, 0).labels
    seeds = nearest_seeds(cloud, patches.regions.labels, patches.annotated.semantic)
    unlike = differs_from_seed(colors, seeds, 0.3)
    assert unlike.any() and (first.semantic[unlike] == -1).all() and (first.semantic[(seeds >= 0) & ~unlike] >= 0).all()
    sure = np.eye(len(patches.counts))[np.where(unlike, 1, 0)]
    second = refresh(sure, first, 1)
    assert (second.labels.semantic[unlike] == 1).all()
    kept = first.semantic >= 0
    assert (second.labels.semantic[kept] == first.semantic[kept]).all()
    ledger = MergeLedger.from_arrays(second.merge.ledger.to_arrays())
    assert (decide_again(ledger, second.labels, first).semantic == second.labels.semantic).all()


def test_usual_lengths_are_medians_of_enough_regions():
    region = np.array([0, 0, 0, 1, 1, 2, -1])
    truth = np.array([2, 2, 0, -1, 2, 2, 0])
    seeded = annotated_region_classes(region, truth)
    assert list(zip(seeded.regions.tolist(), seeded.classes.tolist(), strict=True)) == [(0, 0), (0, 2), (1, 2), (2, 2)]
    usual = usual_lengths(seeded.classes, np.array([9.0, 9.0, 1.0, 2.0]), 4)
    np.testing.assert_array_equal(usual, [np.nan, np.nan, 2.0, np.nan])  # one region of class 0: not enough
    assert len(usual_lengths(np.zeros(0, dtype=int), np.zeros(0), 2)) == 2


def test_a_point_that_fell_upon_the_wall_speaks_for_itself_alone():
    region, truth = np.array([0, 0, 1, 1, -1]), np.array([3, 0, 3, -1, 3])
    lengths, usual = np.array([6.0, 1.0]), np.array([5.0, np.nan, np.nan, 1.2])
    assert seeds_of_long_regions(region, truth, lengths, 3 * usual).tolist() == [True, False, False, False, False]
    assert not seeds_of_long_regions(region, truth, lengths, np.full(4, np.nan)).any()


def test_regions_too_long_for_their_class_wait_for_the_network_and_a_replay_keeps_that():
    patches = make_patches(1, share=0.05)
    lengths = np.linalg.norm(patches.graph.extents, axis=1)
    known = patches.annotated.semantic >= 0
    asked = int(patches.annotated.semantic[known][0])
    usual = np.full(len(patches.counts), np.nan)
    usual[asked] = 0.4 * lengths.min()
    rules = SegmentationRules(replace(MERGE, gamma=0.9), PropagationRules(max_extent=2.0))

    def refresh(rows, previous, round, rules=rules):
        scene = refreshing.inputs(patches, rows=rows, previous=previous)
        return refreshing.points(scene, rules, round, patches.counts, (0,), class_lengths=usual)

    first = refresh(None, None, 0).labels
    assert (first.semantic == asked).sum() == (patches.annotated.semantic == asked).sum() > 0
    assert (first.semantic[known] == patches.annotated.semantic[known]).all()
    others = np.unique(patches.regions.labels[known & (patches.annotated.semantic != asked)])
    assert (first.semantic[np.isin(patches.regions.labels, others)] >= 0).all()
    second = refresh(np.eye(len(patches.counts))[patches.truth], first, 1)
    assert second.labels.coverage == 1.0 and (second.labels.semantic == patches.truth).mean() > 0.9
    ledger = MergeLedger.from_arrays(second.merge.ledger.to_arrays())
    assert (decide_again(ledger, second.labels, first).semantic == second.labels.semantic).all()
    plain = refresh(None, None, 0, replace(rules, propagation=PropagationRules()))
    assert plain.labels.coverage > first.coverage


def test_the_choice_is_checked():
    with pytest.raises(ValueError, match=r'PropagationRules\.max_color: expected a number > 0, or None, got 0.0'):
        PropagationRules(max_color=0.0)
    with pytest.raises(ValueError, match=r'PropagationRules\.max_extent'):
        PropagationRules(max_extent=float('inf'))
    with pytest.raises(ValueError, match=r'PropagationRules\.new_instances: expected True or False'):
        PropagationRules(new_instances='no')
