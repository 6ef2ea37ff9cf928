"""Every descriptor, learned ones too, of all points of one room with its normals: seconds and memory."""

import argparse
import resource
import time
from typing import Any

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments.benchmarks import clouds
from rm3d_plugin.experiments.benchmarks.measure import in_own_process, machine
from rm3d_plugin.experiments.compared_descriptors import compared_descriptors, named_descriptors

NAME = 'describe'
HELP = 'every descriptor of all points of a room, with the indoor preset, each in a process of its own'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the benchmark."""
    parser.add_argument('--points', type=int, default=100_000, help='points of the room')
    parser.add_argument('--descriptors', nargs='+', metavar='NAME', help='some of them; default: all')


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Seconds and peak memory by descriptor.

    Raises:
        ConfigError: A name is not a descriptor that works at once.
    """
    names = args.descriptors or compared_descriptors()
    if unknown := sorted(set(names) - set(named_descriptors())):
        raise ConfigError(f'--descriptors: expected some of {", ".join(named_descriptors())}; got {", ".join(unknown)}')
    found = {name: in_own_process(__name__, 'one', args.threads, [name, args.points]) for name in names}
    return {'points': args.points, 'descriptors': found, 'threads': args.threads, 'machine': machine()}


def one(name: str, points: int) -> dict[str, Any]:
    """Describe one room in this process, once compiled kernels, weights and normals are there."""
    from rm3d_plugin.experiments.scenes import described_surface
    from rm3d_plugin.inference.oversegment import build_part
    from rm3d_plugin.registry import DESCRIPTORS
    from rm3d_plugin.structures import PointCloud

    def cloud(rows: int) -> PointCloud:
        return described_surface(PointCloud(clouds.room(rows).xyz))

    part = build_part(DESCRIPTORS, name, 'indoor', {})
    part.compute(cloud(2000))
    room = cloud(points)
    wall, cpu = time.perf_counter(), time.process_time()
    described = part.compute(room)
    return {
        'wall_s': round(time.perf_counter() - wall, 2),
        'cpu_s': round(time.process_time() - cpu, 2),
        'peak_rss_gib': round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20, 2),
        'values': described.values.shape[1],
        'described': round(float(described.valid.mean()), 4),
    }
