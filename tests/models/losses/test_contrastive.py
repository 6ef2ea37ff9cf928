"""Contrastive losses against a loop over pairs."""

import math

import numpy as np
import pytest
import torch

from rm3d_plugin.models.losses import contrastive_loss

RNG = np.random.default_rng(1)


def unit(values):
    return values / np.linalg.norm(values, axis=1, keepdims=True)


def slow(anchors, positives, negatives, temperature, excluded):
    anchors, positives, negatives = map(unit, (anchors, positives, negatives))
    losses = []
    for i in range(len(anchors)):
        alike = math.exp(anchors[i] @ positives[i] / temperature)
        apart = sum(math.exp(anchors[i] @ n / temperature) for j, n in enumerate(negatives) if not excluded[i, j])
        losses.append(-math.log(alike / (alike + apart)))
    return losses


def drawn():
    anchors, positives = RNG.normal(size=(2, 5, 3))
    return anchors, positives, RNG.normal(size=(7, 3)), RNG.random((5, 7)) < 0.4


def tensors(*values):
    return [torch.tensor(value, dtype=torch.float32) for value in values]


@pytest.mark.parametrize('temperature', [0.1, 0.4])
def test_masked_contrastive_loss(temperature):
    anchors, positives, negatives, excluded = drawn()
    got = contrastive_loss(*tensors(anchors, positives, negatives), temperature, torch.tensor(excluded))
    np.testing.assert_allclose(got, slow(anchors, positives, negatives, temperature, excluded), rtol=1e-4, atol=1e-5)
    everyone = contrastive_loss(*tensors(anchors, positives, negatives), temperature)
    np.testing.assert_allclose(
        everyone, slow(anchors, positives, negatives, temperature, np.zeros_like(excluded)), rtol=1e-4, atol=1e-5
    )


def test_with_the_others_positives_it_is_cross_entropy_with_the_diagonal():
    anchors, positives = tensors(*drawn()[:2])
    logits = torch.nn.functional.normalize(anchors) @ torch.nn.functional.normalize(positives).T / 0.4
    expected = torch.nn.functional.cross_entropy(logits, torch.arange(5), reduction='none')
    got = contrastive_loss(anchors, positives, positives, 0.4, torch.eye(5, dtype=torch.bool))
    torch.testing.assert_close(got, expected)


def test_no_negatives_no_loss():
    anchors = torch.ones(2, 3, requires_grad=True)
    contrastive_loss(anchors, torch.ones(2, 3), torch.zeros(0, 3), 0.1).sum().backward()
    assert anchors.grad.abs().sum() == 0
    assert contrastive_loss(torch.ones(0, 3), torch.ones(0, 3), torch.ones(4, 3), 0.1).shape == (0,)
