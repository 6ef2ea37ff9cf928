import pytest
import torch

from rm3d_plugin.models import Batch, SegmentorOutput
from rm3d_plugin.models.heads import PointGroupHead, PointLabels
from rm3d_plugin.models.losses import InstanceOffsets, offset_loss
from rm3d_plugin.models.losses.instance_offsets import instance_centroids, offset_targets

XYZ = torch.tensor([[0.0, 0, 0], [2, 0, 0], [9, 9, 9], [1, 1, 4], [4, 0, 0]])
INSTANCE = torch.tensor([0, 0, -1, 1, 0])


def labels(instance, scenes=None):
    count = int(instance.max()) + 1 if len(instance) else 0
    scenes = torch.zeros(max(count, 0), dtype=torch.int64) if scenes is None else torch.tensor(scenes)
    return PointLabels(instance.clamp_max(0), instance, scenes, instance >= 0)


def loss_of(offsets, xyz, given, **settings):
    batch, outputs = Batch(xyz, torch.tensor([0, len(xyz)])), SegmentorOutput(offsets, offsets, offsets)
    return InstanceOffsets(**settings)(batch, outputs, given)['loss_offset']


def test_centroids_and_targets_by_hand():
    assert instance_centroids(XYZ, INSTANCE, 2).tolist() == [[2, 0, 0], [1, 1, 4]]
    got = offset_targets(XYZ, INSTANCE, 2)
    assert got.rows.tolist() == [0, 1, 3, 4]
    assert got.offsets.tolist() == [[2, 0, 0], [0, 0, 0], [0, 0, 0], [-2, 0, 0]]
    assert offset_targets(XYZ, INSTANCE, 2, min_points=2).rows.tolist() == [0, 1, 4]
    assert offset_targets(XYZ, torch.full((5,), -1), 0).rows.tolist() == []
    assert offset_targets(XYZ[:0], INSTANCE[:0], 0).offsets.shape == (0, 3)


def test_centroids_are_exact_far_from_the_origin():
    xyz = torch.tensor([[1000.125, 0, 0]]).repeat(30001, 1)
    assert instance_centroids(xyz, torch.zeros(30001, dtype=torch.int64), 1).tolist() == [[1000.125, 0, 0]]


def test_offset_loss_is_that_of_the_method():
    # point 0: |o - o*|_1 = 2 and cos 0; point 1: no direction, |o - o*|_1 = 1; mean 1.5 - 0
    got = offset_loss(torch.tensor([[1.0, 1, 0], [0, 1, 0]]), torch.tensor([[1.0, -1, 0], [0, 0, 5e-4]]))
    assert got.item() == pytest.approx((2 + 1 + 5e-4) / 2 - 0.0)
    assert offset_loss(torch.eye(3), torch.eye(3)).item() == -1.0
    assert offset_loss(torch.eye(3), -torch.eye(3)).item() == pytest.approx(2 + 1)


def test_loss_by_hand_and_its_gradient():
    offsets = torch.zeros(5, 3, requires_grad=True)
    loss = loss_of(offsets, XYZ, labels(INSTANCE))
    assert loss.item() == pytest.approx((2 + 0 + 0 + 2) / 4)  # cosine of a zero offset is 0
    larger = loss_of(offsets, XYZ, labels(INSTANCE), min_points=2, loss=dict(loss_weight=3.0))
    assert larger.item() == pytest.approx(3 * (2 + 0 + 2) / 3)  # instance 1 has one point
    loss.backward()
    assert offsets.grad[2].abs().sum() == 0  # a point of no instance
    assert (offsets.grad[0, 0] < 0) and (offsets.grad[4, 0] > 0)


def test_no_instance_is_a_zero_loss_with_gradients():
    head = PointGroupHead(4)
    loss = loss_of(head(torch.randn(5, 4)), XYZ, labels(torch.full((5,), -1), []))
    loss.backward()
    assert loss.item() == 0.0
    assert all(p.grad is not None and p.grad.abs().sum() == 0 for p in head.parameters())


def test_one_point_can_be_trained_on():
    head = PointGroupHead(4).train()
    loss = loss_of(head(torch.randn(1, 4)), XYZ[:1], labels(INSTANCE[:1]))
    loss.backward()
    assert torch.isfinite(loss)
