from types import SimpleNamespace

import pytest
import torch

from rm3d_plugin.baselines.erda.loss import ERDALoss, erda_loss
from rm3d_plugin.models import Batch

BATCH = Batch(torch.zeros(3, 3), torch.tensor([0, 3]))


def test_it_is_entropy_and_divergence_together():
    similarity = torch.tensor([[0.2, -0.4, 0.9], [0.0, 0.0, 0.0]])
    logits = torch.tensor([[1.0, 0.0, -1.0], [0.3, 0.1, 2.0]])
    q, p = similarity.softmax(1), logits.softmax(1)
    entropy, divergence = -(q * q.log()).sum(1), (q * (q / p).log()).sum(1)
    assert erda_loss(similarity, logits).item() == pytest.approx((entropy + divergence).mean().item(), rel=1e-5)
    half = erda_loss(torch.zeros(1, 2), torch.tensor([[0.8, 0.2]]).log())
    assert half.item() == pytest.approx(-0.5 * (torch.tensor(0.8).log() + torch.tensor(0.2).log()).item(), rel=1e-5)
    assert erda_loss(torch.zeros(0, 2), torch.zeros(0, 2)).item() == 0.0


def test_the_gradient_reaches_pseudo_labels_and_prediction():
    similarity = torch.tensor([[0.2, -torch.inf, 0.9]], requires_grad=True)
    logits = torch.tensor([[1.0, 0.0, -1.0]], requires_grad=True)
    erda_loss(similarity, logits).backward()
    q = similarity.detach().softmax(1)
    cost = -logits.detach().log_softmax(1)
    wanted = q * (cost - (q * cost).sum())  # of a mean of costs by softmax weights
    assert torch.allclose(similarity.grad, wanted, atol=1e-6) and torch.isfinite(similarity.grad).all()
    assert torch.allclose(logits.grad, logits.detach().softmax(1) - q, atol=1e-6)


def test_labelled_points_move_prototypes_and_unlabelled_ones_learn():
    torch.manual_seed(0)
    term = ERDALoss(num_classes=3, channels=4, weight=0.5)
    features = torch.randn(3, 4, requires_grad=True)
    outputs = SimpleNamespace(features=features, logits=torch.randn(3, 3, requires_grad=True))
    labels = SimpleNamespace(semantic=torch.tensor([2, -1, 0]))
    value = term(BATCH, outputs, labels)['loss_erda']
    projected = term.project(features).detach()
    assert term.bank.present[:, 0].tolist() == [True, False, True]
    assert torch.allclose(term.bank.values[[2, 0], 0], projected[[0, 2]], atol=1e-6)
    cosine = torch.nn.functional.cosine_similarity(projected[1], projected[[2, 0]])  # classes 0 and 2
    q = cosine.softmax(0)
    wanted = -0.5 * (q * outputs.logits[1].log_softmax(0)[[0, 2]]).sum()
    assert value.item() == pytest.approx(wanted.item(), rel=1e-5)
    value.backward()
    assert features.grad[[0, 2]].abs().sum() == 0 and features.grad[1].abs().sum() > 0


def test_nothing_is_said_until_a_label_was_seen():
    outputs = SimpleNamespace(features=torch.randn(3, 4), logits=torch.randn(3, 3))
    assert ERDALoss(3, 4)(BATCH, outputs, SimpleNamespace(semantic=torch.tensor([-1, -1, -1]))) == {}
