"""Regions without a label take the class of labelled regions that look alike."""

from dataclasses import replace

import numpy as np
import pytest
from pseudo_labels.patches import CLASSES, make_patches

from rm3d_plugin.engine.replay import decide_again
from rm3d_plugin.pseudo_labels import refresh_points
from rm3d_plugin.pseudo_labels.alike import (
    BANDWIDTH,
    DOUBT,
    LEAST_POINTS,
    NEIGHBORS,
    RegionExamples,
    RegionGuess,
    collect_examples,
    guess_by_looks,
    possible_classes,
    region_looks,
)
from rm3d_plugin.regions import MergeLedger, MergeStrategy
from rm3d_plugin.structures import PointCloud, RegionGraph, Regions


def plain_examples(looks, classes):
    looks = np.asarray(looks, dtype=np.float64)
    return RegionExamples(looks, np.asarray(classes), np.zeros(looks.shape[1]), np.ones(looks.shape[1]))


def test_votes_by_hand():
    examples = plain_examples([[0.0], [0.0], [3.0]], [1, 1, 0])
    sizes = np.full(3, LEAST_POINTS)
    looks = np.array([[0.0], [np.sqrt(BANDWIDTH)], [3.0]])
    got = guess_by_looks(looks, sizes, examples, np.ones(2, dtype=bool), 0.1)
    near, far, one = 2 / (2 + DOUBT), 2 / np.e / (2 / np.e + DOUBT), 1 / (1 + DOUBT)
    assert got.classes.tolist() == [1, 1, 0]
    assert got.confidence == pytest.approx([near, far, one], abs=1e-6)
    surer = guess_by_looks(looks, sizes, examples, np.ones(2, dtype=bool), 0.7)
    assert surer.classes.tolist() == [1, -1, -1] and surer.confidence[1:].tolist() == [0.0, 0.0]
    absent = guess_by_looks(looks, sizes, examples, np.array([True, False]), 0.1)
    assert absent.classes.tolist() == [-1, -1, 0]  # class 1 took the votes, and the scene does not hold it
    small = guess_by_looks(looks, np.array([LEAST_POINTS, LEAST_POINTS - 1, 0]), examples, np.ones(2, dtype=bool), 0.1)
    assert small.classes.tolist() == [1, -1, -1]


@pytest.mark.parametrize('seed', range(3))
def test_as_a_slow_twin(seed):
    rng = np.random.default_rng(seed)
    examples = plain_examples(rng.random((40, 3)), rng.integers(0, 4, 40))
    looks, possible = rng.random((25, 3)), np.array([True, True, False, True])
    got = guess_by_looks(looks, np.full(25, 50), examples, possible, 0.4)
    for i, look in enumerate(looks):
        order = sorted(range(40), key=lambda j: (np.square(look - examples.looks[j]).sum(), j))[:NEIGHBORS]
        votes = np.zeros(4)
        for j in order:
            votes[examples.classes[j]] += np.exp(-np.square(look - examples.looks[j]).sum() / BANDWIDTH)
        share = np.where(possible, votes, 0) / (votes.sum() + DOUBT)
        wanted = int(share.argmax()) if share.max() >= 0.4 else -1
        assert got.classes[i] == wanted
        assert got.confidence[i] == pytest.approx(share.max() if wanted >= 0 else 0.0)
    assert 0 < (got.classes >= 0).sum() < 25


def test_looks_by_hand():
    xyz = np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, 3]])
    graph = RegionGraph(
        centroids=np.zeros((2, 3)),
        normals=np.array([[0.0, 0, -1], [0.6, 0, 0.8]]),
        curvatures=np.array([0.1, 0.2]),
        descriptors=np.array([[5.0, 6.0], [7.0, 8.0]]),
        colors=None,
        extents=np.array([[1.0, 0, 0], [2.0, 0.5, 0.1]]),
        sizes=np.array([2, 2]),
        edges=np.zeros((0, 2), dtype=np.int64),
    )
    looks = region_looks(PointCloud(xyz), Regions(np.array([0, 0, 1, 1])), graph)
    log = np.log(np.array([[1.05, 0.05, 0.05], [2.05, 0.55, 0.15]]))
    assert looks[0].tolist() == pytest.approx([1.0, 0.1, *log[0], 0.0, 0.0, 5.0, 6.0], abs=1e-9)
    assert looks[1].tolist() == pytest.approx([0.8, 0.2, *log[1], 1.0, 3.0, 7.0, 8.0], abs=1e-9)
    moved = region_looks(PointCloud(xyz + [10.0, -5.0, 7.0]), Regions(np.array([0, 0, 1, 1])), graph)
    assert moved == pytest.approx(looks)
    nothing = region_looks(PointCloud(np.zeros((0, 3))), Regions(np.zeros(0, dtype=np.int64)), graph_of_none())
    assert nothing.shape == (0, 7 + 2)


def graph_of_none():
    return RegionGraph(
        centroids=np.zeros((0, 3)),
        normals=np.zeros((0, 3)),
        curvatures=np.zeros(0),
        descriptors=np.zeros((0, 2)),
        colors=None,
        extents=np.zeros((0, 3)),
        sizes=np.zeros(0, dtype=np.int64),
        edges=np.zeros((0, 2), dtype=np.int64),
    )


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


def test_possible_classes():
    assert possible_classes(np.array([2, -1, 0, 2]), 4).tolist() == [True, False, True, False]
    assert possible_classes(np.array([-1, -1]), 2).tolist() == [True, True]


def test_a_guess_fills_what_nothing_else_names():
    patches = make_patches(0, revealed=0.02)
    strategy = MergeStrategy(tau_merge=4.0, tau_seed=4.0, thresholds='literal', gamma=0.6, rounds=4, spread_alike=0.5)
    regions = patches.regions.labels
    guess = RegionGuess(np.where(np.arange(len(patches.regions)) % 2, 1, -1), np.full(len(patches.regions), 0.75))

    def refresh(number, rows, previous, guess):
        return refresh_points(
            patches.cloud, patches.regions, patches.graph, patches.weak, rows, None, previous, strategy, number,
            patches.counts, (0, 1), None, guess,
        )  # fmt: skip

    plain, filled = refresh(0, None, None, None), refresh(0, None, None, guess)
    votes = np.zeros(len(patches.regions), dtype=bool)
    votes[regions[patches.weak.semantic >= 0]] = True
    expected = (plain.labels.semantic < 0) & (regions % 2 == 1) & ~votes[regions]
    assert expected.any() and not expected.all()
    assert (filled.labels.semantic[expected] == 1).all() and (filled.labels.confidence[expected] == 0.75).all()
    assert (filled.labels.semantic[~expected] == plain.labels.semantic[~expected]).all()
    assert not filled.labels.point_is_true[expected].any()
    ledger = MergeLedger.from_arrays(filled.merge.ledger.to_arrays())
    assert (decide_again(ledger, filled.labels, None).semantic == filled.labels.semantic).all()
    surer = decide_again(ledger, filled.labels, None, replace(strategy, gamma=0.99))
    assert (surer.semantic == filled.labels.semantic).all()  # round 0: no threshold of the network has a say

    unsure = np.full((len(regions), CLASSES), 1 / CLASSES)
    unsure[regions < 20] = [0.1, 0.1, 0.8]
    asked, not_asked = (refresh(1, unsure, filled.labels, again).labels for again in (guess, None))
    for name in ('semantic', 'confidence', 'instance'):  # labels that stay make a second guess needless
        assert (getattr(asked, name) == getattr(not_asked, name)).all()

    rows = np.full((len(regions), CLASSES), 0.1)
    rows[:, 2] = 0.8  # the network names what nobody has named before the looks are asked
    named = refresh(1, rows, None, guess)
    assert (named.labels.semantic[expected] == 2).all()


def test_a_bad_confidence_is_told():
    with pytest.raises(ValueError, match=r'spread_alike: expected in \(0, 1\)'):
        MergeStrategy(spread_alike=1.0)
