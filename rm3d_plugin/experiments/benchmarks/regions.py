"""Region growing and supervoxels beside PCL's, neighbours included."""

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from rm3d_plugin.experiments.benchmarks import clouds
from rm3d_plugin.experiments.benchmarks.measure import Seconds, interleaved_medians, machine, table
from rm3d_plugin.experiments.benchmarks.peers import ABSENT, PclPeer, pcl_program
from rm3d_plugin.ops.normals import estimate_normals
from rm3d_plugin.oversegmentation import VCCS, Oversegmenter, RegionGrowing
from rm3d_plugin.structures import Descriptors, PointCloud

NEIGHBORS = 30
VOXELS_A_SEED = 6
WARM = 3000  # points that kernels are compiled and loaded with


class RegionBenchmark:
    """One over-segmenter here and in PCL; both get the same normals, neither a descriptor.

    Args:
        name: Of the command, and of the job of the C++ program.
        help_text: What the command measures.
        build: The over-segmenter for a voxel edge in metres.
    """

    def __init__(self, name: str, help_text: str, build: Callable[[float], Oversegmenter]) -> None:
        self.NAME, self.HELP, self._build = name, help_text, build

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Options of the benchmark."""
        clouds.add_arguments(parser, 1_000_000)
        parser.add_argument('--voxel', type=float, default=0.05, help='edge of a voxel in metres (vccs)')

    def run(self, args: argparse.Namespace) -> dict[str, Any]:
        """Seconds and numbers of regions."""
        room = clouds.from_arguments(args)
        estimate = estimate_normals(room.xyz, NEIGHBORS)
        cloud = PointCloud(room.xyz, normals=estimate.normals, curvature=estimate.curvature)
        segmenter, regions = self._build(args.voxel), {}

        def ours(some: PointCloud = cloud) -> None:
            none = Descriptors(np.zeros((len(some), 1), dtype=np.float32), np.zeros(len(some), dtype=np.bool_))
            regions['rm3d'] = len(np.unique(segmenter.partition(some, none)))

        def pcl() -> Seconds:
            given = (args.voxel, VOXELS_A_SEED) if self.NAME == 'vccs' else (0.0, NEIGHBORS)
            answer = peer.run(self.NAME, *given)
            regions['pcl'] = len(np.unique(answer.values))
            return answer.seconds

        ours(cloud.select(np.arange(min(WARM, len(cloud)))))
        jobs: dict[str, Callable[[], object]] = {'rm3d': ours}
        with tempfile.TemporaryDirectory() as folder:
            if pcl_program() is not None:
                peer = PclPeer(room.xyz, estimate.normals, Path(folder))
                jobs['pcl'] = pcl
            seconds = interleaved_medians(jobs, args.repeats, warm=False)
        return {
            'points': args.points,
            'point_order': args.order,
            'neighbors': NEIGHBORS,
            'threads': {'rm3d': args.threads, 'pcl': 1},
            'seconds': table(seconds, 'rm3d'),
            'regions': regions,
            'absent': [] if pcl_program() else [f'pcl: {ABSENT}'],
            'machine': machine(),
        }


ALL = (
    RegionBenchmark(
        'region-growing',
        'region growing with 30 neighbours, their search included',
        lambda _: RegionGrowing(neighbors=NEIGHBORS),
    ),
    RegionBenchmark(
        'vccs',
        'supervoxels with the distance of PCL',
        lambda voxel: VCCS(voxel, VOXELS_A_SEED * voxel, distance='pcl'),
    ),
)
