"""The head that says how well a box fits."""

import math

import numpy as np
import pytest
import torch

from rm3d_plugin.models.heads import BatchLabels, BoxIoUHead, ProposalTargets
from rm3d_plugin.models.heads.box_coder import encode_boxes
from rm3d_plugin.models.heads.box_iou_head import BoxSeeds, in_box_frames, jittered, own_overlaps, points_around
from rm3d_plugin.models.losses import overlap_loss
from rm3d_plugin.ops.boxes import rotated_iou_3d

CAR = [0.0, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0]


def seeds_of(xyz, offsets=None, channels=3):
    xyz = torch.as_tensor(xyz, dtype=torch.float32)
    features = torch.arange(len(xyz) * channels, dtype=torch.float32).reshape(-1, channels).sin()
    return BoxSeeds(xyz, features, torch.tensor(offsets or [0, len(xyz)]))


def test_points_in_the_axes_of_a_box():
    box = torch.tensor([[1.0, 2.0, 0.0, 4.0, 2.0, 1.0, math.pi / 2]])
    got = in_box_frames(torch.tensor([[[1.0, 4.0, 0.5], [0.0, 2.0, 0.0]]]), box)
    torch.testing.assert_close(got, torch.tensor([[[2.0, 0.0, 0.5], [0.0, 1.0, 0.0]]]), atol=1e-6, rtol=0)


def test_a_box_reads_the_points_around_it_of_its_own_scene():
    seeds = seeds_of([[2.9, 0, 0], [3.1, 0, 0], [0, 1.5, 0], [0, 0, 0], [0, 0, 0]], [0, 4, 5])
    got = points_around(torch.tensor([CAR, CAR]), torch.tensor([0, 1, 2]), seeds, samples=2)
    assert got.tolist() == [[0, 2], [4, -1]]  # 1.4 half lengths and 20 cm are 3 m; the first two of three


def test_jitter_stays_within_its_share():
    torch.manual_seed(0)
    box = torch.tensor([CAR]).repeat(500, 1)
    got = jittered(box, 0.5)
    assert bool(((got[:, :3] - box[:, :3]).abs() <= 0.5 * box[:, 3:6]).all())
    assert bool(((got[:, 3:6] / box[:, 3:6]).log().abs() <= 0.5 + 1e-6).all())
    assert bool((got[:, 6].abs() <= 0.25 * math.pi).all())
    overlap = own_overlaps(got, torch.zeros(500, dtype=torch.long), box[:1])
    assert float(overlap.min()) < 0.4 and float(overlap.max()) > 0.9


def test_overlaps_are_with_the_own_box():
    truth = torch.tensor([CAR, [10.0, 0, 0, 4, 2, 1.5, 0.3]])
    given = torch.tensor([[9.0, 0, 0, 4, 2, 1.5, 0.0], [1.0, 0, 0, 4, 2, 1.5, 0.0]])
    got = own_overlaps(given, torch.tensor([1, 0]), truth)
    every = rotated_iou_3d(given.double().numpy(), truth.double().numpy())
    np.testing.assert_allclose(got.numpy(), [every[0, 1], every[1, 0]], rtol=1e-6)
    assert got[1].item() == pytest.approx(0.6)


def test_turning_box_and_points_together_changes_nothing():
    torch.manual_seed(1)
    head, angle = BoxIoUHead(3, hidden=8), 0.7
    xyz = torch.randn(20, 3)
    c, s = math.cos(angle), math.sin(angle)
    turn = torch.tensor([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    box = torch.tensor([[0.3, -0.2, 0.1, 4.0, 2.0, 1.5, 0.2]])
    moved = torch.cat([box[:, :3] @ turn.T, box[:, 3:6], box[:, 6:] + angle], dim=1)
    plain = head(box, torch.tensor([0, 1]), seeds_of(xyz))
    torch.testing.assert_close(plain, head(moved, torch.tensor([0, 1]), seeds_of(xyz @ turn.T)), atol=1e-5, rtol=0)
    assert head(torch.zeros(0, 7), torch.tensor([0, 0]), seeds_of(xyz)).shape == (0,)


def test_pairs_are_positive_proposals_and_wrong_copies_of_annotated_boxes():
    torch.manual_seed(2)
    truth = torch.tensor([CAR, [10.0, 0, 0, 4, 2, 1.5, 0.3]])
    classes, means = torch.zeros(2, dtype=torch.long), torch.tensor([[4.0, 2.0, 1.5]])
    near = torch.tensor([1])
    targets = ProposalTargets(
        torch.tensor([0, 1]), torch.ones(2), near, torch.tensor([1]), encode_boxes(truth[1:], classes[1:], means, 1)
    )
    labels = BatchLabels(
        truth, classes, torch.tensor([True, False]), torch.tensor([0, 2]), torch.zeros(5).long(), torch.zeros(5).long(),
        targets,
    )  # fmt: skip
    head = BoxIoUHead(3, hidden=8, copies=4)
    proposals = torch.stack([truth[0], truth[1]])
    said = torch.tensor([7.0, 3.0], requires_grad=True)
    got = head.pairs(proposals, said, labels, seeds_of(torch.randn(6, 3)))
    assert got.logits.shape == (5,) and got.logits[0] == 3.0 and got.ious[0] == pytest.approx(1.0)
    overlap_loss(*got).backward()
    assert said.grad.tolist()[0] == 0.0 and said.grad.tolist()[1] != 0.0


def test_overlap_loss_by_hand():
    got = overlap_loss(torch.tensor([0.0, math.log(3.0)]), torch.tensor([1.0, 0.0]))
    assert got.item() == pytest.approx((math.log(2.0) + math.log(4.0)) / 2, rel=1e-6)
    assert overlap_loss(torch.zeros(0), torch.zeros(0)).item() == 0.0
