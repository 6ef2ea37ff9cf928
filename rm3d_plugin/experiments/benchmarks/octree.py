"""Neighbours of all points of a room: our octree beside scipy, nanoflann and two octrees in C++; each rule apart."""

import argparse
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numba
import numpy as np
from scipy.spatial import cKDTree

from rm3d_plugin.experiments.benchmarks import clouds
from rm3d_plugin.experiments.benchmarks.measure import Seconds, interleaved_medians, machine, table
from rm3d_plugin.experiments.benchmarks.peers import ABSENT, PclPeer, pcl_program
from rm3d_plugin.ops.octree import Octree

NAME = 'octree'
HELP = 'radius search for all points, sort and build included'
CPP = {'nanoflann': 'nanoflann', 'pcl_octree': 'octree', 'linked_octree': 'linked-octree'}
ONE = '_one_thread'
RULES = {
    'none': (False, False, False),
    'skip_disjoint': (True, False, False),
    'stop_inside': (False, True, False),
    'take_contained': (False, False, True),
    'all': (True, True, True),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the benchmark."""
    clouds.add_arguments(parser, 1_000_000)
    parser.add_argument('--leaf-size', type=int, default=32, help='of our octree and of the linked octree')
    parser.add_argument('--rule-queries', type=int, default=100, help='queries the rules are switched for, or 0')
    parser.add_argument('--skip', nargs='*', default=[], help='jobs to leave out')


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Seconds of each program, whether all found the same, and the effect of each rule."""
    room = clouds.from_arguments(args)
    counts: dict[str, np.ndarray] = {}
    with tempfile.TemporaryDirectory() as folder:
        jobs = {name: job for name, job in _jobs(room, args, counts, Path(folder)).items() if name not in args.skip}
        Octree(room.xyz[:5000]).radius(room.xyz[:5000], room.radius, ordered=False)  # loads the compiled kernels
        seconds = interleaved_medians(jobs, args.repeats, warm=False)
    expected = counts['rm3d']
    return {
        'points': args.points,
        'point_order': args.order,
        'query_order': 'that of the points; ours answers along its own curve',
        'radius_m': room.radius,
        'neighbors': round(float(expected.mean()), 3),
        'leaf_size': {'rm3d': args.leaf_size, 'linked_octree': 32, 'pcl_octree': 'edge = radius', 'nanoflann': 10},
        'threads': {'rm3d': args.threads, 'rm3d_all_kept': args.threads, 'others': 1},
        'seconds': table(seconds, 'rm3d'),
        'gain_of_threads': _gain(seconds),
        'absent': [] if pcl_program() else [f'{name}: {ABSENT}' for name in CPP],
        # Float32 programs may take or leave a point that lies on the ball's surface to rounding.
        'rows_that_differ': {name: int((found != expected).sum()) for name, found in counts.items()},
        'rules': rules(room, args.rule_queries, args.leaf_size) if args.rule_queries else {},
        'machine': machine(),
    }


def _jobs(
    room: clouds.Room, args: argparse.Namespace, counts: dict[str, np.ndarray], folder: Path
) -> dict[str, Callable[[], object]]:
    xyz, radius = room.xyz, room.radius
    peer = PclPeer(xyz, None, folder)

    def ours() -> None:
        tree, found = Octree(xyz, args.leaf_size), np.empty(len(xyz), dtype=np.int64)
        for rows, near in tree.around(radius, ordered=False):
            found[rows] = near.counts
        counts['rm3d'] = found

    def ours_kept() -> None:
        counts['rm3d_all_kept'] = Octree(xyz, args.leaf_size).radius(xyz, radius, ordered=False).counts

    def scipy_lists() -> None:
        found = cKDTree(xyz).query_ball_point(xyz, radius, workers=1)
        counts['scipy_lists'] = np.fromiter(map(len, found), dtype=np.int64, count=len(xyz))

    def program(name: str, job: str) -> Seconds:
        answer = peer.run(job, radius)
        counts[name] = answer.values
        return answer.seconds

    jobs: dict[str, Callable[[], object]] = {'rm3d': ours, 'rm3d_all_kept': ours_kept, 'scipy_lists': scipy_lists}
    if args.threads > 1:
        jobs |= {f'{name}{ONE}': _with_one_thread(job) for name, job in jobs.items() if name.startswith('rm3d')}
    if pcl_program() is not None:
        jobs |= {name: lambda name=name, job=job: program(name, job) for name, job in CPP.items()}  # type: ignore[misc]
    return jobs


def _with_one_thread(job: Callable[[], object]) -> Callable[[], None]:
    def alone() -> None:
        threads, numba.config.NUMBA_NUM_THREADS = numba.config.NUMBA_NUM_THREADS, 1
        try:
            job()
        finally:
            numba.config.NUMBA_NUM_THREADS = threads

    return alone


def _gain(seconds: Mapping[str, Seconds]) -> dict[str, float]:
    """Wall time of one thread over that of several; tells of threads where the cores were free."""
    return {
        name.removesuffix(ONE): round(found.wall / seconds[name.removesuffix(ONE)].wall, 2)
        for name, found in seconds.items()
        if name.endswith(ONE)
    }


def rules(room: clouds.Room, queries: int, leaf_size: int) -> dict[str, dict[str, float]]:
    """Octants that a query visits and microseconds it takes, each rule alone, all, and all with queries in groups."""
    out = {}
    step = max(len(room.xyz) // queries, 1)
    for name, (skip, stop, take) in RULES.items():
        tree = Octree(room.xyz, leaf_size, skip_disjoint=skip, stop_inside=stop, take_contained=take, group=False)
        out[name] = _effect(tree, room.xyz[::step], room.radius)
    tree = Octree(room.xyz, leaf_size, group=False)
    out['all, every point'] = _effect(tree, room.xyz, room.radius)
    out['all, every point, in groups'] = _effect(Octree(room.xyz, leaf_size), room.xyz, room.radius)
    return out


def _effect(tree: Octree, queries: np.ndarray, radius: float) -> dict[str, float]:
    tree.radius(queries[:2], radius, ordered=False)
    begin = time.process_time()
    visits = tree.radius(queries, radius, ordered=False).visits
    spent = time.process_time() - begin
    return {'visits': round(visits / len(queries), 2), 'microseconds': round(1e6 * spent / len(queries), 3)}
