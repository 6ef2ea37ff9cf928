"""Voxels against a dictionary of cells, hand-worked cases and finite differences."""

import pytest
import torch
from reference.voxelize_slow import voxelize_slowly

from rm3d_plugin.ops.voxelize import (
    COORDINATE_LIMIT,
    gather_rows,
    pack_coords,
    sum_rows,
    unique_rows,
    unpack_coords,
    voxelize,
)


@pytest.mark.parametrize('reduce', ['mean', 'first'])
def test_equals_a_dictionary_of_cells(reduce):
    generator = torch.Generator().manual_seed(0)
    points = torch.rand(300, 3, generator=generator) * 2 - 1
    features = torch.rand(300, 4, generator=generator, dtype=torch.float64)
    offsets = torch.tensor([0, 100, 100, 300])
    got = voxelize(points, features, offsets, 0.25, reduce)
    rows, coords, point_to_voxel = voxelize_slowly(points, features, offsets, 0.25, reduce)
    assert got.coords.tolist() == coords
    assert got.point_to_voxel.tolist() == point_to_voxel
    torch.testing.assert_close(got.features, rows, atol=1e-12, rtol=0)


def test_hand_worked_cells():
    points = torch.tensor([[0.05, 0.0, 0.0], [-0.01, 0.0, 0.0], [0.09, 0.05, 0.0], [0.1, 0.0, 0.0]])
    got = voxelize(points, torch.tensor([[1.0], [2.0], [5.0], [7.0]]), torch.tensor([0, 4]), 0.1)
    assert got.coords.tolist() == [[0, -1, 0, 0], [0, 0, 0, 0], [0, 1, 0, 0]]
    assert got.features.tolist() == [[2.0], [3.0], [7.0]]
    assert got.point_to_voxel.tolist() == [1, 0, 1, 2]


def test_scenes_never_share_a_voxel():
    got = voxelize(torch.zeros(3, 3), torch.arange(3.0)[:, None], torch.tensor([0, 1, 1, 3]), 0.1)
    assert got.coords[:, 0].tolist() == [0, 2]
    assert got.features.tolist() == [[0.0], [1.5]]


def test_no_points():
    got = voxelize(torch.zeros(0, 3), torch.zeros(0, 2), torch.tensor([0, 0]), 0.1)
    assert got.features.shape == (0, 2) and got.coords.shape == (0, 4) and got.point_to_voxel.shape == (0,)


def test_wide_coordinates_are_sorted_like_a_list():
    generator = torch.Generator().manual_seed(1)
    coords = torch.randint(-COORDINATE_LIMIT, COORDINATE_LIMIT, (500, 4), generator=generator)
    coords[:, 0] = torch.randint(0, 3, (500,), generator=generator)
    coords = coords[torch.randint(0, 500, (900,), generator=generator)]
    got = unique_rows(coords)
    assert [tuple(c) for c in got.coords.tolist()] == sorted({tuple(c) for c in coords.tolist()})
    assert torch.equal(got.coords[got.inverse], coords)
    assert got.first.tolist() == [coords.tolist().index(c) for c in got.coords.tolist()]


def test_packing_keeps_values_and_order():
    ends = [-COORDINATE_LIMIT, -1, 0, 1, COORDINATE_LIMIT]
    coords = torch.cartesian_prod(torch.tensor([0, 4095]), *[torch.tensor(ends)] * 3)
    keys = pack_coords(coords)
    assert bool((keys.diff() > 0).all()) and bool((keys >= 0).all())
    assert torch.equal(unpack_coords(keys), coords)


@pytest.mark.parametrize('reduce', ['mean', 'first'])
def test_gradients(reduce):
    points, offsets = torch.rand(12, 3), torch.tensor([0, 5, 12])
    features = torch.rand(12, 2, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda f: voxelize(points, f, offsets, 0.6, reduce).features, (features,))
    index = torch.tensor([3, 3, 0, 1, 3])
    rows = torch.rand(4, 2, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda r: gather_rows(r, index), (rows,))
    picks = torch.rand(5, 2, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda p: sum_rows(p, index, 4), (picks,))


def test_half_precision_takes_the_plain_path():
    rows, index = torch.tensor([[1.0], [2.0], [4.0]]), torch.tensor([2, 0, 2])
    assert sum_rows(rows.bfloat16(), index, 4).tolist() == [[2.0], [0.0], [5.0], [0.0]]


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (dict(points=torch.full((2, 3), float('nan'))), 'point 0 lies at voxel'),
        (dict(points=torch.tensor([[0.0, 0, 0], [6452.0, 0, 0]])), 'point 1 .* local frame'),
        (dict(points=torch.zeros(2, 2)), r'points must be \(N, 3\)'),
        (dict(features=torch.zeros(3, 1)), r'features \(N, C\)'),
        (dict(batch_offsets=torch.tensor([0, 1])), 'batch_offsets must rise'),
        (dict(batch_offsets=torch.tensor([0, 3, 2])), 'batch_offsets must rise'),
        (dict(batch_offsets=torch.tensor([2])), 'batch_offsets must rise'),
        (dict(batch_offsets=torch.cat([torch.zeros(4097, dtype=torch.int64), torch.tensor([2])])), 'at most 4096'),
        (dict(voxel_size=0.0), 'positive length'),
        (dict(reduce='max'), "'mean' or 'first'"),
    ],
)
def test_bad_input_is_named(change, message):
    good = dict(
        points=torch.zeros(2, 3), features=torch.zeros(2, 1), batch_offsets=torch.tensor([0, 2]), voxel_size=0.1
    )
    with pytest.raises(ValueError, match=message):
        voxelize(**(good | change))
