import math

import pytest
import torch

from rm3d_plugin.models.heads.box_coder import (
    BoxPrediction,
    decode_boxes,
    decode_heading,
    encode_boxes,
    encode_heading,
    prediction_width,
    split_prediction,
)


def perfect(code, bins, classes):
    """The prediction that says exactly what the code says."""
    rows = torch.arange(len(code.centers))
    heading, turn = torch.zeros(len(rows), bins), torch.full((len(rows), bins), 9.0)
    heading[rows, code.heading_bins], turn[rows, code.heading_bins] = 1.0, code.heading_residuals
    sizes, stretch = torch.zeros(len(rows), classes), torch.full((len(rows), classes, 3), 9.0)
    sizes[rows, code.classes], stretch[rows, code.classes] = 1.0, code.size_residuals
    return BoxPrediction(torch.zeros(len(rows), 2), code.centers, heading, turn, sizes, stretch, sizes)


def test_heading_by_hand():
    bins, rest = encode_heading(torch.tensor([0.0, math.pi / 6, -math.pi / 12 * 1.001, math.pi]), 12)
    assert bins.tolist() == [0, 1, 11, 6]
    assert rest.tolist() == pytest.approx([0.0, 0.0, 0.999, 0.0], abs=1e-3)


@pytest.mark.parametrize('bins', [2, 12])
def test_heading_round_trip(bins):
    yaw = torch.linspace(-7.0, 7.0, 301)
    back = decode_heading(*encode_heading(yaw, bins), bins)
    assert (torch.sin(0.5 * (back - yaw)).abs() < 1e-5).all()
    assert (encode_heading(yaw, bins)[1].abs() <= 1 + 1e-5).all()
    assert ((back >= -math.pi) & (back < math.pi)).all()


def test_one_bin_is_axis_aligned():
    bins, rest = encode_heading(torch.tensor([0.7]), 1)
    assert (bins.item(), rest.item()) == (0, 0.0)
    assert decode_heading(torch.tensor([0]), torch.tensor([0.4]), 1).item() == 0.0


def test_boxes_round_trip():
    boxes = torch.tensor([[1.0, 2, 3, 4, 2, 1.5, 0.3], [0.0, 0, 0, 0.5, 0.6, 1.8, -2.0]])
    means = torch.tensor([[3.9, 1.6, 1.5], [0.8, 0.6, 1.7]])
    code = encode_boxes(boxes, torch.tensor([0, 1]), means, 12)
    assert torch.allclose(decode_boxes(perfect(code, 12, 2), means), boxes, atol=1e-5)


def test_columns():
    width = prediction_width(12, 3)
    assert width == 2 + 3 + 24 + 12 + 3
    raw = torch.arange(float(width))[None]
    got = split_prediction(raw, torch.tensor([[10.0, 0.0, 0.0]]), 12)
    assert got.centers.tolist() == [[12.0, 3.0, 4.0]]
    assert got.class_scores.tolist() == [[width - 3.0, width - 2.0, width - 1.0]]
    assert got.size_residuals.shape == (1, 3, 3)


def test_no_negative_sizes():
    code = encode_boxes(torch.tensor([[0.0, 0, 0, 1, 1, 1, 0]]), torch.tensor([0]), torch.ones(1, 3), 1)
    wild = perfect(code, 1, 1)._replace(size_residuals=torch.full((1, 1, 3), -5.0))
    assert (decode_boxes(wild, torch.ones(1, 3))[:, 3:6] > 0).all()
