import math

import pytest
import torch
from mmengine.logging import MessageHub

from rm3d_plugin.baselines.aadnet.loss import EntropyWeightedLoss, entropy, smoothed

LOG2 = math.log(2.0)


@pytest.fixture
def epoch(monkeypatch):
    """Says how many of 100 epochs are done."""
    hub = MessageHub('test_aadnet')
    monkeypatch.setattr(MessageHub, 'get_current_instance', classmethod(lambda cls: hub))
    hub.update_info('max_epochs', 100)
    return lambda number: hub.update_info('epoch', number)


def test_entropy_and_smoothing_by_hand():
    logits = torch.tensor([[0.5, 0.5], [0.25, 0.75]]).log()
    wanted = [LOG2, 0.25 * math.log(4) + 0.75 * math.log(4 / 3)]
    assert entropy(logits).tolist() == pytest.approx(wanted)
    classes = torch.tensor([0, 1])
    plain = torch.nn.functional.cross_entropy(logits, classes, reduction='none')
    torchs = torch.nn.functional.cross_entropy(logits, classes, reduction='none', label_smoothing=0.2)
    assert torch.allclose(smoothed(plain, logits, 0.2), torchs)


def test_sure_points_weigh_little(epoch):
    epoch(0)
    logits = torch.tensor([[0.5, 0.5], [0.25, 0.75], [0.9, 0.1]]).log().requires_grad_()
    loss = EntropyWeightedLoss(smoothing=0.0)(logits, torch.tensor([0, 1, -1]), torch.tensor([1.0, 3.0]))
    second = 0.25 * math.log(4) + 0.75 * math.log(4 / 3)
    assert loss.item() == pytest.approx((LOG2 * LOG2 + 3 * second * math.log(4 / 3)) / 4)
    loss.backward()
    assert torch.allclose(logits.grad[0], LOG2 / 4 * torch.tensor([-0.5, 0.5]), atol=1e-6)  # that of the factor is none
    assert logits.grad[2].abs().sum() == 0


def test_spans_alternate_in_the_second_half(epoch):
    loss, sums = EntropyWeightedLoss(), []
    for number in range(100):
        epoch(number)
        sums.append(loss.adds_entropy())
    assert not any(sums[:50]) and sums[50:70] == [True] * 5 + [False] * 5 + [True] * 5 + [False] * 5
    epoch(50)
    logits = torch.tensor([[0.5, 0.5]]).log()
    assert loss(logits, torch.tensor([0])).item() == pytest.approx(LOG2 + 0.01 * LOG2)


def test_no_label_is_no_loss(epoch):
    epoch(0)
    assert EntropyWeightedLoss()(torch.zeros(2, 3), torch.tensor([-1, -1])).item() == 0.0
