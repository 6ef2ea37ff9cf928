from types import SimpleNamespace

import pytest
import torch

from rm3d_plugin.models import Batch
from rm3d_plugin.models.heads import PointLabels, SemanticHead
from rm3d_plugin.models.losses import WeakSupervision

NO_BATCH = Batch(torch.zeros(0, 3), torch.tensor([0, 0]))


def labels_of(semantic, is_annotated=None, counts=None):
    classes = torch.tensor(semantic)
    annotated = torch.tensor(is_annotated or [True] * len(semantic)) & (classes >= 0)
    nothing = torch.full_like(classes, -1)
    return PointLabels(classes, nothing, nothing[:0], annotated, counts)


def loss_of(term, logits, labels):
    return term(NO_BATCH, SimpleNamespace(features=logits, logits=logits), labels)['loss_wsl']


def test_losses_by_hand():
    logits = torch.log(torch.tensor([[0.5, 0.25, 0.25], [0.25, 0.5, 0.25], [0.2, 0.2, 0.6]]))
    labels = labels_of([0, 2, -1])
    log2, log4 = 0.6931472, 1.3862944
    assert loss_of(WeakSupervision(), logits, labels).item() == pytest.approx((log2 + log4) / 2)
    doubled = loss_of(WeakSupervision(loss={'loss_weight': 2.0}), logits, labels)
    assert doubled.item() == pytest.approx(log2 + log4)
    counted = WeakSupervision(balance='frequency')  # 1/4, 1/2, 1: the scale cancels
    told = labels_of([0, 2, -1], counts=torch.tensor([16.0, 4, 1]))
    assert loss_of(counted, logits, told).item() == pytest.approx((log2 / 4 + log4) / (1 / 4 + 1))
    batch = WeakSupervision(balance='batch', power=1.0)
    three = torch.cat([logits[:1], logits[:1], logits[1:2]])
    assert loss_of(batch, three, labels_of([0, 0, 2])).item() == pytest.approx((log2 + log4) / 2)


def test_pseudo_labels_may_count_less():
    logits = torch.log(torch.tensor([[0.5, 0.5], [0.25, 0.75]]))
    labels = labels_of([0, 0], [True, False])
    got = loss_of(WeakSupervision(pseudo_weight=0.5), logits, labels).item()
    assert got == pytest.approx((0.6931472 + 0.5 * 1.3862944) / 1.5)


def test_annotated_labels_have_their_share_however_few_they_are():
    logits = torch.log(torch.tensor([[0.5, 0.5], [0.25, 0.75], [0.25, 0.75], [0.125, 0.875], [0.9, 0.1]]))
    log2 = 0.6931472
    term = WeakSupervision(annotated_share=0.6)
    mixed = loss_of(term, logits, labels_of([0, 0, 0, 0, -1], [True, False, False, False, False])).item()
    assert mixed == pytest.approx(0.6 * log2 + 0.4 * (2 + 2 + 3) / 3 * log2)
    true = loss_of(term, logits, labels_of([0, 0, -1, -1, -1], [True] * 5)).item()
    assert true == pytest.approx(1.5 * log2)
    pseudo = loss_of(term, logits, labels_of([-1, 0, -1, 0, -1], [False] * 5)).item()
    assert pseudo == pytest.approx(2.5 * log2)
    balanced = WeakSupervision(annotated_share=0.5, balance='batch', power=1.0)
    labels = labels_of([0, 0, 0, 1, -1], [True, False, False, False, False])  # classes count alike within each part
    wanted = 0.5 * log2 + 0.5 * (2 * log2 - torch.log(torch.tensor(0.875)).item()) / 2
    assert loss_of(balanced, logits, labels).item() == pytest.approx(wanted)


@pytest.mark.parametrize('share', [None, 0.5])
@pytest.mark.parametrize('balance', ['none', 'frequency', 'batch'])
def test_no_labelled_point_is_a_zero_loss_with_gradients(balance, share):
    head, term = SemanticHead(4, 3), WeakSupervision(balance=balance, annotated_share=share)
    loss = loss_of(term, head(torch.ones(5, 4)), labels_of([-1] * 5, counts=torch.zeros(3)))
    loss.backward()
    assert loss.item() == 0.0
    assert head.linear.weight.grad.abs().sum() == 0 and head.linear.bias.grad is not None


def test_an_unlabelled_point_has_no_gradient():
    logits = torch.randn(4, 3, requires_grad=True, generator=torch.Generator().manual_seed(0))
    loss_of(WeakSupervision(), logits, labels_of([0, -1, 2, -1])).backward()
    assert logits.grad[[1, 3]].abs().sum() == 0 and (logits.grad[[0, 2]].abs().sum(1) > 0).all()


def test_bad_choices_are_told():
    with pytest.raises(ValueError, match='pseudo_weight'):
        WeakSupervision(pseudo_weight=-1.0)
    with pytest.raises(ValueError, match='annotated_share: expected a share'):
        WeakSupervision(annotated_share=1.0)
    with pytest.raises((ValueError, TypeError), match='balance'):
        WeakSupervision(balance='often')


def test_it_asks_for_what_its_settings_read():
    assert set(WeakSupervision().needs) == {'logits', 'semantic'}
    assert set(WeakSupervision(balance='frequency').needs) == {'logits', 'semantic', 'class_counts'}
    assert set(WeakSupervision(annotated_share=0.5).needs) == {'logits', 'semantic', 'is_annotated'}


def test_unsure_labels_teach_less():
    logits = torch.tensor([[2.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    labels = labels_of([0, 2])._replace(confidence=torch.tensor([1.0, 0.25]))
    each = torch.nn.functional.cross_entropy(logits, torch.tensor([0, 2]), reduction='none')
    for power, weights in ((0.0, [1.0, 1.0]), (1.0, [1.0, 0.25]), (2.0, [1.0, 0.0625])):
        term = WeakSupervision(confidence_power=power)
        found = loss_of(term, logits, labels)
        expected = (each * torch.tensor(weights)).sum() / sum(weights)
        assert float(found) == pytest.approx(float(expected), rel=1e-6)
