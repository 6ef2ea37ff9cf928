"""A training step of the sparse U-Net with Adam, on one synthetic room at several sizes."""

import argparse
from typing import Any

import torch

from benchmarks.measure import forget_peak, interleaved_medians, machine, memory_mb
from benchmarks.sparse_unet import all_maps, room_voxels
from rm3d_plugin.datasets.synthetic.rooms import make_room
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


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Seconds of a step, voxels a second and peak memory for the demo room and for each size."""
    set_threads(args.threads)
    room = make_room(0, 0)
    scenes = {'room': (torch.from_numpy(room.xyz), args.voxel_size)}
    scenes |= {str(count): (room_voxels(count), 1.0) for count in args.voxels}
    rows = {name: _measure(xyz, edge, args) for name, (xyz, edge) in scenes.items()}
    return {'preset': args.preset, 'checkpointing': args.checkpointing, **rows, 'machine': machine()}


def _measure(xyz: torch.Tensor, voxel_size: float, args: argparse.Namespace) -> dict[str, float | None]:
    torch.manual_seed(0)
    net = SparseUNet(3, voxel_size, preset=args.preset, checkpointing=args.checkpointing, map_cache=0)
    head = torch.nn.Linear(net.out_channels, CLASSES)
    optimizer = torch.optim.Adam([*net.parameters(), *head.parameters()])
    offsets, labels = torch.tensor([0, len(xyz)]), torch.randint(0, CLASSES, (len(xyz),))
    coords = voxelize(xyz, xyz, offsets, voxel_size).coords

    def step() -> None:
        optimizer.zero_grad()
        torch.nn.functional.cross_entropy(head(net(xyz, xyz, offsets)), labels).backward()
        optimizer.step()

    step()  # compiles
    forget_peak()
    before = memory_mb('VmRSS')
    seconds = interleaved_medians(
        {'step': step, 'maps': lambda: all_maps(coords, len(PRESETS[args.preset]))}, args.repeats
    )
    peak = memory_mb('VmHWM')
    return {
        'points': len(xyz),
        'voxels': len(coords),
        'step_s': seconds['step'].wall,
        'step_cpu_s': seconds['step'].cpu,
        'voxels_per_cpu_s': round(len(coords) / seconds['step'].cpu),
        'kernel_maps_share': seconds['maps'].cpu / seconds['step'].cpu,
        'peak_mb': peak,
        'before_mb': before,
    }
