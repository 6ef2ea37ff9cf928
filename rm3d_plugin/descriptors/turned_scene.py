"""A descriptor that sees every scene turned: what is left of it where scans have no common pose."""

import zlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, final, get_args

import numpy as np

from rm3d_plugin.descriptors.base import Descriptor
from rm3d_plugin.ops.turns import TurnKind, random_turn
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import Descriptors, PointCloud


@DESCRIPTORS.register_module()
@final
class TurnedScene(Descriptor):
    """Another descriptor of the same points, computed on the scene after a random turn about its local origin.

    The sensor and the normals turn along; points keep their order, so that everything else sees the scene as scanned.
    For measuring how much a method owes to the pose of its scans.

    Args:
        base: Config of the descriptor.
        kind: 'z', or 'so3' about an axis of random direction; by 0 to 180 degrees.
        seed: Draws the turn of each scene, together with its name.

    Raises:
        ValueError: There is no such kind of turn.
    """

    def __init__(self, base: Mapping[str, Any], kind: TurnKind = 'so3', seed: int = 0) -> None:
        if kind not in get_args(TurnKind):
            raise ValueError(f'TurnedScene.kind: expected one of {get_args(TurnKind)}, got {kind!r}')
        self.base: Descriptor = DESCRIPTORS.build(dict(base))
        self.kind: TurnKind = kind
        self.seed = seed
        self._given, self._scene = dict(base), ''

    def for_scene(self, scene: str) -> 'TurnedScene':
        """The same with the turn of a scene."""
        out = TurnedScene(self._given, self.kind, self.seed)
        out.base, out._scene = self.base.for_scene(scene), scene
        return out

    def scene_file(self, scene: str) -> Path | None:
        """That of the other descriptor."""
        return self.base.scene_file(scene)

    def compute(self, cloud: PointCloud) -> Descriptors:
        """Turn the cloud, then describe it."""
        turn = random_turn(self.kind, np.random.default_rng([self.seed, zlib.crc32(self._scene.encode())]))
        moved: dict[str, Any] = {'xyz': (cloud.xyz.astype(np.float64) @ turn.T).astype(np.float32)}
        if cloud.sensor is not None:
            moved['sensor'] = turn @ np.asarray(cloud.sensor, dtype=np.float64)
        if cloud.normals is not None:
            moved['normals'] = (cloud.normals.astype(np.float64) @ turn.T).astype(np.float32)
        return self.base.compute(replace(cloud, **moved))
