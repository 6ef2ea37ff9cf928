"""Views of a scene at test time, against boxes and points moved by hand."""

import math

import numpy as np
import pytest
import torch

from rm3d_plugin.models import Batch
from rm3d_plugin.models.detectors.tta_views import AS_SCANNED, TtaView, as_scanned, pool_views, seen
from rm3d_plugin.models.heads.decode import Detections
from rm3d_plugin.ops.boxes import points_in_boxes


def found(boxes, labels, scores):
    return Detections(torch.tensor(boxes).reshape(-1, 7), torch.tensor(labels).long(), torch.tensor(scores))


def car(x, y=0.0, yaw=0.0):
    return [x, y, 0.0, 4.0, 2.0, 1.5, yaw]


@pytest.mark.parametrize(
    'view', [TtaView(True, 0.0), TtaView(False, 0.5), TtaView(True, -0.35), TtaView(True, math.pi)]
)
def test_boxes_found_in_a_view_hold_the_points_that_they_held_there(view):
    rng = np.random.default_rng(0)
    points = torch.tensor(np.c_[rng.uniform(-6, 6, (500, 2)), rng.uniform(-1, 1, 500), rng.random(500)])
    batch = Batch(points.float(), torch.tensor([0, 500]))
    there = seen(batch, view)
    assert torch.equal(there.points[:, 2:], batch.points[:, 2:]) and not torch.equal(there.xyz, batch.xyz)
    boxes = found([car(2.0, 1.0, 0.3), car(-3.0, -2.0, -1.2)], [0, 0], [0.5, 0.5])
    back = as_scanned(boxes, view)
    held = points_in_boxes(there.xyz.double().numpy(), boxes.boxes.double().numpy())
    assert (held >= 0).sum() > 30
    np.testing.assert_array_equal(points_in_boxes(batch.xyz.double().numpy(), back.boxes.double().numpy()), held)
    assert (back.boxes[:, 6].abs() <= math.pi).all()


def test_a_car_ahead_turned_to_the_left_is_found_ahead():
    quarter = TtaView(False, math.pi / 2)
    np.testing.assert_allclose(seen(Batch(torch.tensor([[3.0, 1.0, 0.5]]), torch.tensor([0, 1])), quarter).points[0],
                               [-1, 3, 0.5], atol=1e-6)  # fmt: skip
    back = as_scanned(found([car(-1.0, 3.0, math.pi / 2)], [0], [0.9]), quarter)
    np.testing.assert_allclose(back.boxes[0], car(3.0, 1.0, 0.0), atol=1e-6)


def test_as_scanned_nothing_moves():
    batch, boxes = Batch(torch.randn(4, 4), torch.tensor([0, 4])), found([car(1.0, yaw=1.0)], [0], [0.5])
    assert seen(batch, AS_SCANNED) is batch
    torch.testing.assert_close(as_scanned(boxes, AS_SCANNED).boxes, boxes.boxes)


def test_scores_are_means_over_the_views_and_boxes_are_averaged():
    first = found([car(0.0), car(20.0)], [0, 0], [0.8, 0.6])
    second = found([car(0.4), car(20.0), car(0.0)], [0, 1, 0], [0.4, 0.9, 0.2])
    pooled = pool_views([first, second], nms_iou=0.25, fuse_iou=0.3, limit=9)
    assert pooled.labels.tolist() == [0, 1, 0]
    np.testing.assert_allclose(pooled.scores, [(0.8 + 0.4) / 2, 0.9 / 2, 0.6 / 2], rtol=1e-6)
    overlap = 3.6 * 2 / (2 * 8 - 3.6 * 2)
    weights = np.array([0.64, 0.16 * overlap, 0.04])  # score squared times the overlap with the best
    np.testing.assert_allclose(pooled.boxes[0, 0], weights @ [0, 0.4, 0] / weights.sum(), rtol=1e-5)
    sharp = pool_views([first, second], nms_iou=0.25, fuse_iou=None, limit=2)
    assert sharp.boxes[:, 0].tolist() == [0.0, 20.0] and sharp.labels.tolist() == [0, 1]


def test_nothing_found_stays_nothing():
    none = found([], [], [])
    assert len(pool_views([none, none], 0.25, 0.3, 9).scores) == 0
    one = pool_views([none, found([car(1.0)], [2], [0.5])], 0.25, 0.3, 9)
    assert one.labels.tolist() == [2] and one.scores.tolist() == [0.25]
