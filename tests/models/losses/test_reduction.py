"""``reduction``, ``avg_factor`` and ``ignore_index`` as mmdetection's losses have them."""

import pytest
import torch
from torch.nn import functional as F

from rm3d_plugin.models.losses import PointCrossEntropyLoss, js_aug_loss, mse_aug_loss, offset_loss
from rm3d_plugin.registry import MODELS

GENERATOR = torch.Generator().manual_seed(0)


def rand(*shape):
    return torch.rand(*shape, generator=GENERATOR)


LOGITS, OTHER, LABELS = rand(6, 3), rand(6, 3), torch.tensor([0, 2, 1, -1, 0, 1])
CALLS = {
    'JSAugLoss': (LOGITS, OTHER),
    'MSEAugLoss': (LOGITS, OTHER),
    'DiceLoss': (rand(4, 9), (rand(4, 9) > 0.5).float()),
    'OffsetLoss': (rand(5, 3), rand(5, 3)),
    'PointCrossEntropyLoss': (LOGITS, LABELS),
    'SceneClassLoss': (rand(2, 3), (rand(2, 3) > 0.5).float()),
}


@pytest.mark.parametrize('kind', CALLS)
def test_a_mean_is_the_sum_over_its_factor(kind):
    each, total, mean = (MODELS.build(dict(type=kind, reduction=how)) for how in ('none', 'sum', 'mean'))
    args = CALLS[kind]
    rows = each(*args)
    assert rows.ndim >= 1 and total(*args).item() == pytest.approx(rows.sum().item())
    assert mean(*args, avg_factor=7.0).item() == pytest.approx(rows.sum().item() / 7)
    counted = (LABELS >= 0).sum() if kind == 'PointCrossEntropyLoss' else rows.numel()
    assert mean(*args).item() == pytest.approx((rows.sum() / counted).item())
    assert torch.equal(each(*args, avg_factor=7.0), rows)  # as in mmdetection
    double = MODELS.build(dict(type=kind, loss_weight=2.0))
    assert double(*args).item() == pytest.approx(2 * mean(*args).item())
    with pytest.raises(ValueError, match=r"avg_factor: expected None with reduction='sum'"):
        total(*args, avg_factor=7.0)


@pytest.mark.parametrize('kind', CALLS)
def test_other_reductions_are_refused(kind):
    with pytest.raises(ValueError, match=rf"{kind}.reduction: expected one of mean, sum, none, got 'median'"):
        MODELS.build(dict(type=kind, reduction='median'))


def test_ignored_labels_are_unlabelled():
    labels = torch.tensor([0, 2, 1, 3, 0, 1])  # 3 = num_classes, as mmdetection3d maps what has no class
    expected = F.cross_entropy(LOGITS, LABELS, ignore_index=-1)
    for loss, further in ((PointCrossEntropyLoss(ignore_index=3), {}), (PointCrossEntropyLoss(), dict(ignore_index=3))):
        assert torch.allclose(loss(LOGITS, labels, **further), expected)
    assert PointCrossEntropyLoss(ignore_index=0)(LOGITS[:1], labels[:1]).item() == 0


def test_cross_entropy_of_a_decode_head():
    """mmdetection3d calls ``loss_decode((B, C, N), (B, N), ignore_index=...)``."""
    logits, labels = rand(2, 3, 5), torch.tensor([[0, 1, 2, 3, 0], [1, 1, 3, 3, 2]])
    flat = logits.transpose(1, 2).reshape(-1, 3), labels.reshape(-1)
    loss = PointCrossEntropyLoss()
    assert torch.allclose(loss(logits, labels, ignore_index=3), loss(*flat, ignore_index=3))


@pytest.mark.parametrize('loss', ['JSAugLoss', 'MSEAugLoss'])
@pytest.mark.parametrize('shapes', [((2, 3, 5), (2, 3, 5)), ((5, 3), (4, 3)), ((5,), (5,))])
def test_views_are_compared_row_by_row(loss, shapes):
    with pytest.raises(ValueError, match=r'expected \(points, classes\) twice, got .*transpose\(1, 2\)'):
        MODELS.build(dict(type=loss))(*map(torch.zeros, shapes))


def test_the_functions_are_the_means():
    assert MODELS.build(dict(type='JSAugLoss'))(LOGITS, OTHER) == js_aug_loss(LOGITS, OTHER)
    assert MODELS.build(dict(type='MSEAugLoss'))(LOGITS, OTHER) == mse_aug_loss(LOGITS, OTHER)
    offsets, targets = CALLS['OffsetLoss']
    assert MODELS.build(dict(type='OffsetLoss'))(offsets, targets) == offset_loss(offsets, targets)
