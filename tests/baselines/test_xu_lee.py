from types import SimpleNamespace

import numpy as np
import pytest
import torch

from rm3d_plugin.baselines.xu_lee.graph import ColourGraph, colour_graph
from rm3d_plugin.baselines.xu_lee.losses import XuLeeLoss, inexact_loss, smoothness_loss
from rm3d_plugin.baselines.xu_lee.propagation import XuLeePropagation, confidence, laplacian, propagated
from rm3d_plugin.models import Batch


def slow_graph(points, rows, count):
    edges = {}
    for row in rows:
        distance = ((points - points[row]) ** 2).sum(axis=1)
        others = sorted((d, other) for other, d in enumerate(distance) if other != row)
        edges |= {(row, other): np.exp(-d / 0.1) for d, other in others[:count]}
    return edges


def test_the_graph_is_that_of_brute_force():
    points = np.random.default_rng(0).uniform(size=(40, 6))
    rows = np.array([3, 17, 38])
    graph = colour_graph(points, rows, neighbours=5)
    found = dict(zip(zip(graph.source.tolist(), graph.target.tolist(), strict=True), graph.weight, strict=True))
    wanted = slow_graph(points, rows.tolist(), 5)
    assert found.keys() == wanted.keys() and np.allclose(list(found.values()), [wanted[edge] for edge in found])


@pytest.mark.parametrize('count', [0, 1, 3])
def test_equal_and_few_points_have_no_edge_to_themselves(count):
    graph = colour_graph(np.zeros((count, 6)))
    assert len(graph.source) == count * max(count - 1, 0)
    assert (graph.source != graph.target).all() and np.allclose(graph.weight, 1.0)
    many = colour_graph(np.zeros((50, 3)), neighbours=4)
    assert len(many.source) == 200 and (many.source != many.target).all()


def test_the_largest_logit_of_a_class_is_compared_with_the_labels():
    logits = torch.tensor([[2.0, -1.0, 0.5], [0.0, 3.0, -2.0]])
    classes = torch.tensor([0, -1])
    soft = [float(np.log1p(np.exp(x))) for x in (-2.0, 3.0, 0.5)]  # -log sigmoid(2), -log(1 - sigmoid(3)), ...
    assert inexact_loss(logits, classes).item() == pytest.approx(sum(soft) / 3, rel=1e-5)
    assert inexact_loss(logits, classes, absent=False).item() == pytest.approx(soft[0], rel=1e-5)
    assert inexact_loss(logits, torch.tensor([-1, -1]), absent=False).item() == 0.0


def test_smoothness_by_hand():
    logits = torch.tensor([[0.8, 0.2], [0.6, 0.4], [0.1, 0.9]]).log()
    graph = ColourGraph(np.array([0, 1]), np.array([1, 2]), np.array([0.5, 0.25]))
    wanted = (0.5 * (0.2**2 + 0.2**2) + 0.25 * (0.5**2 + 0.5**2)) / 2
    assert smoothness_loss(logits, graph).item() == pytest.approx(wanted, rel=1e-5)
    nothing = ColourGraph(*(np.zeros(0, dtype=kind) for kind in (np.int64, np.int64, np.float64)))
    assert smoothness_loss(logits, nothing).item() == 0.0


def test_the_term_is_the_mean_over_scenes():
    generator = torch.Generator().manual_seed(0)
    points, logits = torch.rand(9, 6, generator=generator), torch.randn(9, 3, generator=generator)
    classes = torch.tensor([0, -1, -1, -1, 2, 1, -1, -1, -1])
    term = XuLeeLoss(num_points=100)
    batch = Batch(points, torch.tensor([0, 4, 4, 9]))
    got = term(batch, SimpleNamespace(logits=logits), SimpleNamespace(semantic=classes))
    parts = [slice(0, 4), slice(4, 9)]
    smooth = [smoothness_loss(logits[part], colour_graph(points[part].double().numpy())) for part in parts]
    inexact = [inexact_loss(logits[part], classes[part]) for part in parts]
    assert got['loss_smooth'].item() == pytest.approx(torch.stack(smooth).mean().item(), rel=1e-5)
    assert got['loss_inexact'].item() == pytest.approx(torch.stack(inexact).mean().item(), rel=1e-5)
    empty = Batch(points[:0], torch.tensor([0, 0]))
    assert term(empty, SimpleNamespace(logits=logits[:0]), SimpleNamespace(semantic=classes[:0])) == {}


def test_propagation_solves_the_system():
    rng = np.random.default_rng(1)
    points, probs = rng.uniform(size=(30, 6)), rng.dirichlet(np.ones(4), size=30)
    graph = colour_graph(points, neighbours=3)
    weights = np.zeros((30, 30))
    for source, target, weight in zip(*graph, strict=True):
        weights[source, target] = weights[target, source] = weight
    dense = np.diag(weights.sum(axis=1)) - weights
    assert np.allclose(laplacian(graph, 30).toarray(), dense)
    trust = np.diag(confidence(probs))
    solved = 3.0 * np.linalg.solve(2.0 * dense + 3.0 * trust + 1e-5 * np.eye(30), trust @ probs)
    wanted = solved / solved.sum(axis=1, keepdims=True)
    assert np.allclose(propagated(probs, graph, alpha=2.0, beta=3.0), wanted, atol=1e-4)


def test_a_point_that_knows_nothing_takes_what_its_neighbours_know():
    probs = torch.tensor([[0.99, 0.01], [0.5, 0.5], [0.99, 0.01]])
    points = torch.tensor([[0.0] * 6, [0.01] * 6, [0.02] * 6])
    found = XuLeePropagation()(points, probs)
    assert found[1, 0] > 0.95 and torch.allclose(found.sum(dim=1), torch.ones(3)) and found.dtype == probs.dtype
    assert torch.equal(XuLeePropagation()(points[:0], probs[:0]), probs[:0])
    alone = XuLeePropagation()(points[:1], probs[:1])
    assert torch.allclose(alone, probs[:1], atol=1e-4)
