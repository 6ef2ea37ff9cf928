"""Labelled regions that one alike vote for the class of a region."""

import numpy as np
import pytest
from pseudo_labels.region_graphs import make_graph, plain_examples

from rm3d_plugin.pseudo_labels.region_prior.features import (
    BANDWIDTH,
    DOUBT,
    NEIGHBORS,
    collect_examples,
    knn_class_prior,
    prior_features,
)
from rm3d_plugin.structures import PointCloud, Regions


def test_votes_by_hand():
    examples = plain_examples([[0.0], [0.0], [3.0]], [1, 1, 0])
    got = knn_class_prior(np.array([[0.0], [np.sqrt(BANDWIDTH)], [3.0], [50.0]]), examples, 2)
    near = (2 + DOUBT) / (2 + 2 * DOUBT)
    far = (2 / np.e + DOUBT) / (2 / np.e + 2 * DOUBT)
    one = (1 + DOUBT) / (1 + 2 * DOUBT)
    assert got[:, 1] == pytest.approx([near, far, 1 - one, 0.5], abs=1e-6)
    assert got.sum(axis=1) == pytest.approx(1.0)


@pytest.mark.parametrize('seed', range(3))
def test_votes_as_a_slow_twin(seed):
    rng = np.random.default_rng(seed)
    examples, features = plain_examples(rng.random((40, 3)), rng.integers(0, 4, 40)), rng.random((25, 3))
    got = knn_class_prior(features, examples, 4)
    for row, one in zip(got, features, strict=True):
        order = sorted(range(40), key=lambda j: (np.square(one - examples.features[j]).sum(), j))[:NEIGHBORS]
        votes = [DOUBT] * 4
        for j in order:
            votes[examples.classes[j]] += np.exp(-np.square(one - examples.features[j]).sum() / BANDWIDTH)
        assert row == pytest.approx(np.array(votes) / sum(votes))


def test_features_by_hand():
    xyz = np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, 3]])
    graph = make_graph(
        2,
        normals=np.array([[0.0, 0, -1], [0.6, 0, 0.8]]),
        curvatures=np.array([0.1, 0.2]),
        descriptors=np.array([[5.0, 6.0], [7.0, 8.0]]),
        extents=np.array([[1.0, 0, 0], [2.0, 0.5, 0.1]]),
        sizes=np.array([2, 2]),
    )
    features = prior_features(PointCloud(xyz), Regions(np.array([0, 0, 1, 1])), graph)
    log = np.log(np.array([[1.05, 0.05, 0.05], [2.05, 0.55, 0.15]]))
    assert features[0].tolist() == pytest.approx([1.0, 0.1, *log[0], 0.0, 0.0, 5.0, 6.0], abs=1e-9)
    assert features[1].tolist() == pytest.approx([0.8, 0.2, *log[1], 1.0, 3.0, 7.0, 8.0], abs=1e-9)
    moved = prior_features(PointCloud(xyz + [10.0, -5.0, 7.0]), Regions(np.array([0, 0, 1, 1])), graph)
    assert moved == pytest.approx(features)
    nothing = prior_features(PointCloud(np.zeros((0, 3))), Regions(np.zeros(0, dtype=np.int64)), make_graph(0))
    assert nothing.shape == (0, 7 + 2)


def test_examples_are_scaled_over_all_large_regions():
    rng = np.random.default_rng(0)
    features = [rng.normal(3.0, [2.0] * 7 + [1.0] * 4 + [0.0], (400, 12)) for _ in range(2)]
    classes = [np.where(np.arange(400) < 5, 2, -1), np.full(400, -1)]
    sizes = [np.where(np.arange(400) == 4, 3, 100), np.full(400, 100)]
    found = collect_examples(zip(features, classes, sizes, strict=True))
    assert found.classes.tolist() == [2, 2, 2, 2]  # the fifth is too small
    large = np.concatenate([np.delete(features[0], 4, axis=0), features[1]])
    assert found.middle == pytest.approx(large.mean(axis=0))
    shape = (features[0][:4, :7] - large[:, :7].mean(axis=0)) / large[:, :7].std(axis=0)
    assert found.features[:, :7] == pytest.approx(shape / np.sqrt(7))
    spread = (large - found.middle) * found.scale
    assert spread[:, :7].var(axis=0).sum() == pytest.approx(1.0)  # shape and height together
    assert spread[:, 7:].var(axis=0).sum() == pytest.approx(0.5 * 4 / 5)  # descriptors; the constant one tells nothing
    assert collect_examples([(features[1], classes[1], sizes[1])]) is None
    assert collect_examples([]) is None
