"""Labels with every click: the same as a walker that is solved anew."""

import numpy as np
import scipy.sparse
from reference.corner_scan import corner, few

from rm3d_plugin.pseudo_labels.propagation import prepare_cloud
from rm3d_plugin.pseudo_labels.propagation.harmonic import HarmonicSystem
from rm3d_plugin.pseudo_labels.propagation.labels import Labels
from rm3d_plugin.pseudo_labels.propagation.live import STRENGTH, LivePropagation, _Graph
from rm3d_plugin.pseudo_labels.propagation.rules import WalkerRules
from rm3d_plugin.pseudo_labels.propagation.solve import coarse_graphs
from rm3d_plugin.structures import PointCloud


def test_a_column_a_label_gives_what_the_walker_with_these_labels_gives():
    xyz, semantic = corner()
    scene = prepare_cloud(PointCloud(xyz))
    (coarse, *_), points = coarse_graphs(scene, np.zeros(0, np.int64), 1500), few(semantic, 3)
    likely = np.random.default_rng(0).dirichlet([1, 1], len(xyz))
    labels = Labels.of(scene, points, semantic[points], 2)
    said = _Graph(coarse).spread(likely, points, semantic[points], labels, WalkerRules(prior_half=1e9))
    nodes = coarse.coarse.node[points]
    prior = coarse.mean(likely)
    system = HarmonicSystem(coarse.coarse.weights, nodes, STRENGTH * coarse.usual_degree * coarse.coarse.sizes)
    expected = system.shares(np.eye(2)[semantic[points]], prior / prior.sum(axis=1, keepdims=True))
    assert len(np.unique(nodes)) == len(nodes)
    np.testing.assert_allclose(said, expected[coarse.coarse.node], atol=2e-4)


def test_what_is_said_depends_on_the_labels_alone_not_on_those_before():
    xyz, semantic = corner()
    live, points = LivePropagation(prepare_cloud(PointCloud(xyz))), few(semantic, 5)
    live.answer(points[:3], semantic[points[:3]], 3)
    again = live.answer(points, semantic[points], 3)
    fresh = LivePropagation(live.scene).answer(points, semantic[points], 3)
    np.testing.assert_allclose(again.shares, fresh.shares, atol=1e-5)
    np.testing.assert_allclose(again.shares.sum(axis=1), 1.0, atol=1e-5)
    assert (again.shares[:, 2] == 0).all() and (again.shares.argmax(axis=1) == semantic).mean() > 0.95
    assert again.apart.min() >= 0 and again.apart.max() <= 1
    nothing = live.answer(points[:0], semantic[:0], 3)
    assert not nothing.shares.any() and not nothing.apart.any()


def test_columns_of_clicks_that_were_taken_back_are_not_kept_for_ever(monkeypatch):
    monkeypatch.setattr('rm3d_plugin.pseudo_labels.propagation.live.KEPT', 4)
    xyz, semantic = corner()
    live, points = LivePropagation(prepare_cloud(PointCloud(xyz))), few(semantic, 8)
    for start in range(0, 16, 2):
        some = np.unique(np.r_[points[0], points[8], points[start : start + 2]])
        said = live.answer(some, semantic[some], 2)
    assert max(len(graph._columns) for graph in live._graphs) <= 4 + 4
    expected = LivePropagation(live.scene).answer(some, semantic[some], 2)
    np.testing.assert_allclose(said.shares, expected.shares, atol=1e-5)


def test_correlations_are_those_of_the_inverse():
    xyz, semantic = corner()
    scene = prepare_cloud(PointCloud(xyz))
    live, points = LivePropagation(scene), few(semantic, 4)
    total = np.zeros((8, 8))
    for graph in coarse_graphs(scene, np.zeros(0, np.int64), 6000):
        weights, sizes = graph.coarse.weights, graph.coarse.sizes
        laplacian = scipy.sparse.diags_array(np.asarray(weights.sum(axis=1)).ravel()) - weights
        screened = laplacian.toarray() + np.diag(STRENGTH * graph.usual_degree * sizes)
        nodes = graph.coarse.node[points]
        inverse = np.linalg.inv(screened)[np.ix_(nodes, nodes)]
        deviation = np.sqrt(np.diag(inverse))
        total += inverse / np.outer(deviation, deviation) / 2
    np.testing.assert_allclose(live.alike(points), total, atol=1e-6)
