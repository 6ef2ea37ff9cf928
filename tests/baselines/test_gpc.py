"""Guided point contrast against a loop over anchors and negatives."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from rm3d_plugin.baselines.gpc.loss import GuidedContrast, Side, balanced_rows, guided_loss, side_of
from rm3d_plugin.models import Batch, View
from rm3d_plugin.models.consistency import BankRows


def test_labels_take_the_place_of_pseudo_labels():
    logits = torch.log(torch.tensor([[0.8, 0.2], [0.8, 0.2], [0.4, 0.6]]))
    side = side_of(torch.zeros(3, 2), logits, torch.tensor([-1, 1, -1]))
    assert side.classes.tolist() == [0, 1, 1]
    np.testing.assert_allclose(side.confidence, [0.8, 1.0, 0.6], rtol=1e-6)


def test_each_class_is_as_likely():
    torch.manual_seed(0)
    classes = torch.tensor([0] * 990 + [1] * 10)
    drawn = torch.cat([classes[balanced_rows(classes, 4)] for _ in range(300)])
    assert 0.4 < drawn.float().mean() < 0.6
    assert sorted(balanced_rows(torch.tensor([0, 0, 1]), 9).tolist()) == [0, 1, 2]
    assert balanced_rows(torch.zeros(0, dtype=torch.int64), 4).tolist() == []


def test_one_direction():
    rng = np.random.default_rng(0)
    anchors, others = rng.normal(size=(2, 4, 3))
    negatives, classes = rng.normal(size=(5, 3)), np.array([0, 1, 2, 1, 0])
    own, sure = np.array([0, 1, 2, 2]), np.array([0.9, 0.75, 0.74, 1.0])

    def cosine(a, b):
        return a @ b / np.linalg.norm(a) / np.linalg.norm(b)

    losses = []
    for i in range(4):
        if sure[i] < 0.75:
            continue
        alike = math.exp(cosine(anchors[i], others[i]) / 0.1)
        apart = sum(
            math.exp(cosine(anchors[i], n) / 0.1) for n, c in zip(negatives, classes, strict=True) if c != own[i]
        )
        losses.append(-math.log(alike / (alike + apart)))
    first, second, bank = (
        torch.tensor(v, dtype=torch.float32, requires_grad=True) for v in (anchors, others, negatives)
    )
    got = guided_loss(
        Side(first, torch.tensor(own), torch.zeros(4)),
        Side(second, torch.tensor(own), torch.tensor(sure)),
        BankRows(bank.detach(), torch.tensor(classes)),
        0.1,
        0.75,
    )
    assert got.item() == pytest.approx(np.mean(losses), rel=1e-4)
    got.backward()
    assert second.grad is None and first.grad.abs().sum() > 0


def test_the_term_learns_from_the_bank_and_fills_it():
    torch.manual_seed(0)
    features, logits = torch.randn(6, 4, requires_grad=True), 9 * torch.eye(6, 3)
    ids = torch.tensor([4, 1, -1, 0])
    seen = torch.randn(4, 4)
    view = View(
        torch.zeros(4, 3), torch.tensor([0, 4]), ids, lambda points, offsets: seen, lambda rows: 9 * rows[:, :3]
    )
    batch = Batch(torch.zeros(6, 3), torch.tensor([0, 6]), (view,))
    outputs = SimpleNamespace(features=features, logits=logits)
    labels = SimpleNamespace(semantic=torch.tensor([-1, -1, -1, -1, 2, -1]))
    term = GuidedContrast(4, 3, bank=8, threshold=0.0)
    first = term(batch, outputs, labels)['loss_guided']
    assert first.item() == pytest.approx(0, abs=1e-6)  # no negatives yet
    assert term.bank.counts.sum() == 6 and term.bank.counts[2] >= 2  # the labelled point, as both views have it
    second = term(batch, outputs, labels)['loss_guided']
    second.backward()
    assert second > 0 and features.grad[[0, 1, 4]].abs().sum() > 0 and features.grad[[2, 3, 5]].abs().sum() == 0
    assert term(batch._replace(views=()), outputs, labels) == {}
    assert {'bank.values', 'bank.counts', 'project.weight', 'project.bias'} == set(term.state_dict())
