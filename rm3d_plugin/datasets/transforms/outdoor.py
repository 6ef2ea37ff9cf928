"""Transforms of streets."""

from typing import Any

import numpy as np
from jaxtyping import Float

from rm3d_plugin.datasets.transforms.recent import RecentArrays
from rm3d_plugin.ops.ground import segment_ground
from rm3d_plugin.registry import TRANSFORMS


def with_heights(
    points: Float[np.ndarray, 'points channels'], heights: Float[np.ndarray, ' points']
) -> Float[np.ndarray, 'points channels']:
    """The scene with its ground pulled flat: z becomes the height above the ground below (negative under it).

    Upright things stay upright, so poles and facades keep their shape; what changes is the slope of the street.

    Args:
        points: (n, 3 + channels), metres, z up; channels stay.
        heights: Metres.
    """
    out = points.copy()
    out[:, 2] = heights
    return out


@TRANSFORMS.register_module()
class LevelGround:
    """Measure heights from the ground; belongs before any crop, since a whole scene shows its ground best.

    What the network is asked for (classes of points) does not depend on where they lie. Shifted points
    (``pred_point_centers``) are then told in the levelled scene.

    Args:
        options: Of :func:`~rm3d_plugin.ops.ground.segment_ground`.
    """

    def __init__(self, **options: Any) -> None:
        self.options = options
        self._recent = RecentArrays()

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Find the ground, then level it.

        Raises:
            ValueError: The scene has boxes, which would no longer fit, or an augmented view was already taken.
        """
        if len(results.get('boxes', ())) or 'aug_points' in results:
            raise ValueError('LevelGround: expected a scene without boxes, and AugmentedView behind it')
        xyz = np.ascontiguousarray(results['points'][:, :3])
        heights = self._recent.get_or_make(xyz, lambda: segment_ground(xyz, **self.options).height)
        return results | {'points': with_heights(results['points'], heights)}
