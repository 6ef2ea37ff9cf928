"""How linear, planar, scattered and upright the surroundings of a point are, as further columns of the points."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float

from rm3d_plugin.datasets.transforms.recent import RecentArrays
from rm3d_plugin.ops.geometric_features import geometric_features
from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.registry import TRANSFORMS
from rm3d_plugin.storage.files import content_key
from rm3d_plugin.storage.scene_cache import SceneCache

NEIGHBORS = (16, 64)  # a small and a wide look
CACHE_VERSION = 1  # raise it when the values change


def shape_columns(
    xyz: Float[np.ndarray, 'points 3'], neighbors: Sequence[int] = NEIGHBORS
) -> Float[np.ndarray, 'points columns']:
    """Four columns in [0, 1] for each number of neighbours, zero where there are too few points.

    Args:
        xyz: (n, 3) metres, z up.
        neighbors: How many nearest points each look takes in.
    """
    tree = Octree(xyz)
    return np.concatenate([geometric_features(xyz, k, tree).values for k in neighbors], axis=1)


@TRANSFORMS.register_module()
class ShapeFeatures:
    """Appends ``shape`` columns (:class:`~rm3d_plugin.models.segmentors.PointInputs`) behind those the points have.

    A small network, or one that sees little training, need not find out itself what a pole or a leaf looks like from
    nearby. Belongs before any crop, and behind what changes colours. Moves of the scene leave the values as they are.

    Args:
        neighbors: Two numbers of nearest points.
        cache: Folder where the values of a scene are kept, by the content of its points; None: nowhere.
        recent: Scenes whose values stay in memory. Larger: more memory; data sets of as many scenes are read once.
    """

    column: ClassVar[str] = 'shape'

    def __init__(self, neighbors: Sequence[int] = NEIGHBORS, cache: str | Path | None = None, recent: int = 16) -> None:
        if len(neighbors) != 2 or min(neighbors) < 3:
            raise ValueError(f'ShapeFeatures.neighbors: expected two numbers from 3, got {list(neighbors)}')
        self.neighbors = tuple(int(k) for k in neighbors)
        self.cache = None if cache is None else SceneCache(cache)
        self._recent = RecentArrays.shared(content_key('shape', list(self.neighbors), cache), recent)

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Compute or read, then append.

        Raises:
            ValueError: An augmented view was already taken.
        """
        if 'views' in results:
            raise ValueError('ShapeFeatures: expected AugmentedView behind it')
        points = results['points']
        xyz = np.ascontiguousarray(points[:, :3])
        values = self._recent.get_or_make(xyz, lambda: self._values(xyz))
        return results | {'points': np.concatenate([points, values.astype(points.dtype)], axis=1)}

    def _values(self, xyz: Float[np.ndarray, 'points 3']) -> Float[np.ndarray, 'points columns']:
        if self.cache is None:
            return shape_columns(xyz, self.neighbors)
        key = content_key('shape', CACHE_VERSION, [xyz], list(self.neighbors))
        return self.cache.get_or_make(key, lambda: {'values': shape_columns(xyz, self.neighbors)})['values']
