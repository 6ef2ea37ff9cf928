from types import SimpleNamespace

import numpy as np
import pytest
import torch
from scipy.spatial.distance import jensenshannon

from rm3d_plugin.models import Batch, View
from rm3d_plugin.models.losses import ViewConsistency


def view_of(features, point_ids, asked):
    """A view whose features are given; notes each time that the network is asked."""

    def encode(points, batch_offsets):
        asked.append(len(points))
        return features

    points = torch.zeros(len(features), 3)
    return View(points, torch.tensor([0, len(features)]), point_ids, encode, classify=lambda rows: 2 * rows)


def made(sizes=(5, 3), seed=0):
    generator = torch.Generator().manual_seed(seed)
    logits, asked = torch.randn(9, 4, generator=generator), []
    views = tuple(
        view_of(torch.randn(size, 4, generator=generator), torch.randperm(9, generator=generator)[:size], asked)
        for size in sizes
    )
    outputs = SimpleNamespace(features=logits, logits=logits)
    return Batch(torch.zeros(9, 3), torch.tensor([0, 9]), views), outputs, asked


def test_it_is_scipys_divergence_averaged_over_points_then_views():
    batch, outputs, _ = made()
    first = outputs.logits.softmax(dim=1).numpy()
    terms = []
    for view in batch.views:
        other = (2 * view.features).softmax(dim=1).numpy()
        pairs = zip(first[view.point_ids.numpy()], other, strict=True)
        terms.append(np.mean([jensenshannon(p, q) ** 2 for p, q in pairs]))
    got = ViewConsistency(dict(loss_weight=3.0))(batch, outputs, None)
    assert list(got) == ['loss_aug'] and got['loss_aug'].item() == pytest.approx(3 * np.mean(terms), rel=1e-5)


def test_squared_differences_instead():
    batch, outputs, _ = made(sizes=(5,))
    (view,) = batch.views
    squares = (outputs.logits.softmax(1)[view.point_ids] - (2 * view.features).softmax(1)) ** 2
    got = ViewConsistency(dict(type='MSEAugLoss'))(batch, outputs, None)['loss_aug']
    assert got.item() == pytest.approx(squares.mean().item(), rel=1e-5)


def test_without_a_view_there_is_nothing_to_say():
    batch, outputs, _ = made(sizes=())
    assert ViewConsistency()(batch, outputs, None) == {}


def test_the_network_sees_a_view_once_and_only_if_asked():
    batch, outputs, asked = made()
    assert asked == []
    ViewConsistency(num_points=2)(batch, outputs, None)
    ViewConsistency(dict(type='MSEAugLoss'))(batch, outputs, None)
    assert asked == [5, 3]


def test_at_most_so_many_points_are_compared():
    batch, outputs, _ = made(sizes=(5,))
    (view,) = batch.views
    first, second = outputs.logits.softmax(1)[view.point_ids].numpy(), (2 * view.features).softmax(1).numpy()
    each = [jensenshannon(p, q) ** 2 for p, q in zip(first, second, strict=True)]
    one = ViewConsistency(num_points=1)(batch, outputs, None)['loss_aug'].item()
    assert min(abs(one - value) for value in each) < 1e-6
    many = ViewConsistency(num_points=5)(batch, outputs, None)['loss_aug'].item()
    assert many == pytest.approx(np.mean(each), rel=1e-5)
