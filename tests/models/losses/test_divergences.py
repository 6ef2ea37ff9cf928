"""Divergences against their formulas in plain numpy, with each repository's convention."""

import numpy as np
import pytest
import torch
from scipy.special import kl_div, softmax

from rm3d_plugin.models.losses import CONVENTIONS, DivergenceLoss, ViewConsistency, divergence, soft_cross_entropy

RNG = np.random.default_rng(0)
ONE, OTHER = RNG.normal(0, 2, (2, 6, 4))
P, Q = softmax(ONE, axis=1), softmax(OTHER, axis=1)
M = (P + Q) / 2
E4, E5 = 1e-4, 1e-5

BY_HAND = {
    'rm3d': 0.5 * (P * np.log(P / M) + Q * np.log(Q / M)).sum(1),
    'psd': (P * np.log((P + E4) / (M + E4)) + Q * np.log((Q + E4) / (M + E4))).mean(1),
    'cpcm': (P * np.log((P + E4) / (M + E4)) + Q * np.log((Q + E4) / (M + E4))).sum(1),
    'rac_net': (P * np.log(P / Q)).sum(1),
    'lidal': kl_div(P + E5, Q + E5).sum(1),
    'xu_lee': ((P - Q) ** 2).sum(1),
}


def rows(values):
    return torch.tensor(values, dtype=torch.float32)


@pytest.mark.parametrize('name', CONVENTIONS)
def test_convention(name):
    got = divergence(rows(ONE), rows(OTHER), CONVENTIONS[name])
    np.testing.assert_allclose(got, BY_HAND[name], rtol=2e-5, atol=1e-7)
    weighted = DivergenceLoss(name, loss_weight=10.0)(rows(ONE), rows(OTHER))
    assert weighted.item() == pytest.approx(10 * BY_HAND[name].mean(), rel=1e-5)


@pytest.mark.parametrize('name', CONVENTIONS)
def test_one_hot_predictions_have_finite_values_and_gradients(name):
    logits = torch.tensor([[500.0, 0.0], [0.0, 500.0]], requires_grad=True)
    value = divergence(logits, torch.tensor([[0.0, 500.0], [0.0, 500.0]]), CONVENTIONS[name])
    value.sum().backward()
    assert torch.isfinite(value).all() and torch.isfinite(logits.grad).all()
    assert value[1].item() == pytest.approx(0.0, abs=1e-6) and value[0] > 0.3


def test_soft_cross_entropy_is_entropy_and_divergence():
    got = soft_cross_entropy(rows(ONE), rows(Q))
    np.testing.assert_allclose(got, -(Q * np.log(P)).sum(1), rtol=1e-5)


def test_choices_are_told():
    with pytest.raises(ValueError, match="expected one of rm3d, psd, .*got 'kl2'"):
        DivergenceLoss('kl2')
    with pytest.raises(ValueError, match='logits of two views'):
        divergence(torch.zeros(2, 3), torch.zeros(2, 4), CONVENTIONS['psd'])
    assert isinstance(ViewConsistency(dict(type='DivergenceLoss', convention='psd')).loss, DivergenceLoss)
