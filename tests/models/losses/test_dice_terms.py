"""L_Dice of instances and of proposals, against loops over points."""

import math

import numpy as np
import pytest
import torch

from rm3d_plugin.models import Batch, DetectorOutput, SegmentorOutput
from rm3d_plugin.models.heads import BatchLabels, PointLabels, ProposalTargets, VoteOutput
from rm3d_plugin.models.heads.box_coder import BoxPrediction
from rm3d_plugin.models.losses import InstanceDice, ProposalDice
from rm3d_plugin.models.losses.instance_dice import soft_instance_masks
from rm3d_plugin.models.losses.proposal_dice import class_radii, soft_mask


def dice_slow(mask, member):
    both = sum(p * g for p, g in zip(mask, member, strict=True))
    return 1 - (2 * both + 1) / (sum(mask) + sum(member) + 1)


def softmax(logits):
    powers = np.exp(logits - logits.max(axis=1, keepdims=True))
    return powers / powers.sum(axis=1, keepdims=True)


# ---------------------------------------------------------------------- instances


def test_soft_masks_by_hand():
    xyz = torch.tensor([[0.0, 0, 0], [2, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0]])
    offsets = torch.tensor([[1.0, 0, 0], [-1, 0, 0], [0.3, 0, 0], [0, 0, 0], [0, 0, 0]])
    probs = torch.tensor([[0.2, 0.8]] * 5)
    labels = PointLabels(
        torch.tensor([1, 1, 0, -1, 1]), torch.tensor([0, 0, -1, -1, 1]), torch.tensor([0, 1]), torch.ones(5) > 0
    )
    first, second = soft_instance_masks(xyz, offsets, probs, torch.tensor([0, 4, 5]), labels, spread=0.15)
    assert first.member.tolist() == [1, 1, 0]  # the unlabelled point is left out, the other scene too
    assert first.mask.tolist() == pytest.approx([0.8, 0.8, 0.8 * 0.1353353], abs=1e-6)  # exp(-.3^2 / (2 .15^2))
    assert second.member.tolist() == [1] and second.mask.tolist() == pytest.approx([0.8])


def made_instances(seed=0):
    """Two scenes of thirty points; three instances, of classes 1, 2 and unknown."""
    rng = np.random.default_rng(seed)
    xyz, offsets = rng.uniform(0, 1, (60, 3)), rng.normal(0, 0.1, (60, 3))
    instance = np.concatenate([rng.integers(-1, 2, 30), np.where(rng.random(30) < 0.5, 2, -1)])
    semantic = np.select([instance == 0, instance == 1, instance == 2], [1, 2, -1], rng.integers(-1, 3, 60))
    return xyz, offsets, rng.normal(0, 1, (60, 3)), semantic, instance


def test_instance_dice_is_that_of_a_loop():
    xyz, offsets, logits, semantic, instance = made_instances()
    probs, terms = softmax(logits), []
    for number, kind, scene in ((0, 1, range(30)), (1, 2, range(30))):  # the third instance has no class
        center = xyz[instance == number].mean(axis=0)
        known = [i for i in scene if semantic[i] >= 0 or instance[i] >= 0]
        squares = [((xyz[i] + offsets[i] - center) ** 2).sum() for i in known]
        mask = [probs[i, kind] * math.exp(-d / (2 * 0.15**2)) for i, d in zip(known, squares, strict=True)]
        terms.append(dice_slow(mask, [float(instance[i] == number) for i in known]))
    tensors = [torch.tensor(values, dtype=torch.float32) for values in (xyz, offsets, logits)]
    labels = PointLabels(torch.tensor(semantic), torch.tensor(instance), torch.tensor([0, 0, 1]), torch.ones(60) > 0)
    outputs = SegmentorOutput(tensors[2], tensors[2], tensors[1])
    got = InstanceDice(dict(loss_weight=2.0))(Batch(tensors[0], torch.tensor([0, 30, 60])), outputs, labels)
    assert list(got) == ['loss_dice'] and got['loss_dice'].item() == pytest.approx(2 * np.mean(terms), rel=1e-5)


def test_no_instance_is_a_zero_loss_with_gradients():
    logits, offsets = torch.randn(4, 2, requires_grad=True), torch.randn(4, 3, requires_grad=True)
    nothing = torch.full((4,), -1)
    labels = PointLabels(nothing, nothing, nothing[:0], nothing > 0)
    outputs = SegmentorOutput(logits, logits, offsets)
    loss = InstanceDice()(Batch(torch.zeros(4, 3), torch.tensor([0, 4])), outputs, labels)['loss_dice']
    loss.backward()
    assert loss.item() == 0.0 and logits.grad.abs().sum() == 0 and offsets.grad.abs().sum() == 0


# ---------------------------------------------------------------------- proposals


def test_class_radius_and_soft_mask_by_hand():
    assert class_radii(torch.tensor([[3.0, 4.0, 1.0]])).tolist() == [2.5]
    votes = torch.tensor([[0.0, 0, 0], [1.0, 0, 0]])
    got = soft_mask(torch.tensor([0.5, 1.0]), votes, torch.zeros(1, 3), 2.0)  # s = 1
    assert torch.allclose(got, torch.tensor([[0.5, math.exp(-0.5)]]))


def made_proposals(seed=0):
    """Two scenes of forty points; box 0 and 1 in the first, 2 in the second; proposals 0, 2 and 3 are positive."""
    rng = np.random.default_rng(seed)
    centers = np.array([[0.0, 0, 0], [6, 0, 0], [0, 3, 0]])
    instance = np.concatenate([np.repeat([0, 1, -1], [15, 15, 10]), np.repeat([2, -1], [25, 15])])
    xyz = centers[np.maximum(instance, 0)] + rng.normal(0, 0.7, (80, 3))
    semantic = np.where(instance >= 0, np.array([1, 0, 1])[np.maximum(instance, 0)], rng.choice([-1, 2], 80))
    return rng, centers, xyz, semantic, instance


def test_proposal_dice_is_that_of_a_loop():
    rng, centers, xyz, semantic, instance = made_proposals()
    classes, sizes = np.array([1, 0, 1]), np.array([[3.0, 4, 1], [1, 1, 2]])
    votes, logits, proposed = rng.normal(0, 0.3, (80, 3)), rng.normal(0, 1, (80, 3)), rng.normal(0, 1, (5, 3))
    positives, boxes, scenes = [0, 2, 3], [1, 1, 2], [range(40), range(40), range(40, 80)]
    probs, objects = softmax(logits), []
    for box in (1, 2):
        radius = 0.5 * math.hypot(*sizes[classes[box], :2])
        near = [
            i
            for i in scenes[box]
            if np.linalg.norm(xyz[i] - centers[box]) <= 2 * radius and (semantic[i] >= 0 or instance[i] >= 0)
        ]
        member, each = [float(instance[i] == box) for i in near], []
        for row, owner in zip(positives, boxes, strict=True):
            if owner == box:
                squares = [((proposed[row] - xyz[i] - votes[i]) ** 2).sum() for i in near]
                mask = [
                    probs[i, classes[box]] * math.exp(-d / (2 * (radius / 2) ** 2))
                    for i, d in zip(near, squares, strict=True)
                ]
                each.append(dice_slow(mask, member))
        objects.append(np.mean(each))
    real = {name: torch.tensor(value, dtype=torch.float32) for name, value in locals().items() if name in REAL}
    none = torch.zeros(5, 0)
    prediction = BoxPrediction(none, real['proposed'], none, none, none, torch.zeros(5, 0, 3), none)
    said = VoteOutput(real['votes'], real['proposed'], torch.tensor([0, 3, 5]), torch.zeros(5, 0).long(), prediction,
                      real['sizes'])  # fmt: skip
    targets = ProposalTargets(torch.zeros(5).long(), torch.ones(5), torch.tensor(positives), torch.tensor(boxes), None)
    labels = BatchLabels(
        torch.cat([real['centers'], torch.ones(3, 4)], dim=1), torch.tensor(classes), torch.ones(3) > 0,
        torch.tensor([0, 2, 3]), torch.tensor(semantic), torch.tensor(instance), targets,
    )  # fmt: skip
    outputs = DetectorOutput(real['logits'], real['logits'], said)
    got = ProposalDice()(Batch(real['xyz'], torch.tensor([0, 40, 80])), outputs, labels)
    assert list(got) == ['loss_dice'] and got['loss_dice'].item() == pytest.approx(np.mean(objects), rel=1e-5)


REAL = ('xyz', 'votes', 'logits', 'proposed', 'sizes', 'centers')
