import math
from types import SimpleNamespace

import pytest
import torch
import torch.nn.functional as F
from mmengine.logging import MessageHub

from rm3d_plugin.baselines.dgnet.losses import Mixture, fit_mixture, mixture_losses
from rm3d_plugin.baselines.dgnet.terms import DGNetLoss, TruncatedCrossEntropyLoss
from rm3d_plugin.models import Batch

ALL = torch.tensor([True, True])


def turned(*degrees):
    angle = torch.tensor(degrees) * math.pi / 180
    return torch.stack([angle.cos(), angle.sin()], dim=1)


def test_one_step_by_hand():
    features, start = turned(0.0, 30.0, 80.0), turned(0.0, 90.0)
    cosines = features @ start.T
    posterior = torch.stack([torch.exp(10 * row) / torch.exp(10 * row).sum() for row in cosines])
    found = fit_mixture(features, start, ALL, steps=1)
    wanted = F.normalize(torch.stack([(posterior[:, [k]] * features).sum(0) for k in range(2)]), dim=1)
    assert torch.allclose(found.means, wanted, atol=1e-5)
    assert torch.allclose(found.log_shares.exp(), posterior.mean(0), atol=1e-5)


def test_components_find_their_points():
    features = turned(*range(20, 31), *range(100, 131, 5))
    found = fit_mixture(features, turned(0.0, 90.0), ALL)
    assert torch.allclose(found.means, turned(25.0, 115.0), atol=0.01)
    assert found.log_shares.exp()[0].item() == pytest.approx(11 / 18, abs=0.01)


def test_an_absent_class_has_no_part():
    found = fit_mixture(turned(20.0, 100.0), turned(0.0, 90.0), torch.tensor([True, False]))
    assert torch.equal(found.log_posterior(turned(90.0), 10.0).exp(), torch.tensor([[1.0, 0.0]]))
    features = turned(20.0, 100.0).requires_grad_()
    losses = mixture_losses(features, torch.zeros(2, 2), found)
    assert losses.similarity.item() == 0.0 and losses.agreement.item() == pytest.approx(math.log(2))
    sum(losses).backward()
    assert torch.isfinite(features.grad).all()


def test_losses_by_hand():
    mixture = Mixture(turned(0.0, 90.0), torch.tensor([0.5, 0.5]).log())
    features, logits = turned(0.0, 45.0), torch.tensor([[0.9, 0.1], [0.2, 0.8]]).log()
    sure = math.exp(10) / (math.exp(10) + 1)
    posterior = [[sure, 1 - sure], [0.5, 0.5]]
    found = mixture_losses(features, logits, mixture)
    own = [-sum(p * math.log(p) for p in row) for row in posterior]
    assert found.likelihood.item() == pytest.approx(sum(own) / 2 / math.log(2), rel=1e-3)
    probs = [[0.9, 0.1], [0.2, 0.8]]
    cross = [-sum(q * math.log(p) for q, p in zip(*rows, strict=True)) for rows in zip(posterior, probs, strict=True)]
    assert found.agreement.item() == pytest.approx(sum(cross) / 2, rel=1e-3)
    means = F.normalize(torch.tensor(posterior).T @ features, dim=1)
    assert found.similarity.item() == pytest.approx((means[0] @ means[1]).item(), rel=1e-3)


def test_the_term_starts_from_labels_of_the_batch_else_of_those_before():
    term = DGNetLoss(num_classes=2, channels=2)
    batch = Batch(torch.zeros(2, 3), torch.tensor([0, 2]))
    outputs = SimpleNamespace(features=2 * turned(10.0, 95.0), logits=torch.zeros(2, 2))
    labels = SimpleNamespace(semantic=torch.tensor([-1, -1]))
    assert term(batch, outputs, labels) == {}
    labels.semantic = torch.tensor([0, -1])
    assert set(term(batch, outputs, labels)) == {'loss_vmf', 'loss_agreement', 'loss_means'}
    assert torch.allclose(term.bank.values[0, 0], turned(10.0)[0]) and not term.bank.present[1]
    labels.semantic = torch.tensor([-1, 1])
    start = term._start(F.normalize(outputs.features, dim=1), labels.semantic)
    assert torch.allclose(start, turned(10.0, 95.0), atol=1e-5)


def test_a_point_that_is_right_enough_teaches_nothing(monkeypatch):
    hub = MessageHub('test_dgnet')  # no run that another test left behind
    monkeypatch.setattr(MessageHub, 'get_current_instance', classmethod(lambda cls: hub))
    logits = torch.tensor([[0.5, 0.5], [0.9, 0.1]]).log().requires_grad_()
    classes = torch.tensor([0, 0])
    loss = TruncatedCrossEntropyLoss(start=0.0)(logits, classes, torch.tensor([2.0, 1.0]))
    assert loss.item() == pytest.approx((math.log(2) + math.log(1 / 0.8)) / 2)
    loss.backward()
    assert logits.grad[1].abs().sum() == 0 and logits.grad[0].abs().sum() > 0
    before = TruncatedCrossEntropyLoss(start=0.5)(logits, classes)
    assert before.item() == pytest.approx((math.log(2) + math.log(1 / 0.9)) / 2)
