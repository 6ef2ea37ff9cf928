"""Streets with their ground: it becomes square patches, and another over-segmenter splits what stands on it."""

from collections.abc import Mapping
from typing import Any, final

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.ops.ground import segment_ground
from rm3d_plugin.oversegmentation.base import Oversegmenter, seeds_among
from rm3d_plugin.registry import OVERSEGMENTERS
from rm3d_plugin.structures import Descriptors, PointCloud


def square_patches(xyz: Float[np.ndarray, 'points 3'], cell: float) -> Int[np.ndarray, ' points']:
    """Number of each point's cell in a horizontal grid aligned to the coordinates' zero; 0, 1, ... without gaps.

    >>> square_patches(np.array([[0.1, 0, 0], [1.2, 0, 0], [0.9, 0.9, 5]]), 1.0)
    array([0, 1, 0])
    """
    cells = np.floor(np.asarray(xyz[:, :2], dtype=np.float64) / cell).astype(np.int64)
    return np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64)


@OVERSEGMENTERS.register_module()
@final
class GroundPatches(Oversegmenter):
    """Ground in square patches, the rest by another over-segmenter.

    Grown regions leak from the ground into what stands on it, and one region of all the ground would take a single
    class; where road, pavement and grass differ, patches bound the damage. How far apart points lie does not matter.

    Args:
        cell: Metres; edge of a patch. Larger: labels reach farther, patches are less pure.
        rest: Config of the over-segmenter for all points but the ground; it is asked to keep what it is given.
        surface: Options of :func:`rm3d_plugin.ops.ground.segment_ground`.

    Raises:
        ValueError: ``cell`` is not positive, or ``rest`` takes ground away itself.
    """

    def __init__(self, cell: float, rest: Mapping[str, Any], surface: Mapping[str, Any] | None = None) -> None:
        super().__init__()
        if not cell > 0:
            raise ValueError(f'GroundPatches: expected cell > 0 (metres), got {cell}')
        self.cell, self.surface = float(cell), dict(surface or {})
        self.rest: Oversegmenter = OVERSEGMENTERS.build(dict(rest))
        if self.rest.ground is not None:
            raise ValueError(
                'GroundPatches.rest: expected an over-segmenter with ground=None; the ground is not for it'
            )

    def partition(
        self,
        cloud: PointCloud,
        descriptors: Descriptors,
        seeds: Int[np.ndarray, ' seeds'] | None = None,
        scene: str = '',
    ) -> Int[np.ndarray, ' points']:
        """Find the ground, cut it up, and hand on the others."""
        labels = np.full(len(cloud), -1, dtype=np.int64)
        is_ground = segment_ground(cloud.xyz, **self.surface).is_ground
        labels[is_ground] = square_patches(cloud.xyz[is_ground], self.cell)
        others = np.flatnonzero(~is_ground)
        found = self.rest.partition(
            cloud.select(others),
            descriptors.select(others),
            seeds_among(seeds, others, len(cloud)),
            scene,
        )
        labels[others] = np.where(found >= 0, found + labels.max(initial=-1) + 1, -1)
        return labels
