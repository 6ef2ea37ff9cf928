"""What runs on a GPU gives what the CPU gives; skipped where there is no CUDA."""

import pytest
import torch

from rm3d_plugin.ops._backends import has_spconv
from rm3d_plugin.ops.grouping import ball_query, batch_index
from rm3d_plugin.ops.kernel_map import KernelSpec, VoxelLevel
from rm3d_plugin.ops.sampling import furthest_point_sample
from rm3d_plugin.ops.sparse_conv import sparse_conv
from rm3d_plugin.ops.voxelize import gather_rows, sum_rows, voxelize

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason='no CUDA device')
BACKENDS = [
    'ours',
    pytest.param('spconv', marks=pytest.mark.skipif(not has_spconv(), reason='spconv is not installed')),
]
SPECS = [(3, 1, 1), (2, 2, 1), (3, 2, 1), (3, 1, 2), (1, 1, 1)]


def random_points(count=3000, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(count, 3, generator=generator) * 4 - 2, torch.randn(count, 8, generator=generator)


def random_level(device):
    axis = torch.arange(-6, 6)
    grid = torch.cartesian_prod(torch.arange(2), axis, axis, axis)
    kept = torch.rand(len(grid), generator=torch.Generator().manual_seed(1)) < 0.3
    return VoxelLevel(grid[kept].to(device))


@pytest.mark.parametrize('reduce', ['mean', 'first'])
def test_voxelize(reduce):
    xyz, features = random_points()
    offsets = torch.tensor([0, 1000, 1000, 3000])
    wanted = voxelize(xyz, features, offsets, 0.25, reduce)
    got = voxelize(xyz.cuda(), features.cuda(), offsets.cuda(), 0.25, reduce)
    assert torch.equal(got.coords.cpu(), wanted.coords)
    assert torch.equal(got.point_to_voxel.cpu(), wanted.point_to_voxel)
    torch.testing.assert_close(got.features.cpu(), wanted.features)


def test_rows_are_gathered_and_summed_with_their_gradients():
    _, rows = random_points()
    index = torch.randint(0, 50, (3000,), generator=torch.Generator().manual_seed(2))
    results = []
    for device in ('cpu', 'cuda'):
        values, small = (part.clone().to(device).requires_grad_() for part in (rows, rows[:50]))
        out = sum_rows(values, index.to(device), 50), gather_rows(small, index.to(device))
        grads = torch.autograd.grad(out[0].square().sum() + out[1].pow(3).sum(), [values, small])
        results.append([part.cpu() for part in (*out, *grads)])
    torch.testing.assert_close(*results, atol=1e-3, rtol=1e-4)


@pytest.mark.parametrize('spec', SPECS)
def test_kernel_maps(spec):
    kernel = KernelSpec(*((value,) * 3 for value in spec))
    wanted, got = (random_level(device).kernel_map(kernel) for device in ('cpu', 'cuda'))
    assert torch.equal(got.pair_in.cpu(), wanted.pair_in) and torch.equal(got.pair_out.cpu(), wanted.pair_out)
    assert got.starts.tolist() == wanted.starts.tolist()


@pytest.mark.filterwarnings('ignore')
@pytest.mark.parametrize('backend', BACKENDS)
@pytest.mark.parametrize('transposed', [False, True])
@pytest.mark.parametrize('spec', SPECS)
def test_sparse_convolution_in_double_precision_on_the_cpu(spec, transposed, backend):
    kernel = KernelSpec(*((value,) * 3 for value in spec))
    maps = [random_level(device).kernel_map(kernel) for device in ('cpu', 'cuda')]
    maps = [one.transposed() if transposed else one for one in maps]
    generator = torch.Generator().manual_seed(3)
    x = torch.randn(maps[0].n_in, 16, generator=generator)
    weight = 0.1 * torch.randn(spec[0] ** 3, 16, 32, generator=generator)
    direction = torch.randn(maps[0].n_out, 32, generator=generator)
    results = []
    for device, dtype, own_map in zip(('cpu', 'cuda'), (torch.float64, torch.float32), maps, strict=True):
        inputs = [part.to(device, dtype).requires_grad_() for part in (x, weight)]
        out = sparse_conv(*inputs, own_map, backend='ours' if device == 'cpu' else backend)
        grads = torch.autograd.grad((out * direction.to(device, dtype)).sum(), inputs)
        results.append([part.cpu().float() for part in (out, *grads)])
    for got, wanted in zip(results[1], results[0], strict=True):
        assert float((got - wanted).norm() / wanted.norm()) < 1e-3


def test_balls_and_furthest_points():
    xyz, _ = random_points(2000)
    xyz = (xyz * 16).round() / 16  # ties, and sums that are exact on both
    ends = torch.tensor([0, 500, 2000])
    chosen = furthest_point_sample(xyz, 64)
    assert torch.equal(furthest_point_sample(xyz.cuda(), 64).cpu(), chosen)
    queries, query_ends = xyz[::10], torch.tensor([0, 50, 200])
    wanted = ball_query(xyz, queries, 0.5, 12, ends, query_ends)
    got = ball_query(xyz.cuda(), queries.cuda(), 0.5, 12, ends.cuda(), query_ends.cuda())
    assert torch.equal(got.cpu(), wanted)
    assert torch.equal(batch_index(ends.cuda()).cpu(), batch_index(ends))
