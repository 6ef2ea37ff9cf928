"""Normals and histogram descriptors of a room's points beside PCL and Open3D; search included, same neighbourhoods."""

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rm3d_plugin.descriptors.adapted_pfh import adapted_pfh
from rm3d_plugin.descriptors.fpfh import fpfh
from rm3d_plugin.descriptors.shot import shot
from rm3d_plugin.experiments.benchmarks import clouds
from rm3d_plugin.experiments.benchmarks.measure import Seconds, interleaved_medians, machine, table
from rm3d_plugin.experiments.benchmarks.peers import ABSENT, PclPeer, optional, pcl_program
from rm3d_plugin.ops.normals import estimate_normals

NORMAL_NEIGHBORS = 30


class Scene(NamedTuple):
    """A room with its normals."""

    xyz: np.ndarray
    radius: float
    normals: np.ndarray


Job = Callable[[Scene], np.ndarray]


class DescriptorBenchmark:
    """One descriptor in all programs.

    Args:
        name: Of the command, and of the job of the C++ program.
        help_text: What the command measures.
        ours: Gives one row a point.
        open3d: The same by Open3D, or None where it has no such thing.
        scale: PCL's rows are so many times ours.
        as_open3d: Ours again, untimed, where Open3D's definition differs.
    """

    def __init__(
        self,
        name: str,
        help_text: str,
        ours: Job,
        open3d: Job | None,
        scale: float = 1.0,
        as_open3d: Job | None = None,
    ) -> None:
        self.NAME, self.HELP = name, help_text
        self._ours, self._open3d, self._scale, self._as_open3d = ours, open3d, scale, as_open3d

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Options of the benchmark."""
        clouds.add_arguments(parser)

    def run(self, args: argparse.Namespace) -> dict[str, Any]:
        """Seconds of each program, and how far their values are apart."""
        room = clouds.from_arguments(args)
        scene = Scene(room.xyz, room.radius, estimate_normals(room.xyz, NORMAL_NEIGHBORS).normals)
        rows: dict[str, np.ndarray] = {}
        with tempfile.TemporaryDirectory() as folder:
            jobs, absent = self._jobs(scene, rows, Path(folder))
            self._ours(Scene(scene.xyz[:500], scene.radius, scene.normals[:500]))
            seconds = interleaved_medians(jobs, args.repeats, warm=False)
        pairs = args.points * room.neighbors * (room.neighbors - 1) / 2
        return {
            'points': args.points,
            'point_order': args.order,
            'radius_m': room.radius,
            'neighbors': round(room.neighbors, 2),
            'threads': {'rm3d': args.threads, 'pcl': 1, 'open3d': 'its own choice; see cpu_s'},
            'seconds': table(seconds, 'rm3d'),
            'pairs_per_cpu_second': round(pairs / seconds['rm3d'].cpu),
            'absent': absent,
            'share_of_equal_rows': self._agreements(scene, rows),
            'machine': machine(),
        }

    def _agreements(self, scene: Scene, rows: dict[str, np.ndarray]) -> dict[str, float]:
        ours = rows.pop('rm3d')
        own = {'open3d': self._as_open3d(scene)} if self._as_open3d and 'open3d' in rows else {}
        return {name: agreement(own.get(name, ours), found) for name, found in rows.items()}

    def _jobs(
        self, scene: Scene, rows: dict[str, np.ndarray], folder: Path
    ) -> tuple[dict[str, Callable[[], object]], list[str]]:
        def ours() -> None:
            rows['rm3d'] = self._ours(scene)

        def pcl() -> Seconds:
            answer = peer.run(self.NAME, scene.radius, NORMAL_NEIGHBORS, np.float32)
            rows['pcl'] = answer.values.reshape(len(scene.xyz), -1) / self._scale
            return answer.seconds

        def open3d() -> None:
            assert self._open3d is not None
            rows['open3d'] = self._open3d(scene)

        jobs: dict[str, Callable[[], object]] = {'rm3d': ours}
        absent = []
        if pcl_program() is not None:
            peer = PclPeer(scene.xyz, scene.normals, folder)
            jobs['pcl'] = pcl
        else:
            absent.append(f'pcl: {ABSENT}')
        if self._open3d is not None and optional('open3d') is not None:
            jobs['open3d'] = open3d
        elif self._open3d is not None:
            absent.append(f'open3d: {ABSENT}')
        return jobs, absent


def agreement(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Share of rows that are equal to one per cent of their length, either sign."""
    size = np.linalg.norm(ours, axis=1)
    apart = np.minimum(np.linalg.norm(ours - theirs, axis=1), np.linalg.norm(ours + theirs, axis=1))
    return round(float((apart <= 0.01 * size + 1e-6).mean()), 4)


def _open3d_cloud(scene: Scene, with_normals: bool = True) -> Any:
    o3d: Any = optional('open3d')

    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(scene.xyz))
    if with_normals:
        cloud.point.normals = o3d.core.Tensor(scene.normals)
    return cloud


def _open3d_normals(scene: Scene) -> np.ndarray:
    cloud = _open3d_cloud(scene, False)
    cloud.estimate_normals(max_nn=NORMAL_NEIGHBORS)
    return np.asarray(cloud.point.normals.numpy())


def _open3d_fpfh(scene: Scene) -> np.ndarray:
    o3d: Any = optional('open3d')

    cloud = _open3d_cloud(scene)
    rows = o3d.t.pipelines.registration.compute_fpfh_feature(cloud, radius=scene.radius, max_nn=None)
    return np.asarray(rows.numpy())


ALL = (
    DescriptorBenchmark(
        'normals',
        'normals and curvature from the 30 nearest points',
        lambda scene: estimate_normals(scene.xyz, NORMAL_NEIGHBORS).normals,
        _open3d_normals,
    ),
    DescriptorBenchmark(
        'pfh',
        'adapted PFH (125 bins, as PCL)',
        lambda scene: adapted_pfh(scene.xyz, scene.normals, scene.radius, None).values,
        None,
        100.0,
    ),
    DescriptorBenchmark(
        'fpfh',
        'FPFH',
        lambda scene: fpfh(scene.xyz, scene.normals, scene.radius).values,
        _open3d_fpfh,
        as_open3d=lambda scene: fpfh(scene.xyz, scene.normals, scene.radius, own_spfh=True).values,
    ),
    DescriptorBenchmark(
        'shot', 'SHOT-352', lambda scene: shot(scene.xyz, scene.normals, scene.radius, 'l2').values, None
    ),
)
