"""Compilation on first use: the geometry path on a small scene, with an empty and then with a filled cache."""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from typing import Any

from rm3d_plugin.experiments.benchmarks.measure import machine

NAME = 'first-call'
HELP = 'seconds that the first run of the geometry path spends in compiling its kernels'
CHILD = f'from {__name__} import geometry; geometry()'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the benchmark."""
    parser.add_argument('--scene', type=int, default=5000, help='points')
    parser.set_defaults(repeats=1)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Wall and processor seconds of a fresh process, both times; the difference is the compiler's."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, 'NUMBA_CACHE_DIR': cache, 'PYTHONPATH': os.pathsep.join(sys.path)}
        environment['RM3D_BENCH_POINTS'] = str(args.scene)
        empty, filled = _timed(environment), _timed(environment)
    return {
        'points': args.scene,
        'empty_cache': empty,
        'filled_cache': filled,
        'compile_cpu_s': round(empty['cpu_s'] - filled['cpu_s'], 2),
        'machine': machine(),
    }


def _timed(environment: dict[str, str]) -> dict[str, float]:
    wall, cpu = time.perf_counter(), sum(os.times()[2:4])
    subprocess.run([sys.executable, '-c', CHILD], env=environment, check=True)
    return {'wall_s': round(time.perf_counter() - wall, 2), 'cpu_s': round(sum(os.times()[2:4]) - cpu, 2)}


def geometry() -> None:
    """Prepare a room once with each histogram descriptor and over-segmenter."""
    from rm3d_plugin.descriptors import FPFH, SHOT, AdaptedPFH
    from rm3d_plugin.experiments.benchmarks.clouds import room
    from rm3d_plugin.oversegmentation import VCCS, RegionGrowing
    from rm3d_plugin.regions.prepare import prepare_scene
    from rm3d_plugin.structures import PointCloud

    cloud = PointCloud(room(int(os.environ['RM3D_BENCH_POINTS'])).xyz)
    prepare_scene(cloud, AdaptedPFH(radius=0.3), RegionGrowing())
    prepare_scene(cloud, FPFH(radius=0.3), VCCS(0.2, 1.0))
    SHOT(radius=0.3).compute(cloud)
