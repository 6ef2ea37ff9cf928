"""What a region may be before any network is asked."""

from dataclasses import replace

import numpy as np
import pytest
from pseudo_labels import refreshing
from pseudo_labels.patches import CLASSES, make_patches
from pseudo_labels.region_graphs import make_graph, plain_examples

from rm3d_plugin.pseudo_labels import RegionPriorRules, SegmentationRules
from rm3d_plugin.pseudo_labels.common.distance_prior import DECAY, SAMPLE, annotated_distances, distance_prior
from rm3d_plugin.pseudo_labels.common.groups import Pooled
from rm3d_plugin.pseudo_labels.region_prior.features import knn_class_prior, prior_features
from rm3d_plugin.pseudo_labels.region_prior.prior import (
    OTHER_COLOR,
    classless_regions,
    color_likeness,
    region_prior,
    with_prior,
)
from rm3d_plugin.regions import MergeLedger, MergeRules
from rm3d_plugin.regions.prepare import PreparedScene
from rm3d_plugin.reporting.replay import ReplayRules, decide_again
from rm3d_plugin.structures import PointCloud, Regions

# ---------------------------------------------------------------------- place


@pytest.mark.parametrize('seed', range(3))
def test_distances_as_a_slow_twin(seed):
    rng = np.random.default_rng(seed)
    xyz = rng.random((300, 3)) * 4
    regions = Regions(rng.integers(-1, 20, 300))
    truth = np.where(rng.random(300) < 0.05, rng.integers(0, 3, 300), -1)
    got = annotated_distances(xyz, regions, truth, 4)
    assert regions.sizes.max() <= SAMPLE  # so the sample holds each point about as often as any other
    for region in range(len(regions)):
        members = regions.points_of(region)
        chosen = members[np.linspace(0, len(members) - 1, SAMPLE).astype(int)]
        for c in range(4):
            marks = xyz[truth == c]
            wanted = np.inf
            if len(marks):
                wanted = np.mean([min(np.linalg.norm(mark - xyz[p]) for mark in marks) for p in chosen])
            assert got[region, c] == pytest.approx(wanted)


def test_no_distances_without_regions():
    none = np.zeros(0, dtype=np.int64)
    assert annotated_distances(np.zeros((0, 3)), Regions(none), none, 2).shape == (0, 2)
    assert annotated_distances(np.ones((3, 3)), Regions(np.full(3, -1)), np.array([0, -1, -1]), 2).shape == (0, 2)


def test_nearness_by_hand():
    distance, lengths = np.array([[2.0, 3.0, np.inf]]), np.array([0.5, np.nan, 4.0])
    by_length = distance_prior(distance, lengths, None)  # the unknown length is the median of the others, 2.25 m
    assert by_length == pytest.approx(np.array([[np.exp(-4) / 0.5**0.5, np.exp(-3 / 2.25) / 1.5, 0.0]]))
    assert distance_prior(distance, np.full(3, np.nan), None) == pytest.approx(np.exp(-distance))
    assert DECAY == 1.5
    assert distance_prior(distance, lengths, 1.0) == pytest.approx(np.array([[3**-1.5, 1 / 8, 0.0]]))
    assert distance_prior(distance, lengths, 0.5) == pytest.approx(np.array([[5**-1.5, 7**-1.5, 0.0]]))
    for scale in (None, 1.0):
        assert distance_prior(np.full((2, 3), np.inf), lengths, scale).tolist() == [[1.0] * 3] * 2


# ---------------------------------------------------------------------- colour


def test_color_likeness_by_hand():
    colors = np.array([[50.0, 0, 0], [50, 15, 0], [50, 0, 30], [80, 0, 0]])
    regions = np.array([0, 0, 1, 2, 3, -1])
    truth = np.array([1, -1, -1, 1, 0, 2])  # class 1 in regions 0 and 2, class 0 in region 3, class 2 in none
    got = color_likeness(colors, regions, truth, 15.0, 3)
    assert got[:, 1] == pytest.approx(np.exp(-np.array([0, 1, 0, 2.0])) + OTHER_COLOR)
    assert got[:, 0] == pytest.approx(np.exp(-np.linalg.norm(colors - colors[3], axis=1) / 15) + OTHER_COLOR)
    assert got[:, 2].tolist() == [OTHER_COLOR] * 4


def of_sum_one(rows):
    return rows / rows.sum(axis=1, keepdims=True)


@pytest.mark.parametrize(('channels', 'scale'), [(3, None), (1, 1.0), (0, 0.3)])
def test_the_prior_is_the_product_of_what_can_be_told(channels, scale):
    rng = np.random.default_rng(0)
    cloud, regions = PointCloud(rng.random((60, 3)).astype(np.float32)), Regions(np.repeat(np.arange(6), 10))
    colors = rng.random((6, channels)) * (50 if channels == 3 else 1) if channels else None
    scene = PreparedScene(cloud, regions, make_graph(6, colors=colors, descriptors=rng.random((6, 2))))
    truth = np.full(60, -1)
    truth[[3, 25]] = [0, 1]
    examples, rules = (
        plain_examples(rng.random((12, 9)), rng.integers(0, 2, 12)),
        RegionPriorRules(distance_scale=scale),
    )
    lengths = np.array([0.5, 1.0])
    wanted = distance_prior(annotated_distances(cloud.xyz, regions, truth, 2), lengths, scale)
    if channels:
        sigma = {3: rules.color_sigma, 1: rules.intensity_sigma}[channels]
        wanted = wanted * color_likeness(colors, regions.labels, truth, sigma, 2)
    assert region_prior(scene, truth, lengths, None, rules) == pytest.approx(of_sum_one(wanted))
    wanted = wanted * knn_class_prior(prior_features(cloud, regions, scene.graph), examples, 2)
    assert region_prior(scene, truth, lengths, examples, rules) == pytest.approx(of_sum_one(wanted))


def test_regions_that_chance_should_have_met():
    regions = Regions(np.repeat([0, 1, 2, -1], [50, 40, 8, 2]))
    truth = np.full(100, -1)
    truth[[3, 5, 7, 9, 11, 13, 15, 17, 19, 99]] = 1  # a tenth of the points: region 1 misses four, region 2 not one
    assert classless_regions(regions, truth, 4.0).tolist() == [False, True, False]
    assert classless_regions(regions, truth, 0.8).tolist() == [False, True, True]
    assert not classless_regions(regions, truth, 4.1).any() and not classless_regions(regions, truth, None).any()
    assert not classless_regions(regions, np.full(100, -1), 4.0).any()
    cloud = PointCloud(np.random.default_rng(0).random((100, 3)).astype(np.float32))
    scene, rules = PreparedScene(cloud, regions, make_graph(3)), RegionPriorRules(missing_points=4.0)
    prior = region_prior(scene, truth, np.ones(2), None, rules)
    assert np.isnan(prior[1]).all() and (prior[[0, 2], 1] > 0).all()
    later = with_prior(Pooled(np.full((3, 2), 0.5), np.ones(3, dtype=int)), prior)
    assert np.isnan(later.values[1]).all() and np.isfinite(later.values[[0, 2]]).all()


# ---------------------------------------------------------------------- prior and network


def test_prior_times_network():
    prior = np.array([[1.0, 3.0], [0.0, 2.0], [0.0, 0.0], [1.0, 1.0]])
    pooled = Pooled(np.array([[0.6, 0.4], [1.0, 0.0], [0.5, 0.5], [np.nan, np.nan]]), np.array([5, 4, 3, 0]))
    got = with_prior(pooled, prior)
    np.testing.assert_allclose(got.values, [[0.6 / 1.8, 1.2 / 1.8], *[[np.nan] * 2] * 3])
    assert got.seen.tolist() == [5, 4, 3, 0]
    squared = with_prior(pooled, prior, 2.0)
    np.testing.assert_allclose(squared.values[0], np.array([0.36, 0.48]) / 0.84)


def test_labels_by_prior_and_network():
    patches = make_patches(0, share=0.02)
    merge = MergeRules(tau_merge=4.0, tau_seed=4.0, thresholds='literal', gamma=0.6, rounds=4)
    rules = SegmentationRules(merge, region_prior=RegionPriorRules())
    regions = patches.regions.labels
    prior = np.full((len(patches.regions), CLASSES), 0.1)
    odd = np.arange(len(patches.regions)) % 2 == 1
    prior[odd, 1] = 0.8

    def refresh(number, rows, prior):
        scene = refreshing.inputs(patches, rows=rows)
        return refreshing.points(scene, rules, number, patches.counts, (0, 1), prior=prior)

    plain, filled = refresh(0, None, None), refresh(0, None, prior)
    expected = (plain.labels.semantic < 0) & odd[regions]
    assert expected.any() and not expected.all()
    assert (filled.labels.semantic[expected] == 1).all()
    assert filled.labels.confidence[expected] == pytest.approx(0.8)
    assert (filled.labels.semantic[~expected] == plain.labels.semantic[~expected]).all()
    assert not filled.labels.point_is_annotated[expected].any()
    ledger = MergeLedger.from_arrays(filled.merge.ledger.to_arrays())
    assert (decide_again(ledger, filled.labels, None).semantic == filled.labels.semantic).all()
    surer = decide_again(ledger, filled.labels, None, ReplayRules(replace(merge, gamma=0.81)))
    assert (surer.semantic == plain.labels.semantic).all()

    rows = np.tile([0.02, 0.02, 0.96], (len(regions), 1))  # .8 * .02 against .1 * .96
    named = refresh(1, rows, prior)
    assert (named.labels.semantic[expected] == 2).all()
    assert named.labels.confidence[expected] == pytest.approx(0.096 / (0.096 + 0.016 + 0.002))


def test_a_bad_switch_is_told():
    for field, value, wanted in (
        ('classifier', 'shape', r"one of \('neighbors', 'kernel'\)"),
        ('gamma', 0.0, 'a probability in'),
        ('distance_scale', 0.0, 'a number > 0, or None'),
        ('inverse_temperature', 0.0, 'a number > 0'),
        ('missing_points', -1, 'a number > 0, or None'),
        ('heading', 'yes', 'True or False'),
    ):
        with pytest.raises(ValueError, match=rf'RegionPriorRules\.{field}: expected {wanted}'):
            RegionPriorRules(**{field: value})
