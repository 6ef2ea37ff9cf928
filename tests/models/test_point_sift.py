"""Orientation encoding: octants by hand and against a slow twin, the unit by hand, what reaches a point."""

import numpy as np
import pytest
import torch

from rm3d_plugin.models.backbones.point_sift import OrientationEncoding, PointSIFTBackbone
from rm3d_plugin.ops.octant_neighbors import octant_neighbors


def slow_octants(xyz, radius):
    out = np.repeat(np.arange(len(xyz))[:, None], 8, axis=1)
    for i, place in enumerate(xyz):
        for octant in range(8):
            side = np.array([octant & 4, octant & 2, octant & 1], dtype=bool)
            away = xyz - place
            square = (away**2).sum(axis=1)
            inside = ((away >= 0) == side).all(axis=1) & (square > 0) & (square <= radius**2)
            if inside.any():
                out[i, octant] = np.flatnonzero(inside)[square[inside].argmin()]
    return out


def test_octants_by_hand():
    xyz = np.array([[0.0, 0, 0], [1, 1, 1], [2, 2, 2], [-1, -1, -1], [-1, 1, 0], [0, 0, 0]])
    found = octant_neighbors(xyz, 2.0)
    assert found[0].tolist() == [3, 0, 0, 4, 0, 0, 0, 1]  # the copy at the same place is no neighbour
    assert octant_neighbors(xyz, 1.5)[0].tolist() == [0, 0, 0, 4, 0, 0, 0, 0]


def test_octants_equal_the_slow_twin():
    xyz = np.random.default_rng(0).integers(-6, 6, (200, 3)).astype(np.float32)  # with ties and duplicates
    np.testing.assert_array_equal(octant_neighbors(xyz, 3.0), slow_octants(xyz.astype(float), 3.0))
    assert octant_neighbors(xyz[:0], 1.0).shape == (0, 8) and octant_neighbors(xyz[:1], 1.0).tolist() == [[0] * 8]
    with pytest.raises(ValueError, match='radius'):
        octant_neighbors(xyz, 0.0)


def test_a_unit_by_hand():
    unit = OrientationEncoding(2)
    for axis in unit.axes:  # each halving adds up both cells
        torch.nn.init.zeros_(axis.bias)
        axis.weight.data = torch.cat([torch.eye(2), torch.eye(2)], dim=1)
    unit.norm = torch.nn.Identity()
    values = torch.tensor([[1.0, 0.0], [10.0, 0.0], [0.0, 2.0]])
    near = torch.tensor([[0, 0, 0, 0, 1, 1, 2, 2], [1] * 8, [2] * 8])
    # own 1; eight corners: 4 x 1 + 2 x 10, 2 x 2
    assert unit(values, near).tolist() == [[25.0, 4.0], [90.0, 0.0], [0.0, 18.0]]


def test_convolutions_run_along_x_then_y_then_z():
    unit = OrientationEncoding(1)
    for axis, weights in zip(unit.axes, ([1.0, 10.0], [1.0, 100.0], [1.0, 1000.0]), strict=True):
        torch.nn.init.zeros_(axis.bias)
        axis.weight.data = torch.tensor([weights])
    unit.norm = torch.nn.Identity()
    values = torch.eye(9)[:, :1] * 0  # own value 0
    for octant in range(8):
        values = torch.zeros(9, 1)
        values[octant + 1] = 1.0
        near = torch.cat([torch.arange(1, 9)[None], torch.zeros(8, 8, dtype=torch.long)])
        expected = 10.0 ** (bool(octant & 4) + 2 * bool(octant & 2) + 3 * bool(octant & 1))
        assert unit(values, near)[0].item() == expected


def test_backbone_sees_as_far_as_it_says_and_no_farther():
    torch.manual_seed(0)
    backbone = PointSIFTBackbone(2, 8, (1.0, 2.0)).double()
    xyz = torch.rand(300, 3, dtype=torch.float64) * torch.tensor([12.0, 2, 2])
    inputs = torch.randn(300, 2, dtype=torch.float64)
    whole = backbone(xyz, inputs, torch.tensor([0, 300]))
    core = (xyz[:, 0] < 4).nonzero()[:, 0]
    seen = (xyz[:, 0] < 4 + backbone.reach).nonzero()[:, 0]
    part = backbone(xyz[seen], inputs[seen], torch.tensor([0, len(seen)]))
    torch.testing.assert_close(part[torch.isin(seen, core)], whole[core])
    changed = inputs.clone()
    changed[(xyz[:, 0] > 6)] += 1
    assert not torch.equal(backbone(xyz, changed, torch.tensor([0, 300]))[xyz[:, 0] > 4], whole[xyz[:, 0] > 4])


def test_scenes_of_a_batch_do_not_meet_and_order_does_not_matter():
    torch.manual_seed(0)
    backbone = PointSIFTBackbone(1, 4, (2.0,)).double()
    xyz, inputs = torch.rand(40, 3, dtype=torch.float64), torch.randn(40, 1, dtype=torch.float64)
    both = backbone(torch.cat([xyz, xyz]), torch.cat([inputs, inputs]), torch.tensor([0, 40, 80]))
    torch.testing.assert_close(both[:40], backbone(xyz, inputs, torch.tensor([0, 40])))
    torch.testing.assert_close(both[:40], both[40:])
    order = torch.randperm(40)
    mixed = backbone(xyz[order], inputs[order], torch.tensor([0, 40]))
    torch.testing.assert_close(mixed, both[:40][order])
    with pytest.raises(ValueError, match='radii'):
        PointSIFTBackbone(1, 4, ())


def test_gradients():
    torch.manual_seed(0)
    unit = OrientationEncoding(3).double()
    values = torch.randn(5, 3, dtype=torch.float64, requires_grad=True)
    near = torch.randint(5, (5, 8))
    assert torch.autograd.gradcheck(lambda rows: unit(rows, near), (values,))
