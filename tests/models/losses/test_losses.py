import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from mmengine.registry import MODELS as ROOT
from scipy.special import rel_entr

from rm3d_plugin.models.losses import (
    class_weights,
    dice_loss,
    js_aug_loss,
    js_divergence,
    mse_aug_loss,
    offset_loss,
    point_cross_entropy,
    scene_class_loss,
)

LN2 = math.log(2.0)
rows = st.lists(st.floats(-30, 30, width=32), min_size=4, max_size=4)


@settings(derandomize=True, deadline=None, max_examples=50)
@given(rows, rows)
def test_js_is_scipys_symmetric_and_bounded(a, b):
    p, q = torch.tensor([a], dtype=torch.float64), torch.tensor([b], dtype=torch.float64)
    value = float(js_divergence(p, q)[0])
    first, second = p.softmax(1)[0].numpy(), q.softmax(1)[0].numpy()
    middle = (first + second) / 2
    want = float(rel_entr(first, middle).sum() + rel_entr(second, middle).sum()) / 2  # scipy's own root may warn
    assert 0.0 <= value <= LN2
    assert value == pytest.approx(want, abs=1e-9)
    assert value == pytest.approx(float(js_divergence(q, p)[0]), abs=1e-12)
    assert float(js_divergence(p, p + 3.0)[0]) == pytest.approx(0.0, abs=1e-12)


def test_js_at_one_hot_logits():
    p = torch.tensor([[1e4, 0.0], [0.0, 0.0]], requires_grad=True)
    q = torch.tensor([[0.0, 1e4], [1e4, 0.0]], requires_grad=True)
    each = js_divergence(p, q)
    assert float(each[0].detach()) == pytest.approx(LN2)
    js_aug_loss(p, q).backward()
    assert p.grad.isfinite().all() and q.grad.isfinite().all()
    assert p.grad[1].abs().sum() > 0


def test_js_gradient():
    p = torch.randn(3, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(0), requires_grad=True)
    q = torch.randn(3, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(1), requires_grad=True)
    assert torch.autograd.gradcheck(js_aug_loss, (p, q))


def test_mse_by_hand():
    assert float(mse_aug_loss(torch.tensor([[1e4, 0.0]]), torch.tensor([[0.0, 1e4]]))) == 1.0
    assert float(mse_aug_loss(torch.zeros(0, 2), torch.zeros(0, 2))) == 0.0


def test_dice_by_hand():
    p, g = torch.tensor([0.5, 0.5, 1.0]), torch.tensor([1.0, 0.0, 1.0])
    assert float(dice_loss(p, g)) == pytest.approx(1 - (2 * 1.5 + 1) / (2 + 2 + 1))
    assert float(dice_loss(p, g, torch.tensor([1.0, 0.0, 1.0]))) == pytest.approx(1 - 4 / (1.5 + 2 + 1))
    assert float(dice_loss(g, g)) == 0.0
    assert float(dice_loss(torch.zeros(3), torch.zeros(3))) == 0.0
    assert dice_loss(torch.stack([p, g]), torch.stack([g, g])).tolist() == pytest.approx([0.2, 0.0])


def test_scene_class_by_hand():
    logits, present = torch.tensor([[0.0, math.log(3.0)]]), torch.tensor([[1.0, 0.0]])
    assert float(scene_class_loss(logits, present)) == pytest.approx((LN2 + math.log(4.0)) / 2)
    assert float(scene_class_loss(torch.zeros(0, 2), torch.zeros(0, 2))) == 0.0


def test_offset_by_hand():
    target = torch.tensor([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    assert float(offset_loss(target, target)) == pytest.approx(-1.0)
    assert float(offset_loss(-target, target)) == pytest.approx((2 + 4) / 2 + 1.0)
    still = torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0005]])  # the second has no direction
    assert float(offset_loss(still, still)) == pytest.approx(-1.0)
    assert float(offset_loss(torch.zeros(0, 3), torch.zeros(0, 3))) == 0.0
    zero = torch.zeros(2, 3, requires_grad=True)
    offset_loss(zero, target).backward()
    assert zero.grad.isfinite().all()


def test_point_cross_entropy_by_hand():
    logits = torch.tensor([[math.log(3.0), 0.0], [0.0, 0.0], [0.0, math.log(3.0)]])
    labels = torch.tensor([0, -1, 0])
    low, high = math.log(4 / 3), math.log(4.0)
    assert float(point_cross_entropy(logits, labels)) == pytest.approx((low + high) / 2)
    assert float(point_cross_entropy(logits, labels, None, 0.5)) == pytest.approx((low + high + 0.5 * LN2) / 2.5)
    weights = torch.tensor([2.0, 1.0])
    got = float(point_cross_entropy(logits, torch.tensor([0, -1, 1]), weights))
    assert got == pytest.approx((2 * low + low) / 3)


def test_point_cross_entropy_without_labels_is_zero_with_gradient():
    logits = torch.randn(3, 2, generator=torch.Generator().manual_seed(0), requires_grad=True)
    loss = point_cross_entropy(logits, torch.tensor([-1, -1, -1]))
    loss.backward()
    assert float(loss.detach()) == 0.0
    assert logits.grad.abs().sum() == 0.0


def test_class_weights_by_hand():
    assert class_weights(torch.tensor([4, 1, 0]), 1.0).tolist() == pytest.approx([5 / 8, 5 / 2, 1.0])
    assert class_weights(torch.tensor([4, 1, 0]), 0.0).tolist() == [1.0, 1.0, 1.0]
    assert class_weights(torch.tensor([0, 0]), 1.0).tolist() == [1.0, 1.0]
    # 1 / sqrt(1), 1 / sqrt(4); mean over the five labels (1 * 1 + 4 * .5) / 5 = .6
    assert class_weights(torch.tensor([1.0, 4.0, 0.0]), 0.5).tolist() == pytest.approx([1 / 0.6, 0.5 / 0.6, 1.0])


@pytest.mark.parametrize('name', ['JSAugLoss', 'MSEAugLoss', 'DiceLoss', 'SceneClassLoss', 'OffsetLoss'])
def test_losses_are_reachable_from_another_project(name):
    loss = ROOT.build({'type': f'rm3d_plugin.{name}', 'loss_weight': 2.0})
    a, b = torch.rand(4, 3, generator=torch.Generator().manual_seed(0)), torch.ones(4, 3)
    half = ROOT.build({'type': f'rm3d_plugin.{name}'})
    assert float(loss(a, b)) == pytest.approx(2 * float(half(a, b)))
