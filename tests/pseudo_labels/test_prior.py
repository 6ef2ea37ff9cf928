"""What a region may be before any network is asked."""

from dataclasses import replace

import numpy as np
import pytest
from pseudo_labels.patches import CLASSES, make_patches

from rm3d_plugin.engine.replay import decide_again
from rm3d_plugin.pseudo_labels import refresh_points
from rm3d_plugin.pseudo_labels.prior import (
    BANDWIDTH,
    DOUBT,
    NEIGHBORS,
    OTHER_COLOR,
    SAMPLE,
    RegionExamples,
    collect_examples,
    color_likeness,
    looks_shares,
    nearness,
    region_looks,
    region_prior,
    with_prior,
)
from rm3d_plugin.pseudo_labels.propagate import Pooled
from rm3d_plugin.regions import MergeLedger, MergeStrategy
from rm3d_plugin.regions.prepare import PreparedScene
from rm3d_plugin.structures import PointCloud, RegionGraph, Regions


def plain_examples(looks, classes):
    looks = np.asarray(looks, dtype=np.float64)
    return RegionExamples(looks, np.asarray(classes), np.zeros(looks.shape[1]), np.ones(looks.shape[1]))


def make_graph(count, **fields):
    plain = dict(
        centroids=np.zeros((count, 3)),
        normals=np.tile([0.0, 0, 1], (count, 1)),
        curvatures=np.zeros(count),
        descriptors=np.zeros((count, 2)),
        colors=None,
        extents=np.ones((count, 3)),
        sizes=np.ones(count, dtype=np.int64),
        edges=np.zeros((0, 2), dtype=np.int64),
    )
    return RegionGraph(**(plain | fields))


# ---------------------------------------------------------------------- looks


def test_votes_by_hand():
    examples = plain_examples([[0.0], [0.0], [3.0]], [1, 1, 0])
    got = looks_shares(np.array([[0.0], [np.sqrt(BANDWIDTH)], [3.0], [50.0]]), examples, 2)
    near = (2 + DOUBT) / (2 + 2 * DOUBT)
    far = (2 / np.e + DOUBT) / (2 / np.e + 2 * DOUBT)
    one = (1 + DOUBT) / (1 + 2 * DOUBT)
    assert got[:, 1] == pytest.approx([near, far, 1 - one, 0.5], abs=1e-6)
    assert got.sum(axis=1) == pytest.approx(1.0)


@pytest.mark.parametrize('seed', range(3))
def test_votes_as_a_slow_twin(seed):
    rng = np.random.default_rng(seed)
    examples, looks = plain_examples(rng.random((40, 3)), rng.integers(0, 4, 40)), rng.random((25, 3))
    got = looks_shares(looks, examples, 4)
    for row, look in zip(got, looks, strict=True):
        order = sorted(range(40), key=lambda j: (np.square(look - examples.looks[j]).sum(), j))[:NEIGHBORS]
        votes = [DOUBT] * 4
        for j in order:
            votes[examples.classes[j]] += np.exp(-np.square(look - examples.looks[j]).sum() / BANDWIDTH)
        assert row == pytest.approx(np.array(votes) / sum(votes))


def test_looks_by_hand():
    xyz = np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, 3]])
    graph = make_graph(
        2,
        normals=np.array([[0.0, 0, -1], [0.6, 0, 0.8]]),
        curvatures=np.array([0.1, 0.2]),
        descriptors=np.array([[5.0, 6.0], [7.0, 8.0]]),
        extents=np.array([[1.0, 0, 0], [2.0, 0.5, 0.1]]),
        sizes=np.array([2, 2]),
    )
    looks = region_looks(PointCloud(xyz), Regions(np.array([0, 0, 1, 1])), graph)
    log = np.log(np.array([[1.05, 0.05, 0.05], [2.05, 0.55, 0.15]]))
    assert looks[0].tolist() == pytest.approx([1.0, 0.1, *log[0], 0.0, 0.0, 5.0, 6.0], abs=1e-9)
    assert looks[1].tolist() == pytest.approx([0.8, 0.2, *log[1], 1.0, 3.0, 7.0, 8.0], abs=1e-9)
    moved = region_looks(PointCloud(xyz + [10.0, -5.0, 7.0]), Regions(np.array([0, 0, 1, 1])), graph)
    assert moved == pytest.approx(looks)
    nothing = region_looks(PointCloud(np.zeros((0, 3))), Regions(np.zeros(0, dtype=np.int64)), make_graph(0))
    assert nothing.shape == (0, 7 + 2)


def test_examples_are_scaled_over_all_large_regions():
    rng = np.random.default_rng(0)
    looks = [rng.normal(3.0, [2.0] * 7 + [1.0] * 4 + [0.0], (400, 12)) for _ in range(2)]
    classes = [np.where(np.arange(400) < 5, 2, -1), np.full(400, -1)]
    sizes = [np.where(np.arange(400) == 4, 3, 100), np.full(400, 100)]
    found = collect_examples(zip(looks, classes, sizes, strict=True))
    assert found.classes.tolist() == [2, 2, 2, 2]  # the fifth is too small
    large = np.concatenate([np.delete(looks[0], 4, axis=0), looks[1]])
    assert found.middle == pytest.approx(large.mean(axis=0))
    shape = (looks[0][:4, :7] - large[:, :7].mean(axis=0)) / large[:, :7].std(axis=0)
    assert found.looks[:, :7] == pytest.approx(shape / np.sqrt(7))
    spread = (large - found.middle) * found.scale
    assert spread[:, :7].var(axis=0).sum() == pytest.approx(1.0)  # shape and height together
    assert spread[:, 7:].var(axis=0).sum() == pytest.approx(0.5 * 4 / 5)  # descriptors; the constant one tells nothing
    assert collect_examples([(looks[1], classes[1], sizes[1])]) is None
    assert collect_examples([]) is None


# ---------------------------------------------------------------------- place


@pytest.mark.parametrize('seed', range(3))
def test_nearness_as_a_slow_twin(seed):
    rng = np.random.default_rng(seed)
    xyz = rng.random((300, 3)) * 4
    regions = Regions(rng.integers(-1, 20, 300))
    truth = np.where(rng.random(300) < 0.05, rng.integers(0, 3, 300), -1)
    reach = np.array([0.5, np.nan, 3.0, 1.0])
    got = nearness(xyz, regions, truth, reach)
    assert regions.sizes.max() <= SAMPLE  # so the sample holds each point about as often as any other
    for region in range(len(regions)):
        members = regions.points_of(region)
        chosen = members[np.linspace(0, len(members) - 1, SAMPLE).astype(int)]
        for c, length in enumerate([0.5, 1.0, 3.0, 1.0]):  # the unknown one is the median of the others
            marks = xyz[truth == c]
            wanted = 0.0
            if len(marks):
                distance = np.mean([min(np.linalg.norm(mark - xyz[p]) for mark in marks) for p in chosen])
                wanted = np.exp(-distance / length) / np.sqrt(length)
            assert got[region, c] == pytest.approx(wanted)


def test_nearness_where_little_is_known():
    xyz, regions = np.array([[0.0, 0, 0], [2, 0, 0], [9, 9, 9]]), Regions(np.array([0, 1, -1]))
    nobody = nearness(xyz, regions, np.full(3, -1), np.array([1.0, 2.0]))
    assert nobody.tolist() == [[1.0, 1.0], [1.0, 1.0]]
    no_length = nearness(xyz, regions, np.array([1, -1, -1]), np.full(2, np.nan))
    assert no_length == pytest.approx(np.array([[0, 1.0], [0, np.exp(-2.0)]]))
    empty = nearness(xyz[:0], Regions(np.zeros(0, dtype=np.int64)), np.zeros(0, dtype=np.int64), np.ones(2))
    assert empty.shape == (0, 2)
    none_kept = nearness(xyz, Regions(np.full(3, -1)), np.array([0, -1, -1]), np.ones(2))
    assert none_kept.shape == (0, 2)


# ---------------------------------------------------------------------- colour


def test_color_likeness_by_hand():
    colors = np.array([[50.0, 0, 0], [50, 15, 0], [50, 0, 30], [80, 0, 0]])
    regions = np.array([0, 0, 1, 2, 3, -1])
    truth = np.array([1, -1, -1, 1, 0, 2])  # class 1 in regions 0 and 2, class 0 in region 3, class 2 in none
    got = color_likeness(colors, regions, truth, 15.0, 3)
    assert got[:, 1] == pytest.approx(np.exp(-np.array([0, 1, 0, 2.0])) + OTHER_COLOR)
    assert got[:, 0] == pytest.approx(np.exp(-np.linalg.norm(colors - colors[3], axis=1) / 15) + OTHER_COLOR)
    assert got[:, 2].tolist() == [OTHER_COLOR] * 4


@pytest.mark.parametrize('channels', [3, 1, 0])
def test_the_prior_is_the_product_of_what_can_be_told(channels):
    rng = np.random.default_rng(0)
    cloud, regions = PointCloud(rng.random((60, 3)).astype(np.float32)), Regions(np.repeat(np.arange(6), 10))
    colors = rng.random((6, channels)) * (50 if channels == 3 else 1) if channels else None
    scene = PreparedScene(cloud, regions, make_graph(6, colors=colors, descriptors=rng.random((6, 2))))
    truth = np.full(60, -1)
    truth[[3, 25]] = [0, 1]
    examples, strategy = plain_examples(rng.random((12, 9)), rng.integers(0, 2, 12)), MergeStrategy()
    reach = np.array([0.5, 1.0])
    wanted = nearness(cloud.xyz, regions, truth, reach)
    if channels:
        sigma = {3: strategy.color_sigma, 1: strategy.intensity_sigma}[channels]
        wanted = wanted * color_likeness(colors, regions.labels, truth, sigma, 2)
    assert region_prior(scene, truth, reach, None, strategy) == pytest.approx(wanted)
    wanted = wanted * looks_shares(region_looks(cloud, regions, scene.graph), examples, 2)
    assert region_prior(scene, truth, reach, examples, strategy) == pytest.approx(wanted)


# ---------------------------------------------------------------------- prior and network


def test_prior_times_network():
    prior = np.array([[1.0, 3.0], [0.0, 2.0], [0.0, 0.0], [1.0, 1.0]])
    pooled = Pooled(np.array([[0.6, 0.4], [1.0, 0.0], [0.5, 0.5], [np.nan, np.nan]]), np.array([5, 4, 3, 0]))
    got = with_prior(pooled, np.array([9, 9, 9, 9]), prior)
    np.testing.assert_allclose(got.values, [[0.6 / 1.8, 1.2 / 1.8], *[[np.nan] * 2] * 3])
    assert got.seen.tolist() == [5, 4, 3, 0]
    alone = with_prior(None, np.array([9, 8, 7, 6]), prior)
    np.testing.assert_allclose(alone.values, [[0.25, 0.75], [0, 1], [np.nan] * 2, [0.5, 0.5]])
    assert alone.seen.tolist() == [9, 8, 7, 6]


def test_labels_by_prior_and_network():
    patches = make_patches(0, revealed=0.02)
    strategy = MergeStrategy(tau_merge=4.0, tau_seed=4.0, thresholds='literal', gamma=0.6, rounds=4, region_prior=True)
    regions = patches.regions.labels
    prior = np.full((len(patches.regions), CLASSES), 0.1)
    odd = np.arange(len(patches.regions)) % 2 == 1
    prior[odd, 1] = 0.8

    def refresh(number, rows, prior):
        return refresh_points(
            patches.cloud, patches.regions, patches.graph, patches.weak, rows, None, None, strategy, number,
            patches.counts, (0, 1), None, prior,
        )  # fmt: skip

    plain, filled = refresh(0, None, None), refresh(0, None, prior)
    expected = (plain.labels.semantic < 0) & odd[regions]
    assert expected.any() and not expected.all()
    assert (filled.labels.semantic[expected] == 1).all()
    assert filled.labels.confidence[expected] == pytest.approx(0.8)
    assert (filled.labels.semantic[~expected] == plain.labels.semantic[~expected]).all()
    assert not filled.labels.point_is_true[expected].any()
    ledger = MergeLedger.from_arrays(filled.merge.ledger.to_arrays())
    assert (decide_again(ledger, filled.labels, None).semantic == filled.labels.semantic).all()
    surer = decide_again(ledger, filled.labels, None, replace(strategy, gamma=0.81))
    assert (surer.semantic == plain.labels.semantic).all()

    rows = np.tile([0.02, 0.02, 0.96], (len(regions), 1))  # .8 * .02 against .1 * .96
    named = refresh(1, rows, prior)
    assert (named.labels.semantic[expected] == 2).all()
    assert named.labels.confidence[expected] == pytest.approx(0.096 / (0.096 + 0.016 + 0.002))


def test_a_bad_switch_is_told():
    with pytest.raises(ValueError, match=r'region_prior: expected True or False'):
        MergeStrategy(region_prior=0.5)
