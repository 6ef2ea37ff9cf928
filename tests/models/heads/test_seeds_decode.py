import numpy as np
import pytest
import torch

from rm3d_plugin.models.heads.box_coder import BoxPrediction, decode_boxes
from rm3d_plugin.models.heads.decode import (
    Detections,
    class_scores,
    fuse_boxes,
    scored_by_height,
    select_boxes,
    stand_on_ground,
)
from rm3d_plugin.models.heads.seeds import choose_seeds


def test_seeds_prefer_foreground_then_spread():
    xyz = torch.tensor([[0.0, 0, 0], [0.1, 0, 0], [5, 0, 0], [50, 0, 0], [60, 0, 0]])
    foreground = torch.tensor([0.9, 0.8, 0.7, 0.1, 0.05])
    rows, offsets = choose_seeds(xyz, foreground, torch.tensor([0, 5]), 2, 0.2)
    assert rows.tolist() == [0, 2]  # of the three likely points, the two furthest apart
    assert offsets.tolist() == [0, 2]
    rows, _ = choose_seeds(xyz, foreground, torch.tensor([0, 5]), 4, 0.2)
    assert sorted(rows.tolist()) == [0, 1, 2, 3]  # too few likely ones: the next likeliest
    rows, offsets = choose_seeds(xyz, foreground, torch.tensor([0, 0, 5]), 9, 0.2)
    assert (len(rows), offsets.tolist()) == (5, [0, 0, 5])


def prediction(centers, objectness, kinds):
    n = len(centers)
    scores = torch.full((n, 2), -20.0)
    scores[torch.arange(n), torch.tensor(kinds)] = 20.0
    pair = torch.stack([torch.zeros(n), torch.tensor(objectness)], dim=1)
    return BoxPrediction(
        pair, torch.tensor(centers), torch.zeros(n, 1), torch.zeros(n, 1), scores, torch.zeros(n, 2, 3), scores
    )


def decoded(given, means, fuse_iou=None):
    return select_boxes(decode_boxes(given, means), class_scores(given), 0.05, 0.25, 100, fuse_iou)


def test_decode_keeps_the_best_of_each_class():
    means = torch.tensor([[4.0, 2, 1], [4.0, 2, 1]])
    got = decoded(
        prediction([[0.0, 0, 0], [0.3, 0, 0], [0.0, 0, 0], [9.0, 0, 0]], [1.0, 3.0, 2.0, -9.0], [0, 0, 1, 0]), means
    )
    assert got.labels.tolist() == [0, 1]
    assert torch.allclose(got.boxes, torch.tensor([[0.3, 0, 0, 4, 2, 1, 0], [0.0, 0, 0, 4, 2, 1, 0]]))
    assert torch.allclose(got.scores, torch.sigmoid(torch.tensor([3.0, 2.0])), atol=1e-5)
    none = decoded(prediction([[0.0, 0, 0]], [-9.0], [0]), means)
    assert none.boxes.shape == (0, 7) and none.scores.shape == (0,)


def test_scores_may_ask_the_points():
    given = prediction([[0.0, 0, 0]], [0.0], [0])
    assert torch.allclose(class_scores(given), torch.tensor([[0.5, 0.0]]), atol=1e-6)
    asked = class_scores(given, torch.tensor([[0.25, 0.75]]))
    assert torch.allclose(asked, torch.tensor([[0.25, 0.0]]), atol=1e-6)
    assert torch.allclose(class_scores(given, fits=torch.tensor([0.5])), torch.tensor([[0.25, 0.0]]), atol=1e-6)


def test_fusing_averages_what_overlaps_within_the_class():
    boxes = np.array(
        [
            [0.0, 0, 0, 4, 2, 1, 0.1],
            [0.0, 0, 1.0, 4, 2, 1, 0.1 + np.pi],
            [0.0, 0, 9, 4, 2, 1, 0.1],
            [30.0, 0, 0, 4, 2, 1, 2],
        ]
    )
    scores, labels = np.array([1.0, 0.5, 0.9, 0.2]), np.array([0, 0, 1, 0])
    got = fuse_boxes(boxes, scores, labels, np.array([0, 3]), 0.5)
    assert np.allclose(
        got[0], [0, 0, 0.2, 4, 2, 1, 0.1]
    )  # (1 x 0 + .25 x 1) / 1.25; the reversed one keeps the heading
    assert np.allclose(got[1], boxes[3])


def test_fused_decode_keeps_scores_and_labels():
    given, means = prediction([[0.0, 0, 0], [0.4, 0, 0]], [2.0, 2.0], [0, 0]), torch.tensor([[4.0, 2, 1], [4.0, 2, 1]])
    plain, fused = decoded(given, means), decoded(given, means, fuse_iou=0.5)
    assert torch.equal(plain.scores, fused.scores)
    assert plain.boxes[0, 0] == 0.0 and 0.1 < float(fused.boxes[0, 0]) < 0.2


def test_boxes_stand_on_the_ground_below_their_nearest_point():
    """A slope: the ground is at x / 10."""
    xyz = torch.tensor([[10.0, 0, 1.5], [20.0, 0, 2.5], [20.0, 3.0, 4.0]])
    height = xyz[:, 2] - xyz[:, 0] / 10
    boxes = torch.tensor([[10.5, 0.1, 9.0, 4, 2, 1.5, 0.3], [19.0, 1.0, -2.0, 1, 1, 1.8, 0.0]])
    found = Detections(boxes, torch.tensor([0, 1]), torch.tensor([0.9, 0.8]))
    got = stand_on_ground(found, xyz, height)
    assert torch.allclose(got.boxes[:, 2], torch.tensor([1.0 + 0.75, 2.0 + 0.9]))
    assert torch.equal(got.boxes[:, [0, 1, 3, 4, 5, 6]], boxes[:, [0, 1, 3, 4, 5, 6]]) and float(boxes[0, 2]) == 9.0
    assert stand_on_ground(found, xyz[:0], height[:0]) is found


def test_scores_ask_how_far_up_the_points_of_a_box_reach():
    """A box of 1.8 m around points up to .9 m and one full of points; of gaps the widest may hide the top."""
    low, full = [0.3, 0.6, 0.9], [0.2, 0.6, 1.0, 1.6]
    xyz = torch.tensor([[0.0, 0.0, z] for z in low] + [[5.0, 0.0, z] for z in full])
    boxes = torch.tensor([[x, 0.0, 0.9, 1.0, 1.0, 1.8, 0.0] for x in (0.0, 5.0, 9.0)])
    found = Detections(boxes, torch.tensor([1, 0, 2]), torch.tensor([0.9, 0.8, 0.7]))
    got = scored_by_height(found, xyz, xyz[:, 2])
    assert got.labels.tolist() == [0, 1, 2] and got.boxes[:, 0].tolist() == [5.0, 0.0, 9.0]  # best first again
    assert got.scores.tolist() == pytest.approx([0.8, 0.9 * (0.9 + 0.3) / 1.8, 0.0])  # the last holds nothing
    single = torch.tensor([[0.0, 0.0, 0.7], [3.0, 0.0, 0.2]])  # one beam; another point tells where ground began
    told = scored_by_height(Detections(boxes[:1], found.labels[:1], found.scores[:1]), single, single[:, 2])
    assert told.scores.tolist() == pytest.approx([0.9 * (0.7 + 0.5) / 1.8])
    assert len(scored_by_height(Detections(boxes[:0], found.labels[:0], found.scores[:0]), xyz, xyz[:, 2]).scores) == 0
