"""The whole geometry path of a scene (normals, adapted PFH, regions, graph): seconds, memory, growth with size."""

import argparse
import resource
import time
from typing import Any

import numpy as np

from rm3d_plugin.experiments.benchmarks import clouds
from rm3d_plugin.experiments.benchmarks.measure import in_own_process, machine

NAME = 'prepare'
HELP = 'normals, adapted PFH, regions and graph of scenes of several sizes, each in a process of its own'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the benchmark."""
    parser.add_argument('--sizes', type=int, nargs='+', default=[100_000, 300_000, 1_000_000], help='points of a scene')


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Each size by itself; the exponent is the slope of log cost over log size (N log N: about 1.07)."""
    scenes = [in_own_process(__name__, 'one', args.threads, [size]) for size in args.sizes]
    logs = np.log([[scene['points'], scene['cpu_s']] for scene in scenes])
    exponent = round(float(np.polyfit(logs[:, 0], logs[:, 1], 1)[0]), 3) if len(scenes) > 1 else None
    return {'scenes': scenes, 'exponent': exponent, 'threads': args.threads, 'machine': machine()}


def one(points: int) -> dict[str, Any]:
    """Prepare one scene in this process."""
    from rm3d_plugin.descriptors import AdaptedPFH
    from rm3d_plugin.oversegmentation import RegionGrowing
    from rm3d_plugin.regions.prepare import prepare_scene
    from rm3d_plugin.structures import PointCloud

    room = clouds.room(points)
    descriptor = AdaptedPFH(radius=room.radius, max_neighbors=48)
    segmenter = RegionGrowing()
    prepare_scene(PointCloud(room.xyz[:2000]), descriptor, segmenter)  # loads the compiled kernels
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    wall, cpu = time.perf_counter(), time.process_time()
    scene = prepare_scene(PointCloud(room.xyz), descriptor, segmenter)
    return {
        'points': points,
        'neighbors': round(room.neighbors, 2),
        'wall_s': round(time.perf_counter() - wall, 3),
        'cpu_s': round(time.process_time() - cpu, 3),
        'peak_rss_gib': round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20, 3),
        'rss_before_gib': round(before / 2**20, 3),
        'regions': len(scene.regions),
        'edges': len(scene.graph.edges),
    }
