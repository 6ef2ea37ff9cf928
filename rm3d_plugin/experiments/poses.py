"""Scenes as scanned, turned about z, turned about any axis: what tables of descriptors show beside each other."""

import statistics
from collections.abc import Mapping, Sequence
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from rm3d_plugin.experiments.render import Cell
from rm3d_plugin.experiments.scenes import turned
from rm3d_plugin.ops.turns import random_turn
from rm3d_plugin.structures import PointCloud

Pose = Literal['original', 'z', 'so3']
POSES: tuple[Pose, ...] = get_args(Pose)
TITLES: dict[Pose, str] = {'original': 'as scanned', 'z': 'turned about z', 'so3': 'turned about a random axis'}
HEADING = ' / '.join(TITLES.values())


def pose_turn(pose: Pose, seed: Sequence[int]) -> Float[np.ndarray, '3 3']:
    """Rotation matrix of a pose, by 0 to 180 degrees; the same for a seed."""
    return np.eye(3) if pose == 'original' else random_turn(pose, np.random.default_rng([*seed, POSES.index(pose)]))


def posed(cloud: PointCloud, pose: Pose, seed: Sequence[int]) -> PointCloud:
    """The cloud in a pose; its surface is estimated anew, unless it stays as scanned."""
    return cloud if pose == 'original' else turned(cloud, pose_turn(pose, seed))


def pose_cell(values: Mapping[Pose, Sequence[float]], form: str = '.1f') -> Cell:
    """The mean over the scenes in each pose, with the standard deviation where there are several."""
    return Cell(' / '.join(_spread(values[pose], form) for pose in POSES), tuple(v for p in POSES for v in values[p]))


def _spread(values: Sequence[float], form: str) -> str:
    mean = f'{statistics.fmean(values):{form}}'
    return mean if len(values) < 2 else f'{mean} ± {statistics.stdev(values):{form}}'
