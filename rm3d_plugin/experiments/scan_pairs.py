"""Pairs of overlapping scans, cut from one scan, so that the true motion between them is known."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.descriptors.base import virtual_viewpoint
from rm3d_plugin.experiments.poses import POSES, Pose, pose_turn
from rm3d_plugin.experiments.scenes import described_surface, turned
from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.ops.rigid_fit import move
from rm3d_plugin.structures import PointCloud

OVERLAP = (0.3, 0.7)  # share of each cut that is in the other, too
KEPT = (0.5, 1.0)  # share of its points that a cut keeps
ROOM_UNIT = 0.025  # m; the voxel at which matches within 10 cm and motions within 20 cm count (3DMatch)
NOISE, INLIER, REGISTERED = 0.2, 4.0, 8.0  # units: 5 mm, 10 cm and 20 cm in rooms


class ScanPair(NamedTuple):
    """Two overlapping cuts of one scan, each with points and noise of its own.

    Attributes:
        source: In the frame of the scan.
        targets: The other cut in each pose.
        motions: Pose -> (4, 4) from the source's frame to the target's.
        shared: Numbers of the source's points that have a target point near their true place.
        unit: Metres; see :func:`length_unit`.
    """

    source: PointCloud
    targets: dict[Pose, PointCloud]
    motions: dict[Pose, Float[np.ndarray, '4 4']]
    shared: Int[np.ndarray, ' shared']
    unit: float


def length_unit(cloud: PointCloud, preset: str) -> float:
    """The length in which matches are judged, metres: 2.5 cm in rooms, else the scan's median point spacing."""
    if preset == 'indoor':
        return ROOM_UNIT
    xyz = cloud.xyz.astype(np.float64)
    return float(np.sqrt(np.median(Octree(xyz).knn(xyz, 2).sq_dists[:, 1])))


def cut_pair(cloud: PointCloud, unit: float, seed: tuple[int, ...]) -> ScanPair:
    """Cut a scan along a random horizontal direction into two overlapping ones; the second is turned into each pose.

    Normals of both turn to the viewpoint of the scan.

    Args:
        cloud: A scan.
        unit: Metres; the standard deviation of the noise is a fifth of it.
        seed: Draws overlap, direction, which points stay, noise and turns.
    """
    rng = np.random.default_rng(seed)
    share, angle = 1 / (2 - rng.uniform(*OVERLAP)), rng.uniform(0, 2 * np.pi)
    order = np.argsort(cloud.xyz[:, :2] @ [np.cos(angle), np.sin(angle)], kind='stable')
    count = round(share * len(cloud))
    viewpoint = cloud.sensor if cloud.sensor is not None else tuple(virtual_viewpoint(cloud.xyz).tolist())
    seen = replace(cloud, sensor=viewpoint, normals=None, curvature=None)
    source, target = (_sampled(seen.select(np.sort(part)), unit, rng) for part in (order[:count], order[-count:]))
    turns = {pose: pose_turn(pose, seed) for pose in POSES}
    gaps = Octree(target.xyz).knn(source.xyz.astype(np.float64), 1).sq_dists[:, 0]
    return ScanPair(
        described_surface(source),
        {pose: turned(target, turn) for pose, turn in turns.items()},
        {pose: _about_origin(turn) for pose, turn in turns.items()},
        np.flatnonzero(gaps <= (INLIER * unit) ** 2),
        unit,
    )


def true_places(pair: ScanPair, pose: Pose) -> Float[np.ndarray, 'points 3']:
    """Where the source's points are in the target's frame, metres."""
    return move(pair.motions[pose], pair.source.xyz.astype(np.float64))


def _sampled(cut: PointCloud, unit: float, rng: np.random.Generator) -> PointCloud:
    rows = np.sort(rng.permutation(len(cut))[: max(1, round(rng.uniform(*KEPT) * len(cut)))])
    kept = cut.select(rows)
    return replace(kept, xyz=(kept.xyz + rng.normal(0.0, NOISE * unit, kept.xyz.shape)).astype(np.float32))


def _about_origin(turn: Float[np.ndarray, '3 3']) -> Float[np.ndarray, '4 4']:
    motion = np.eye(4)
    motion[:3, :3] = turn
    return motion
