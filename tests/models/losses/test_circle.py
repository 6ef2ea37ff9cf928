"""Circle loss against a loop over rows, balanced cross entropy by hand, overlap labels."""

import math

import pytest
import torch

from rm3d_plugin.models.losses import balanced_bce, circle_loss
from rm3d_plugin.models.losses.pair_circle import beside


def circle_slow(gaps, positive, negative, scale=24.0, pos=0.1, neg=1.4):
    """The formula, entry by entry, with weights that are numbers."""
    sides = []
    for d, p, n in ((gaps, positive, negative), (gaps.T, positive.T, negative.T)):
        rows = []
        for row in range(len(d)):
            near = [v for v, flag in zip(d[row], p[row], strict=True) if flag]
            far = [v for v, flag in zip(d[row], n[row], strict=True) if flag]
            if near and far:
                pull = sum(torch.exp(scale * max(v.item() - pos, 0) * (v - pos)) for v in near)
                push = sum(torch.exp(scale * max(neg - v.item(), 0) * (neg - v)) for v in far)
                rows.append(torch.log1p(pull * push) / scale)
        sides.append(sum(rows) / max(len(rows), 1))
    return (sides[0] + sides[1]) / 2


def example(seed=0):
    generator = torch.Generator().manual_seed(seed)
    gaps = 2 * torch.rand(6, 5, dtype=torch.float64, generator=generator)
    positive = torch.rand(6, 5, generator=generator) < 0.3
    negative = ~positive & (torch.rand(6, 5, generator=generator) < 0.7)
    positive[0], negative[1] = False, False  # a row without positives, one without negatives
    return gaps, positive, negative


@pytest.mark.parametrize('seed', range(4))
def test_circle_loss_and_its_gradient_equal_the_loop(seed):
    gaps, positive, negative = example(seed)
    results = []
    for loss in (circle_loss, circle_slow):
        own = gaps.clone().requires_grad_()
        value = loss(own, positive, negative)
        value.backward()
        results.append((value.item(), own.grad))
    assert results[0][0] == pytest.approx(results[1][0], rel=1e-9)
    torch.testing.assert_close(results[0][1], results[1][1])


def test_circle_loss_by_hand():
    gaps = torch.tensor([[0.5, 1.0]], dtype=torch.float64)
    positive, negative = torch.tensor([[True, False]]), torch.tensor([[False, True]])
    row = math.log1p(math.exp(24 * (0.4**2 + 0.4**2))) / 24  # columns have no row with both
    assert circle_loss(gaps, positive, negative).item() == pytest.approx(row / 2, rel=1e-9)


def test_nothing_to_compare_costs_nothing():
    gaps = torch.ones(3, 3, requires_grad=True)
    none = torch.zeros(3, 3, dtype=torch.bool)
    value = circle_loss(gaps, none, none)
    value.backward()
    assert value.item() == 0.0 and torch.equal(gaps.grad, torch.zeros(3, 3))


def test_balanced_cross_entropy_by_hand():
    logits = torch.tensor([2.0, -1.0, 0.0, 0.0], dtype=torch.float64, requires_grad=True)
    target = torch.tensor([True, False, False, False])
    costs = [0.75 * math.log1p(math.exp(-2)), 0.25 * math.log1p(math.exp(-1)), 0.25 * math.log(2), 0.25 * math.log(2)]
    assert balanced_bce(logits, target).item() == pytest.approx(sum(costs) / 4, rel=1e-9)
    assert torch.autograd.gradcheck(lambda x: balanced_bce(x, target), (logits,))
    assert balanced_bce(logits[:0], target[:0]).item() == 0.0


def test_what_lies_beside_a_chosen_point_of_its_scene():
    xyz = torch.tensor([[0.0, 0, 0], [1.0, 0, 0], [5.0, 0, 0], [0.0, 0, 0], [9.0, 0, 0]])
    chosen = torch.tensor([True, False, False, False, False])
    found = beside(xyz, torch.tensor([0, 3, 5]), chosen, 1.5)
    assert found.tolist() == [True, True, False, False, False]
