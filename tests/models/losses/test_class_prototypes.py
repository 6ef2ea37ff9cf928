"""Prototypes of classes, by hand."""

import math

import pytest
import torch

from rm3d_plugin.models.losses import ClassPrototypes, even_assignment, prototype_loss


def test_points_are_shared_out_evenly():
    similarity = torch.tensor([[0.9, 0.8], [0.9, 0.7], [0.9, 0.6], [0.9, 0.5]])  # all prefer the first
    got = even_assignment(similarity, steps=50)
    torch.testing.assert_close(got.sum(dim=1), torch.ones(4))
    torch.testing.assert_close(got.sum(dim=0), torch.tensor([2.0, 2.0]), atol=1e-3, rtol=0)
    assert got.argmax(dim=1).tolist() == [1, 1, 0, 0]  # those that lose least go to the second
    assert even_assignment(torch.zeros(0, 3)).shape == (0, 3)


def test_loss_by_hand():
    prototypes = torch.tensor([[1.0, 0.0], [0.0, 2.0]])
    got = prototype_loss(torch.tensor([[3.0, 0.0]]), torch.tensor([0]), prototypes, temperature=1.0)
    assert got.item() == pytest.approx(math.log(1 + math.exp(-1)), rel=1e-6)
    assert prototype_loss(torch.zeros(0, 2), torch.zeros(0).long(), prototypes).item() == 0.0


def test_prototypes_move_to_their_class_and_the_loss_falls():
    torch.manual_seed(0)
    term = ClassPrototypes(2, 3, each=2, momentum=0.5, loss_weight=1.0)
    features = torch.cat([torch.tensor([[1.0, 0, 0]]).repeat(9, 1), torch.tensor([[0, 1.0, 0]]).repeat(9, 1)])
    features = features + 0.05 * torch.randn(18, 3)
    kinds = torch.arange(2).repeat_interleave(9)
    losses = [term.learn(features, kinds).item() for _ in range(8)]
    assert losses[-1] < 0.5 * losses[0]
    torch.testing.assert_close(term.prototypes.norm(dim=1), torch.ones(4))
    assert bool((term.prototypes[:2, 0] > 0.9).all()) and bool((term.prototypes[2:, 1] > 0.9).all())
    before = term.prototypes.clone()
    assert term.learn(features, torch.full((18,), -1)).item() == 0.0  # background has no prototype
    assert torch.equal(before, term.prototypes)
