"""Graph-structured contrast on graphs small enough to do by hand."""

import math

import numpy as np
import pytest
import torch

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.descriptors.descriptor_network import DescriptorOutput, SiteLabels
from rm3d_plugin.models.losses.graph_contrast import GraphContrast, border_weights, graph_contrast_loss
from rm3d_plugin.ops.nearest_within import nearest_within, neighbor_pairs


def test_weights_of_borders_by_hand():
    # objects: 0 has three points, 1 has two, 2 has one; two edges join 0 and 1, one joins 1 and 2
    objects = torch.tensor([0, 0, 0, 1, 1, 2])
    edges = torch.tensor([[0, 1], [1, 3], [4, 2], [4, 5], [0, 5]])
    assert border_weights(objects, edges, 10.0).tolist() == [0, 11, 11, 11, 11]
    assert border_weights(objects, edges, 3.0).tolist() == [0, 4, 4, 4, 4]
    assert border_weights(objects, edges[:2], 10.0).tolist() == [0, 21]  # a single edge: 1 + 10 * 2 / 1


def test_loss_of_a_path_by_hand():
    rows = torch.tensor([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0], [0.6, 0.8]], dtype=torch.float64)
    objects = torch.tensor([0, 0, 1, -1])
    edges = torch.tensor([[0, 1], [1, 2], [2, 3]])
    pull = 0.2 * (math.sqrt(1 + 2 / 0.04) - 1)  # d^2 = 2
    push = (1 + 7.0 * 1 / 1) * 1  # d = 0; the smaller object has one point
    loss = graph_contrast_loss(rows, objects, edges, strength=7.0)
    assert loss.item() == pytest.approx((pull + push) / 2, abs=2e-5)  # the third edge has no object at one end
    far = torch.tensor([[1.0, 0.0], [-1.0, 0.0]], dtype=torch.float64)
    assert graph_contrast_loss(far, torch.tensor([0, 1]), torch.tensor([[0, 1]])).item() == 0  # d = 2: far enough


def test_nothing_to_learn_from_is_zero_with_a_gradient():
    rows = torch.zeros(3, 2, requires_grad=True)
    loss = graph_contrast_loss(rows, torch.full((3,), -1), torch.tensor([[0, 1]]))
    loss.backward()
    assert loss.item() == 0 and rows.grad is not None


def test_gradients():
    torch.manual_seed(0)
    rows = torch.nn.functional.normalize(torch.randn(6, 4, dtype=torch.float64), dim=1).requires_grad_()
    edges = torch.tensor([[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [0, 5]])
    objects = torch.tensor([0, 0, 0, 1, 1, 2])
    assert torch.autograd.gradcheck(lambda x: graph_contrast_loss(x, objects, edges, strength=2.0), (rows,))


def test_equal_embeddings_across_a_border_have_a_finite_gradient():
    rows = torch.ones(2, 3, requires_grad=True)
    graph_contrast_loss(rows, torch.tensor([0, 1]), torch.tensor([[0, 1]])).backward()
    assert torch.isfinite(rows.grad).all()


def test_the_term_joins_neighbours_of_each_scene():
    xyz = torch.tensor([[0.0, 0, 0], [1, 0, 0], [5, 0, 0], [0, 0, 0], [1, 0, 0]])
    offsets = torch.tensor([0, 3, 5])
    edges = neighbor_pairs(xyz, offsets, 1)
    assert edges.tolist() == [[0, 1], [1, 2], [3, 4]]
    term = GraphContrast(neighbors=1, loss_weight=2.0)
    assert term.border_strength == 10
    rows = torch.nn.functional.normalize(torch.randn(5, 4), dim=1)
    objects = torch.tensor([0, 0, 1, 2, 2])
    found = term(Batch(xyz, offsets), DescriptorOutput(rows), SiteLabels(objects, objects))
    expected = 2 * graph_contrast_loss(rows, objects, edges, 0.2, 10.0)
    torch.testing.assert_close(found, {'loss_graph': expected})


def test_neighbours_within_a_radius():
    xyz = np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0], [9, 0, 0]])
    assert nearest_within(xyz, 2.5, 3).tolist() == [[0, 1, 0], [1, 0, 2], [2, 1, 2], [3, 3, 3]]
    assert nearest_within(xyz, 4.0, 2).tolist() == [[0, 1], [1, 0], [2, 1], [3, 3]]
