"""Transforms of streets."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from rm3d_plugin.ops.ground import segment_ground
from rm3d_plugin.registry import TRANSFORMS


def level_ground(
    points: Float[np.ndarray, 'points channels'], options: Mapping[str, Any] | None = None
) -> Float[np.ndarray, 'points channels']:
    """The scene with its ground pulled flat: z becomes the height above the ground below (negative under it).

    Upright things stay upright, so poles and facades keep their shape; what changes is the slope of the street.

    Args:
        points: (n, 3 + channels), metres, z up; channels stay.
        options: Of :func:`~rm3d_plugin.ops.ground.segment_ground`.
    """
    out = points.copy()
    out[:, 2] = segment_ground(points[:, :3], **(options or {})).height
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

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Find the ground, then level it.

        Raises:
            ValueError: The scene has boxes, which would no longer fit, or an augmented view was already taken.
        """
        if len(results.get('boxes', ())) or 'aug_points' in results:
            raise ValueError('LevelGround: expected a scene without boxes, and AugmentedView behind it')
        return results | {'points': level_ground(results['points'], self.options)}
