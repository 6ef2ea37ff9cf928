"""Sparse convolution against dense convolution, finite differences and hand-worked cases."""

import itertools
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from reference.sparse_conv_slow import neighbours_slowly
from torch.nn import functional as F

from rm3d_plugin.ops._gather_gemm import BLOCK_ROWS, PART_ROWS
from rm3d_plugin.ops.kernel_map import KernelSpec, VoxelLevel, _pairs_searched, triple
from rm3d_plugin.ops.sparse_conv import (
    _forward,
    _forward_plain,
    _weight_grad,
    _weight_grad_plain,
    sparse_conv,
)
from rm3d_plugin.ops.voxelize import COORDINATE_LIMIT, pack_coords

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


@pytest.mark.parametrize(('kernel', 'stride', 'dilation'), CASES[::3])
def test_map_equals_a_dictionary_of_voxels(kernel, stride, dilation):
    level = random_level(0.3)
    spec = KernelSpec(kernel, stride, dilation)
    target = level.coarser(stride)
    kernel_map = level.kernel_map(spec)
    got = [
        list(zip(kernel_map.pair_in[a:b].tolist(), kernel_map.pair_out[a:b].tolist(), strict=True))
        for a, b in itertools.pairwise(kernel_map.starts.tolist())
    ]
    assert got == neighbours_slowly(level.coords, target.coords, spec.offsets(), stride)
    cells = {(b, *(c // s for c, s in zip(cell, stride, strict=True))) for b, *cell in level.coords.tolist()}
    assert [tuple(c) for c in target.coords.tolist()] == sorted(cells)


@pytest.mark.parametrize(('kernel', 'stride', 'dilation'), CASES[::3])
def test_search_for_other_devices_finds_the_same_pairs(kernel, stride, dilation):
    level = random_level(0.3)
    spec = KernelSpec(kernel, stride, dilation)
    kernel_map = level.kernel_map(spec)
    anchors = pack_coords(level.coarser(stride).coords * torch.tensor([1, *stride]))
    deltas = [(x * 2**17 + y) * 2**17 + z for x, y, z in spec.offsets()]
    pair_in, pair_out, counts = _pairs_searched(pack_coords(level.coords), anchors, deltas)
    assert torch.equal(pair_in, kernel_map.pair_in) and torch.equal(pair_out, kernel_map.pair_out)
    assert counts == np.diff(kernel_map.starts).tolist()


@pytest.mark.parametrize('channels', [(1, 1), (3, 20), (7, 16), (16, 48), (33, 64), (64, 112)])
@pytest.mark.parametrize('dtype', [torch.float32, torch.float64])
def test_kernels_equal_plain_torch(channels, dtype):
    torch.manual_seed(2)
    kernel_map = random_level(0.4, side=12).kernel_map(KernelSpec((3, 3, 3)))
    values, grad = (torch.randn(kernel_map.n_in, c, dtype=dtype) for c in channels)
    weight = torch.randn(27, *channels, dtype=dtype)
    close = dict(atol=2e-4, rtol=1e-4) if dtype == torch.float32 else dict(atol=1e-11, rtol=1e-11)
    assert len(values) > BLOCK_ROWS
    torch.testing.assert_close(
        _forward(values, weight, kernel_map), _forward_plain(values, weight, kernel_map), **close
    )
    torch.testing.assert_close(
        _weight_grad(values, grad, kernel_map), _weight_grad_plain(values, grad, kernel_map), **close
    )


def test_the_tiles_of_other_processors_give_the_same_bits(tmp_path):
    code = """if True:
        import sys
        import torch
        from llvmlite import binding
        binding.get_host_cpu_features = dict
        torch.set_num_threads(1)
        from rm3d_plugin.ops import _gather_gemm as kernels
        from rm3d_plugin.ops.kernel_map import KernelSpec, VoxelLevel
        assert kernels._ROWS_4 == 1
        saved = torch.load(sys.argv[1], weights_only=True)
        kernel_map = VoxelLevel(saved['coords']).kernel_map(KernelSpec((3, 3, 3)))
        pairs = kernel_map.pair_in.numpy(), kernel_map.pair_out.numpy(), kernel_map.starts
        x, weight = saved['x'].numpy(), saved['weight'].numpy()
        out = kernels.gather_gemm(x, weight, *pairs, len(x))
        torch.save([torch.from_numpy(a) for a in (out, kernels.gather_outer(x, out, *pairs))], sys.argv[2])
    """
    torch.manual_seed(6)
    level = random_level(0.4)
    values, weight = torch.randn(len(level), 10), torch.randn(27, 10, 112)
    given, made = tmp_path / 'given.pt', tmp_path / 'made.pt'
    torch.save(dict(coords=level.coords, x=values, weight=weight), given)
    names = dict(NUMBA_CPU_NAME='haswell', NUMBA_CPU_FEATURES='+avx2,+fma', NUMBA_CACHE_DIR=str(tmp_path))
    command = [sys.executable, '-c', code, str(given), str(made)]
    subprocess.run(command, env=os.environ | names, check=True, cwd=Path(__file__).parents[2])
    kernel_map = level.kernel_map(KernelSpec((3, 3, 3)))
    out, grad = torch.load(made, weights_only=True)
    wanted = _forward(values, weight, kernel_map)
    assert torch.equal(out, wanted)
    assert torch.equal(grad, _weight_grad(values, wanted, kernel_map))


def test_same_bits_for_every_number_of_threads():
    torch.manual_seed(3)
    level = random_level(0.35, side=40)
    kernel_map = level.kernel_map(KernelSpec((3, 3, 3)))
    values, weight = torch.randn(len(level), 20), torch.randn(27, 20, 24)
    assert len(level) > 2 * PART_ROWS
    results = []
    try:
        for threads in (1, 2, 3, 1):
            torch.set_num_threads(threads)
            out = _forward(values, weight, kernel_map)
            results.append((out, _weight_grad(values, out, kernel_map)))
    finally:
        torch.set_num_threads(1)
    for out, grad in results[1:]:
        assert torch.equal(out, results[0][0]) and torch.equal(grad, results[0][1])


def test_half_precision_takes_the_plain_path():
    torch.manual_seed(4)
    kernel_map = random_level(0.4).kernel_map(KernelSpec((3, 3, 3)))
    values, weight = torch.randn(kernel_map.n_in, 4), torch.randn(27, 4, 4)
    got = sparse_conv(values.bfloat16(), weight.bfloat16(), kernel_map)
    torch.testing.assert_close(got.float(), sparse_conv(values, weight, kernel_map), atol=0.5, rtol=0.05)


def test_single_voxel_and_none():
    weight = torch.randn(27, 2, 3)
    alone = VoxelLevel(torch.tensor([[0, 5, -7, 9]])).kernel_map(KernelSpec((3, 3, 3)))
    torch.testing.assert_close(sparse_conv(torch.ones(1, 2), weight, alone), weight[13].sum(0)[None])
    empty = VoxelLevel(torch.zeros(0, 4, dtype=torch.int64))
    strided = empty.kernel_map(KernelSpec((2, 2, 2), (2, 2, 2)))
    features = torch.zeros(0, 2, requires_grad=True)
    out = sparse_conv(features, torch.randn(8, 2, 3), strided)
    out.sum().backward()
    assert out.shape == (0, 3) and features.grad.shape == (0, 2)


def test_voxels_at_the_edge_of_the_range_do_not_wrap_around():
    limit = COORDINATE_LIMIT
    level = VoxelLevel(torch.tensor([[0, 0, -limit, limit], [0, 0, -limit + 1, -limit], [0, 0, limit, limit]]))
    kernel_map = level.kernel_map(KernelSpec((3, 3, 3)))
    assert kernel_map.starts[-1] == 3  # each meets itself alone


@pytest.mark.parametrize(
    ('call', 'message'),
    [
        (lambda: VoxelLevel(torch.zeros(2, 4, dtype=torch.int64)), 'unique and sorted'),
        (lambda: VoxelLevel(torch.zeros(2, 4)), 'int64'),
        (lambda: VoxelLevel(torch.tensor([[0, 70000, 0, 0]])), 'stay within'),
        (lambda: random_level(0.5).kernel_map(KernelSpec((3, 3, 3), dilation=(1, 1, 600))), 'reaches at most'),
        (lambda: triple((1, 2), 'stride'), 'stride must be'),
        (lambda: triple(0, 'kernel_size'), 'kernel_size must be'),
    ],
)
def test_bad_levels_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_bad_shapes_are_named():
    kernel_map = random_level(0.5).kernel_map(KernelSpec((3, 3, 3)))
    with pytest.raises(ValueError, match='27 offsets'):
        sparse_conv(torch.ones(kernel_map.n_in, 2), torch.ones(8, 2, 2), kernel_map)
    with pytest.raises(ValueError, match='input voxels'):
        sparse_conv(torch.ones(1, 2), torch.ones(27, 2, 2), kernel_map)
