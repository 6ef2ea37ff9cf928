"""Dropping points while everything that counts points stays in step."""

from typing import Any

import numpy as np
from jaxtyping import Int

from rm3d_plugin.ops.ground import segment_ground
from rm3d_plugin.registry import TRANSFORMS

# arrays with one row a point
POINT_FIELDS = ('points', 'point_index', 'semantic', 'instance', 'is_annotated', 'confidence', 'is_ground', 'region')


def select_points(results: dict[str, Any], index: np.ndarray) -> dict[str, Any]:
    """Keep the points that ``index`` (integers or a boolean mask) names, in that order, in every per-point field.

    Raises:
        ValueError: An augmented view was already taken, whose rows would no longer fit.
    """
    if 'views' in results:
        raise ValueError('points cannot be dropped after AugmentedView; move AugmentedView behind this transform')
    return results | {name: results[name][index] for name in POINT_FIELDS if name in results}


def random_subset(count: int, kept: int, rng: np.random.Generator) -> Int[np.ndarray, ' kept']:
    """``min(kept, count)`` different row numbers below ``count``, ascending."""
    if kept >= count:
        return np.arange(count)
    return np.sort(rng.choice(count, size=kept, replace=False))


@TRANSFORMS.register_module()
class LimitPoints:
    """Keep a random subset where a scene has more points than memory allows.

    Args:
        max_points: Most points to keep.
    """

    def __init__(self, max_points: int) -> None:
        if max_points < 1:
            raise ValueError(f'LimitPoints: max_points must be at least 1, got {max_points}')
        self.max_points = max_points

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Choose by the item's generator."""
        count = len(results['points'])
        if count <= self.max_points:
            return results
        return select_points(results, random_subset(count, self.max_points, results['rng']))


@TRANSFORMS.register_module()
class DropGround:
    """Drop ground points (METHOD 7: outdoors, ground dropped); ``point_index`` tells which stay.

    A scene that is nothing but ground keeps all its points, since a network cannot take an empty one.

    Args:
        cell: See :func:`segment_ground`, as all others.
        max_height: Metres.
        max_slope: Rise over run.
        iterations: Refits.
    """

    def __init__(self, cell: float = 1.0, max_height: float = 0.2, max_slope: float = 0.3, iterations: int = 3) -> None:
        self.options = {'cell': cell, 'max_height': max_height, 'max_slope': max_slope}
        self.iterations = iterations

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Segment (where an earlier transform did not), then select."""
        ground = results.get('is_ground')
        if ground is None:
            ground = segment_ground(results['points'][:, :3], iterations=self.iterations, **self.options).is_ground
        return results if ground.all() else select_points(results, ~ground)
