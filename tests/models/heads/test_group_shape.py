import math

import pytest
import torch

from rm3d_plugin.models.heads.group_shape import SHAPE_CHANNELS, group_shape, membership


def test_line_by_hand():
    local = torch.tensor([[[-1.0, 0, 0], [1.0, 0, 0], [9.0, 9.0, 9.0]]])
    got = group_shape(local, torch.tensor([[1.0, 1.0, 0.0]]))[0]
    assert got.tolist() == pytest.approx([0, 0, 0, 1, 0, 1, 0, 0], abs=1e-3)
    assert len(got) == SHAPE_CHANNELS


def test_weights_move_the_mean_and_the_spread():
    local = torch.tensor([[[0.0, 0, 0], [0, 4.0, 2.0]]])
    got = group_shape(local, torch.tensor([[0.75, 0.25]]))[0]
    deviation = math.sqrt(3.0)  # variance 3/4 x 1 + 1/4 x 9 along y
    assert got.tolist() == pytest.approx([0, 1, 0.5, -1, 0, deviation, 0, deviation / 2], abs=1e-3)


def test_turning_the_group_turns_the_direction_twice():
    generator = torch.Generator().manual_seed(0)
    local = torch.randn(1, 40, 3, generator=generator) * torch.tensor([2.0, 0.5, 1.0])
    weights, angle = torch.rand(1, 40, generator=generator), 0.4
    turn = torch.tensor([[math.cos(angle), math.sin(angle), 0], [-math.sin(angle), math.cos(angle), 0], [0, 0, 1.0]])
    first, second = group_shape(local, weights)[0], group_shape(local @ turn, weights)[0]
    before, after = torch.atan2(first[4], first[3]), torch.atan2(second[4], second[3])
    assert math.remainder(float(after - before), 2 * math.pi) == pytest.approx(2 * angle, abs=1e-4)
    assert torch.allclose(first[5:], second[5:], atol=1e-5)


def test_empty_group_and_single_point():
    assert group_shape(torch.zeros(1, 3, 3), torch.zeros(1, 3)).abs().sum() == 0
    assert group_shape(torch.ones(1, 1, 3), torch.ones(1, 1)).tolist() == [[1, 1, 1, 0, 0, 0, 0, 0]]
    assert group_shape(torch.zeros(0, 3, 3), torch.zeros(0, 3)).shape == (0, SHAPE_CHANNELS)


def test_membership_by_hand():
    votes = torch.tensor([[[0.0, 0, 0], [0, 1 / 3, 0], [0.0, 0, 0]]])
    got = membership(votes, torch.tensor([[0.5, 1.0, 1.0]]), torch.tensor([[4, 7, -1]]))
    assert got.tolist() == [[0.5, pytest.approx(math.exp(-0.5)), 0.0]]
