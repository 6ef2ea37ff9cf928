"""The same weights in spconv and in ours; skipped where spconv is not installed (more threads give wrong rows)."""

import pytest
import torch

from rm3d_plugin.models.backbones import SparseUNet
from rm3d_plugin.ops import _backends
from rm3d_plugin.ops.kernel_map import KernelSpec, VoxelLevel
from rm3d_plugin.ops.sparse_conv import sparse_conv

needs_spconv = pytest.mark.skipif(not _backends.has_spconv(), reason='spconv is not installed')


def test_a_backend_that_is_not_there_is_refused(monkeypatch):
    monkeypatch.setattr(_backends, 'has_spconv', lambda: False)
    _backends.check_backend('ours')
    with pytest.raises(ImportError, match='spconv is not installed'):
        _backends.check_backend('spconv')
    with pytest.raises(ValueError, match="'ours', 'spconv'"):
        _backends.check_backend('minkowski')


def test_padded_pairs():
    level = VoxelLevel(torch.tensor([[0, 0, 0, 0], [0, 0, 0, 1], [0, 0, 0, 3]]))
    pairs, counts = level.kernel_map(KernelSpec((1, 1, 3))).padded_pairs
    assert counts.tolist() == [1, 3, 1]
    assert pairs.tolist() == [[[0, -1, -1], [0, 1, 2], [1, -1, -1]], [[1, -1, -1], [0, 1, 2], [0, -1, -1]]]


@needs_spconv
@pytest.mark.filterwarnings('ignore')
@pytest.mark.parametrize('transposed', [False, True])
@pytest.mark.parametrize(('kernel', 'stride', 'dilation'), [(3, 1, 1), (2, 2, 1), (3, 2, 1), (3, 1, 2), (1, 1, 1)])
def test_equals_spconv_on_one_thread(kernel, stride, dilation, transposed):
    torch.set_num_threads(1)
    torch.manual_seed(0)
    axis = torch.arange(-6, 6)
    grid = torch.cartesian_prod(torch.arange(2), axis, axis, axis)
    level = VoxelLevel(grid[torch.rand(len(grid)) < 0.3])
    spec = KernelSpec((kernel,) * 3, (stride,) * 3, (dilation,) * 3)
    kernel_map = level.kernel_map(spec).transposed() if transposed else level.kernel_map(spec)
    x = torch.randn(kernel_map.n_in, 16, requires_grad=True)
    weight = torch.randn(kernel**3, 16, 32).mul(0.1).requires_grad_()
    results = []
    for backend in ('ours', 'spconv'):
        out = sparse_conv(x, weight, kernel_map, backend=backend)
        direction = torch.randn(out.shape, generator=torch.Generator().manual_seed(1))
        results.append([out, *torch.autograd.grad((out * direction).sum(), [x, weight])])
    torch.testing.assert_close(*results, atol=1e-4, rtol=1e-4)


@needs_spconv
@pytest.mark.filterwarnings('ignore')
def test_a_network_of_one_backend_loads_in_the_other():
    xyz = torch.rand(800, 3, generator=torch.Generator().manual_seed(0))
    nets = [SparseUNet(3, 0.05, (8, 16), blocks=1, backend=backend) for backend in ('ours', 'spconv')]
    nets[1].load_state_dict(nets[0].state_dict())
    outs = [net(xyz, xyz, torch.tensor([0, 800])) for net in nets]
    torch.testing.assert_close(*outs, atol=1e-4, rtol=1e-4)
    for out in outs:
        out.square().sum().backward()
    for ours, theirs in zip(*(net.parameters() for net in nets), strict=True):
        torch.testing.assert_close(ours.grad, theirs.grad, atol=1e-3, rtol=1e-3)
