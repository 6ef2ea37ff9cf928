import numpy as np
import pytest
import torch

from rm3d_plugin.models.heads import PointGroupHead, ProposalRules, find_instances
from rm3d_plugin.models.heads.point_group_head import instance_centroids, offset_targets
from rm3d_plugin.models.heads.point_labels import PointLabels
from rm3d_plugin.models.losses import offset_loss

XYZ = torch.tensor([[0.0, 0, 0], [2, 0, 0], [9, 9, 9], [1, 1, 4], [4, 0, 0]])
INSTANCE = torch.tensor([0, 0, -1, 1, 0])


def labels(instance, scenes=None):
    count = int(instance.max()) + 1 if len(instance) else 0
    scenes = torch.zeros(max(count, 0), dtype=torch.int64) if scenes is None else torch.tensor(scenes)
    return PointLabels(instance.clamp_max(0), instance, scenes, instance >= 0)


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
    head = PointGroupHead(4)
    offsets = torch.zeros(5, 3, requires_grad=True)
    loss = head.loss(offsets, XYZ, labels(INSTANCE))['loss_offset']
    assert loss.item() == pytest.approx((2 + 0 + 0 + 2) / 4)  # cosine of a zero offset is 0
    loss.backward()
    assert offsets.grad[2].abs().sum() == 0  # a point of no instance
    assert (offsets.grad[0, 0] < 0) and (offsets.grad[4, 0] > 0)


def test_no_instance_is_a_zero_loss_with_gradients():
    head = PointGroupHead(4)
    loss = head.loss(head(torch.randn(5, 4)), XYZ, labels(torch.full((5,), -1), []))['loss_offset']
    loss.backward()
    assert loss.item() == 0.0
    assert all(p.grad is not None and p.grad.abs().sum() == 0 for p in head.parameters())


def test_one_point_can_be_trained_on():
    head = PointGroupHead(4).train()
    loss = head.loss(head(torch.randn(1, 4)), XYZ[:1], labels(INSTANCE[:1]))['loss_offset']
    loss.backward()
    assert torch.isfinite(loss)


# ---------------------------------------------------------------------- proposals


def heap(center, count, seed, spread=0.01):
    return np.asarray(center, dtype=float) + np.random.default_rng(seed).uniform(-spread, spread, (count, 3))


def probs_of(classes, sure=0.8, num=3):
    out = np.full((len(classes), num), (1 - sure) / (num - 1))
    out[np.arange(len(classes)), classes] = sure
    return out


def test_instances_by_hand():
    xyz = np.concatenate(
        [heap((0, 0, 0), 60, 0), heap((1, 0, 0), 40, 1), heap((2, 0, 0), 60, 2), heap((3, 0, 0), 9, 3)]
    )
    classes = np.repeat([1, 1, 0, 2], [60, 40, 60, 9])
    probs = probs_of(classes)
    probs[60:100] = probs_of(classes[60:100], 0.9)
    rules = ProposalRules(radius=0.05, cluster_points=10, min_points=39)
    found = find_instances(xyz, xyz, probs, (1, 2), rules)
    assert found.labels.tolist() == [1, 1] and found.scores.tolist() == pytest.approx([0.9, 0.8])
    assert found.masks.shape == (2, 169) and found.masks.sum(1).tolist() == [40, 60]  # twins are suppressed
    assert found.masks[0, 60:100].all() and found.masks[1, :60].all()
    assert found.scores.dtype == np.float32 and found.labels.dtype == np.int64
    assert find_instances(xyz, xyz, probs, (1, 2), ProposalRules(0.05, 10, 40)).labels.tolist() == [1]  # more than 40
    assert find_instances(xyz, xyz, probs, (), rules).masks.shape == (0, 169)
    only = find_instances(xyz, xyz, probs, (1, 2), ProposalRules(0.05, 10, 5, max_instances=2, min_score=0.85))
    assert only.scores.tolist() == pytest.approx([0.9])


def test_shifted_points_part_what_touches_and_join_what_is_broken():
    left, right = heap((0, 0, 0), 60, 0, 0.05), heap((0.1, 0, 0), 60, 1, 0.05)  # two objects side by side
    xyz = np.concatenate([left, right])
    shifted = np.repeat([[0.0, 0, 0], [0.1, 0, 0]], 60, axis=0)
    probs = probs_of(np.ones(120, dtype=int))
    rules = dict(radius=0.04, cluster_points=20, min_points=20)
    assert find_instances(xyz, xyz, probs, (1,), ProposalRules(**rules)).masks.sum(1).tolist() == [120]
    parts = find_instances(xyz, shifted, probs, (1,), ProposalRules(**rules, coordinates='shifted'))
    assert [mask.nonzero()[0].tolist() for mask in parts.masks] == [list(range(60)), list(range(60, 120))]
    both = find_instances(xyz, shifted, probs, (1,), ProposalRules(**rules))
    assert both.masks.sum(1).tolist() == [60, 60]  # equal scores: the shifted clusters come first
    assert find_instances(xyz, shifted, probs, (1,), ProposalRules(**rules, coordinates='original')).masks.sum() == 120


def test_no_point_and_no_cluster():
    empty = np.zeros((0, 3))
    assert find_instances(empty, empty, empty, (1,), ProposalRules()).masks.shape == (0, 0)
    one = np.zeros((1, 3))
    assert find_instances(one, one, probs_of([1]), (1,), ProposalRules()).masks.shape == (0, 1)
    assert find_instances(one, one, probs_of([1]), (1,), ProposalRules(0.1, 1, 0)).masks.tolist() == [[True]]


def test_bad_rules_are_told():
    with pytest.raises(ValueError, match='radius > 0'):
        PointGroupHead(4, proposals=dict(radius=0.0))
