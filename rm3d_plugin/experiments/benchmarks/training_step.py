"""A training step of the sparse U-Net with Adam, on one synthetic room at several sizes."""

import argparse
from typing import Any

import torch

from rm3d_plugin.datasets.synthetic.rooms import make_room
from rm3d_plugin.experiments.benchmarks.measure import forget_peak, interleaved_medians, machine, memory_mb
from rm3d_plugin.experiments.benchmarks.sparse_unet import all_maps, room_voxels
from rm3d_plugin.models.backbones.sparse_unet import PRESETS, SparseUNet
from rm3d_plugin.ops._parallel import set_threads
from rm3d_plugin.ops.voxelize import voxelize

NAME = 'training-step'
HELP = 'forward, backward and step of a preset of the sparse U-Net'
CLASSES = 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the benchmark."""
    parser.add_argument('--preset', choices=sorted(PRESETS), default='small', help='widths of the network')
    parser.add_argument('--voxels', type=int, nargs='*', default=[10000, 100000, 400000], help='sizes beside the room')
    parser.add_argument('--voxel-size', type=float, default=0.05, help='metres, of the demo room')
    parser.add_argument('--checkpointing', action='store_true', help='recompute blocks in backward')
    parser.add_argument('--device', default='cpu', help='cpu, cuda, cuda:1 ...')
    parser.add_argument('--backend', default='ours', help='who multiplies: ours or spconv')


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Seconds of a step, voxels a second and peak memory for the demo room and for each size."""
    set_threads(args.threads)
    room = make_room(0, 0)
    scenes = {'room': (torch.from_numpy(room.xyz), args.voxel_size)}
    scenes |= {str(count): (room_voxels(count), 1.0) for count in args.voxels}
    rows = {name: _measure(xyz, edge, args) for name, (xyz, edge) in scenes.items()}
    chosen = {name: getattr(args, name) for name in ('preset', 'checkpointing', 'device', 'backend')}
    return {**chosen, **rows, 'machine': machine()}


def _measure(xyz: torch.Tensor, voxel_size: float, args: argparse.Namespace) -> dict[str, float | None]:
    torch.manual_seed(0)
    device = torch.device(args.device)
    options = {'preset': args.preset, 'checkpointing': args.checkpointing, 'backend': args.backend, 'map_cache': 0}
    net = SparseUNet(3, voxel_size, **options).to(device)
    head = torch.nn.Linear(net.out_channels, CLASSES).to(device)
    optimizer = torch.optim.Adam([*net.parameters(), *head.parameters()])
    xyz, labels = xyz.to(device), torch.randint(0, CLASSES, (len(xyz),)).to(device)
    offsets = torch.tensor([0, len(xyz)], device=device)
    coords = voxelize(xyz, xyz, offsets, voxel_size).coords

    def step() -> None:
        optimizer.zero_grad()
        torch.nn.functional.cross_entropy(head(net(xyz, xyz, offsets)), labels).backward()
        optimizer.step()
        _wait(device)

    def maps() -> None:
        all_maps(coords, len(PRESETS[args.preset]))
        _wait(device)

    step()  # compiles
    forget_peak()
    before = memory_mb('VmRSS')
    seconds = interleaved_medians({'step': step, 'maps': maps}, args.repeats)
    return {
        'points': len(xyz),
        'voxels': len(coords),
        'step_s': seconds['step'].wall,
        'step_cpu_s': seconds['step'].cpu,
        'voxels_per_cpu_s': round(len(coords) / seconds['step'].cpu),
        'kernel_maps_share': seconds['maps'].cpu / seconds['step'].cpu,
        'peak_mb': memory_mb('VmHWM'),
        'before_mb': before,
        'gpu_peak_mb': round(torch.cuda.max_memory_allocated(device) / 2**20) if device.type == 'cuda' else None,
    }


def _wait(device: torch.device) -> None:
    """Let a GPU finish what was asked of it; otherwise only the asking is timed."""
    if device.type == 'cuda':
        torch.cuda.synchronize(device)
