"""Sparse convolution against dense convolution, finite differences and hand-worked cases."""

import itertools

import pytest
import torch
from torch.nn import functional as F

from rm3d_plugin.ops.kernel_map import KernelSpec, VoxelLevel
from rm3d_plugin.ops.sparse_conv import sparse_conv

CASES = [
    *[((k, k, k), (s, s, s), (d, d, d)) for k in (1, 2, 3, 5) for s in (1, 2, 3) for d in (1, 2)],
    ((3, 1, 2), (1, 2, 1), (1, 1, 2)),
    ((1, 3, 5), (2, 1, 3), (3, 2, 1)),
]


def random_level(share, batch=2, side=6, low=-3, seed=0):
    generator = torch.Generator().manual_seed(seed)
    axis = torch.arange(low, low + side)
    grid = torch.cartesian_prod(torch.arange(batch), axis, axis, axis)
    return VoxelLevel(grid[torch.rand(len(grid), generator=generator) < share])


def to_dense(values, coords, low, shape, batch=2):
    dense = values.new_zeros((batch, *shape, values.shape[1]))
    b, x, y, z = (coords - torch.tensor([0, *low])).unbind(1)
    dense[b, x, y, z] = values
    return dense.permute(0, 4, 1, 2, 3)


def from_dense(dense, coords, low):
    b, x, y, z = (coords - torch.tensor([0, *low])).unbind(1)
    return dense.permute(0, 2, 3, 4, 1)[b, x, y, z]


def dense_weight(weight, kernel):
    return weight.view(*kernel, *weight.shape[1:]).permute(4, 3, 0, 1, 2)


@pytest.mark.parametrize('share', [1.0, 0.3])
@pytest.mark.parametrize(('kernel', 'stride', 'dilation'), CASES)
def test_equals_dense_convolution(kernel, stride, dilation, share):
    torch.manual_seed(1)
    level = random_level(share, low=-6, side=12) if share < 1 else random_level(1.1, low=0)
    first = -6 if share < 1 else 0
    side = 12 if share < 1 else 6
    spec = KernelSpec(kernel, stride, dilation)
    target = level.coarser(stride)
    values = torch.randn(len(level), 4, requires_grad=True)
    weight = torch.randn(len(spec.offsets()), 4, 5, requires_grad=True)
    got = sparse_conv(values, weight, level.kernel_map(spec))

    dense = to_dense(values, level.coords, [first] * 3, [side] * 3)
    lo = [d * (k // 2 if k % 2 else 0) for k, d in zip(kernel, dilation, strict=True)]
    hi = [d * (k - 1) - p for k, d, p in zip(kernel, dilation, lo, strict=True)]
    padding = [p for pair in reversed(list(zip(lo, hi, strict=True))) for p in pair]
    wanted = F.conv3d(F.pad(dense, padding), dense_weight(weight, kernel), stride=stride, dilation=dilation)
    wanted = from_dense(wanted, target.coords, [first // s for s in stride])
    torch.testing.assert_close(got, wanted, atol=1e-5, rtol=1e-5)

    direction = torch.randn_like(got)
    grads = torch.autograd.grad((got * direction).sum(), [values, weight])
    expected = torch.autograd.grad((wanted * direction).sum(), [values, weight])
    torch.testing.assert_close(grads, expected, atol=1e-4, rtol=1e-4)


def test_submanifold_keeps_its_coordinates():
    level = random_level(0.2)
    assert level.coarser((1, 1, 1)) is level
    assert level.kernel_map(KernelSpec((3, 3, 3))).n_out == len(level)


@pytest.mark.parametrize(('kernel', 'stride'), list(itertools.product([2, 3], [1, 2])))
def test_gradcheck(kernel, stride):
    torch.manual_seed(0)
    level = random_level(0.3, batch=1, side=4)
    spec = KernelSpec((kernel,) * 3, (stride,) * 3)
    kernel_map = level.kernel_map(spec)
    values = torch.randn(len(level), 2, dtype=torch.float64, requires_grad=True)
    weight = torch.randn(kernel**3, 2, 3, dtype=torch.float64, requires_grad=True)
    bias = torch.randn(3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda v, w, b: sparse_conv(v, w, kernel_map, b), (values, weight, bias))
    coarse = torch.randn(kernel_map.n_out, 2, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda v, w: sparse_conv(v, w, kernel_map.transposed()), (coarse, weight))
