"""Classes of sites, by hand: each data set's own block, rare classes weigh more, what is unknown says nothing."""

import math
from types import SimpleNamespace

import pytest
import torch

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.losses import SiteClasses
from rm3d_plugin.models.losses.site_classes import SCALE

BATCH = Batch(torch.zeros(0, 3), torch.tensor([0]))  # it is not read


def term(power=0.0, smoothing=0.0):
    """Two values a site; the third and fourth class are of another data set."""
    found = SiteClasses(2, [2, 2], power, smoothing)
    with torch.no_grad():
        found.layer.weight.copy_(torch.tensor([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.0, 0.0]]) / SCALE)
        found.layer.bias.zero_()
    return found


def said(features, classes, **settings):
    rows = torch.tensor(features, requires_grad=True)
    values = term(**settings)(BATCH, SimpleNamespace(features=rows), SimpleNamespace(classes=torch.tensor(classes)))
    return values, rows


def test_each_site_is_compared_with_the_classes_of_its_own_data_set():
    values, _ = said([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]], [0, 0, 3])
    one, other = math.log(1 + math.exp(-1)), math.log(1 + math.exp(1))
    assert values['loss_classes'].item() == pytest.approx((one + other + other) / 3, rel=1e-6)
    assert values['right'].item() == pytest.approx(1 / 3)


def test_rare_classes_weigh_more_within_their_block():
    values, _ = said([[1.0, 0.0]] * 4 + [[0.0, 1.0]], [0, 0, 0, 0, 0], power=1.0)
    plain, _ = said([[1.0, 0.0]] * 4 + [[0.0, 1.0]], [0, 0, 0, 0, 0])
    assert values['loss_classes'].item() == pytest.approx(plain['loss_classes'].item(), rel=1e-6), 'one class alone'
    values, _ = said([[1.0, 0.0]] * 4, [0, 0, 0, 1], power=1.0)
    one, other = math.log(1 + math.exp(-1)), math.log(1 + math.exp(1))
    assert values['loss_classes'].item() == pytest.approx((one + other) / 2, rel=1e-6)  # each class as much in all


def test_smoothing_spreads_a_share_over_the_block():
    values, _ = said([[1.0, 0.0]], [0], smoothing=0.5)
    one, other = math.log(1 + math.exp(-1)), math.log(1 + math.exp(1))
    assert values['loss_classes'].item() == pytest.approx(0.75 * one + 0.25 * other, rel=1e-6)


def test_a_class_of_no_block_is_refused():
    with pytest.raises(ValueError, match='got class 4, expected fewer than the 4'):
        said([[1.0, 0.0]], [4])


def test_sites_of_unknown_class_teach_nothing():
    values, rows = said([[1.0, 0.0], [0.3, 0.4]], [-1, -1])
    values['loss_classes'].backward()
    assert values['loss_classes'].item() == 0 and values['right'].item() == 0 and not rows.grad.any()
