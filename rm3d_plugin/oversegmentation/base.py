"""What every over-segmenter has in common: ground goes first, the rest is partitioned, labels are scattered back."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, final

import numpy as np
from jaxtyping import Bool, Int

from rm3d_plugin.ops.ground import segment_ground
from rm3d_plugin.ops.segment import scatter_rows
from rm3d_plugin.storage.fingerprint import Fingerprinted
from rm3d_plugin.structures import Descriptors, PointCloud, Regions


class Oversegmenter(Fingerprinted, ABC):
    """Splits a scene into regions (METHOD 5).

    A subclass says how to :meth:`partition` points; taking the ground away first is the same for all.

    Args:
        ground: Options of :func:`rm3d_plugin.ops.ground.segment_ground`; ground points get the label -1. None keeps the
            ground.
        scene_files: Path of a file that is read for each scene, with ``{scene}`` for its name; None: no file is read.
    """

    def __init__(self, ground: Mapping[str, Any] | None = None, scene_files: str | None = None) -> None:
        self.ground = None if ground is None else dict(ground)
        self.scene_files = scene_files

    @abstractmethod
    def partition(
        self,
        cloud: PointCloud,
        descriptors: Descriptors,
        seeds: Int[np.ndarray, ' seeds'] | None = None,
        scene: str = '',
    ) -> Int[np.ndarray, ' points']:
        """Label every point of a cloud that holds no unwanted ground; -1 = discarded.

        Args:
            cloud: The points; normals and curvature are used where present.
            descriptors: One row a point.
            seeds: Point numbers of labelled points, or None.
            scene: Name of the scene; names its file, where one is read.
        """

    @final
    def scene_file(self, scene: str) -> Path | None:
        """The file that is read for a scene, or None."""
        return None if self.scene_files is None else Path(self.scene_files.format(scene=scene))

    @final
    def find_ground(self, cloud: PointCloud) -> Bool[np.ndarray, ' points']:
        """Points that :meth:`segment` discards as ground; none where ground is kept."""
        if self.ground is None:
            return np.zeros(len(cloud), dtype=np.bool_)
        return segment_ground(cloud.xyz, **self.ground).is_ground

    @final
    def segment(
        self,
        cloud: PointCloud,
        descriptors: Descriptors,
        seeds: Int[np.ndarray, ' seeds'] | None = None,
        scene: str = '',
    ) -> Regions:
        """Regions of the whole cloud.

        Raises:
            ValueError: The descriptors are not one a point, or a seed is not a point number.
        """
        if len(descriptors) != len(cloud):
            raise ValueError(f'segment: expected {len(cloud)} descriptors (one a point), got {len(descriptors)}')
        kept = np.flatnonzero(~self.find_ground(cloud))
        labels = self.partition(
            cloud.select(kept), descriptors.select(kept), seeds_among(seeds, kept, len(cloud)), scene
        )
        return Regions(scatter_rows(np.asarray(labels, dtype=np.int64), kept, len(cloud), fill=-1))


def seeds_among(
    seeds: Int[np.ndarray, ' seeds'] | None, kept: Int[np.ndarray, ' kept'], total: int
) -> Int[np.ndarray, ' kept_seeds'] | None:
    """Seeds of a cloud as numbers of its kept points; those that were not kept fall away.

    Args:
        seeds: Point numbers, or None.
        kept: Point numbers, ascending.
        total: Points of the whole cloud.

    Raises:
        ValueError: A seed is not a point number.
    """
    if seeds is None:
        return None
    given = np.asarray(seeds, dtype=np.int64).reshape(-1)
    if len(given) and (given.min() < 0 or given.max() >= total):
        raise ValueError(f'seeds: expected point numbers 0..{total - 1}, got {given.min()}..{given.max()}')
    number = np.full(total, -1, dtype=np.int64)
    number[kept] = np.arange(len(kept))
    return number[given][number[given] >= 0]
