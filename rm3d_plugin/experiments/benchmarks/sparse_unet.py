"""Sparse U-Net on the surface voxels of a synthetic room, beside the rate of plain matrix products."""

import argparse
import importlib.util
from typing import Any

import torch

from rm3d_plugin.experiments.benchmarks.measure import interleaved_medians, machine, matrix_product
from rm3d_plugin.models.backbones.layers import InverseConv, SparseConv, SparseFeatures
from rm3d_plugin.models.backbones.sparse_unet import SparseUNet
from rm3d_plugin.ops._parallel import set_threads
from rm3d_plugin.ops.kernel_map import KernelSpec, VoxelLevel
from rm3d_plugin.ops.sparse_conv import sparse_conv
from rm3d_plugin.ops.voxelize import voxelize

NAME = 'sparse-unet'
HELP = 'forward and backward of the sparse U-Net'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the benchmark."""
    parser.add_argument('--voxels', type=int, default=50000, help='non-empty voxels, met to one per cent')
    parser.add_argument('--channels', type=int, nargs='+', default=[32, 64, 96, 128], help='width of each level')
    parser.add_argument('--blocks', type=int, default=2, help='residual blocks a level and side')
    parser.add_argument('--backward', action='store_true', help='time forward + backward too')


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Median seconds, operations and rates."""
    set_threads(args.threads)
    torch.manual_seed(0)
    xyz = room_voxels(args.voxels)
    features, offsets = torch.rand(len(xyz), 4), torch.tensor([0, len(xyz)])
    net = SparseUNet(4, 1.0, args.channels, args.blocks, map_cache=0)
    operations = count_operations(net, xyz, features, offsets)
    product, product_operations = matrix_product()
    level = VoxelLevel(voxelize(xyz, features, offsets, 1.0).coords)
    spec = KernelSpec((3, 3, 3))

    conv_map, conv_rows, conv_weight = level.kernel_map(spec), torch.rand(len(level), 32), torch.rand(27, 32, 32)

    def conv() -> torch.Tensor:
        with torch.no_grad():
            return sparse_conv(conv_rows, conv_weight, conv_map)

    def forward() -> torch.Tensor:
        with torch.no_grad():
            return net(xyz, features, offsets)

    def forward_backward() -> None:
        net.zero_grad()
        net(xyz, features, offsets).square().mean().backward()

    jobs: dict[str, Any] = {
        'forward_s': forward,
        'conv_s': conv,
        'kernel_map_s': lambda: VoxelLevel(level.coords).kernel_map(spec),
        'kernel_maps_s': lambda: all_maps(level.coords, len(args.channels)),
    }
    if args.backward:
        jobs['forward_backward_s'] = forward_backward
    jobs['product'] = product
    if importlib.util.find_spec('spconv') is not None:
        from rm3d_plugin.experiments.benchmarks.spconv_unet import jobs as spconv_jobs

        jobs |= spconv_jobs(level.coords, features, args.channels, args.blocks, args.backward, conv_rows)
    seconds = interleaved_medians(jobs, args.repeats)
    rate = product_operations / seconds.pop('product').cpu
    result = {
        'voxels': len(level),
        'active_neighbours': round(int(level.kernel_map(spec).starts[-1]) / len(level), 2),
        'channels': args.channels,
        'parameters': sum(p.numel() for p in net.parameters()),
        'flops': operations,
        'gemm_gflops': rate / 1e9,
        **{name: measured.wall for name, measured in seconds.items()},
        **{name.removesuffix('_s') + '_cpu_s': measured.cpu for name, measured in seconds.items()},
        'forward_share_of_gemm': operations / seconds['forward_s'].cpu / rate,
        'machine': machine(),
    }
    if args.backward:
        total = 3 * operations  # backward: as much again for the inputs' gradient, and for the weights'
        result['forward_backward_flops'] = total
        result['kernel_maps_share'] = seconds['kernel_maps_s'].cpu / seconds['forward_backward_s'].cpu
        result['forward_backward_share_of_gemm'] = total / seconds['forward_backward_s'].cpu / rate
    return result


def all_maps(coords: torch.Tensor, levels: int) -> VoxelLevel:
    """Every level of a U-Net with every map that its layers ask for."""
    first = level = VoxelLevel(coords)
    for depth in range(levels):
        level.kernel_map(KernelSpec((3, 3, 3)))
        level.kernel_map(KernelSpec((1, 1, 1)))  # where blocks change their width
        if depth + 1 < levels:
            level.kernel_map(KernelSpec((2, 2, 2), (2, 2, 2)))
            level = level.coarser((2, 2, 2))
    return first


def room_voxels(count: int) -> torch.Tensor:
    """Centres, in voxel edges, of about ``count`` voxels: a noisy furnished room, turned by 20 degrees."""
    generator = torch.Generator().manual_seed(0)
    boxes = torch.tensor([[6.0, 5.0, 2.7], *[[1.2, 0.7, 0.75]] * 4, *[[0.5, 0.5, 0.9]] * 8])
    places = torch.cat([torch.zeros(1, 3), torch.rand(12, 3, generator=generator) * torch.tensor([4.5, 4.0, 0.0])])
    points = 30 * count
    area = torch.stack([boxes[:, i] * boxes[:, (i + 1) % 3] for i in range(3)], dim=1).repeat_interleave(2, dim=1)
    faces = torch.multinomial(area.flatten(), points, replacement=True, generator=generator)
    box, face = faces // 6, faces % 6
    inside = torch.rand(points, 3, generator=generator)
    normal = (face // 2 + 2) % 3
    inside[torch.arange(points), normal] = (face % 2).float()
    xyz = places[box] + inside * boxes[box] + torch.randn(points, 3, generator=generator) * 0.004
    turn = torch.tensor([[0.9397, -0.3420, 0.0], [0.3420, 0.9397, 0.0], [0.0, 0.0, 1.0]])
    xyz, low, high = xyz @ turn, 0.001, 10.0
    offsets = torch.tensor([0, points])
    for _ in range(40):
        edge = (low * high) ** 0.5
        coords = voxelize(xyz, xyz, offsets, edge).coords
        if abs(len(coords) - count) <= 0.01 * count:
            break
        low, high = (edge, high) if len(coords) > count else (low, edge)
    return coords[:, 1:].float() + 0.5


def count_operations(net: SparseUNet, *batch: torch.Tensor) -> float:
    """Multiplications and additions of all convolutions of a forward pass, over existing pairs only."""
    total = 0.0

    def convolution(module: torch.nn.Module, inputs: tuple[Any, ...], _: SparseFeatures) -> None:
        nonlocal total
        assert isinstance(module, SparseConv | InverseConv)
        level = inputs[1] if isinstance(module, InverseConv) else inputs[0].level
        pairs = int(level.kernel_map(module.spec).starts[-1])
        total += 2.0 * pairs * module.weight.shape[1] * module.weight.shape[2]

    hooks = [m.register_forward_hook(convolution) for m in net.modules() if isinstance(m, SparseConv | InverseConv)]
    with torch.no_grad():
        net(*batch)
    for hook in hooks:
        hook.remove()
    return total
