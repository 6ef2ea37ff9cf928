"""Dropping points while everything that counts points stays in step."""

from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.ops.ground import segment_ground
from rm3d_plugin.registry import TRANSFORMS

Shape = Literal['sphere', 'column', 'box']
# arrays with one row a point
POINT_FIELDS = (
    'points', 'point_index', 'semantic', 'instance', 'is_annotated', 'confidence', 'is_ground', 'ground_height',
    'region',
)  # fmt: skip


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


def crop_rows(
    xyz: Float[np.ndarray, 'points 3'], center: Float[np.ndarray, '3'], max_points: int, shape: Shape
) -> Int[np.ndarray, ' kept']:
    """The ``max_points`` rows nearest to a centre, ascending; equal distances by row.

    Args:
        xyz: Metres.
        center: Metres.
        max_points: Rows to keep; all where there are fewer.
        shape: What grows around the centre until it holds enough: a 'sphere', an upright 'column' (distance seen from
            above, floor to ceiling), or a 'box' (upright, square).
    """
    gap = np.abs(xyz.astype(np.float64) - center)
    if shape == 'box':
        distance = gap[:, :2].max(axis=1)
    else:
        distance = np.square(gap[:, : 3 if shape == 'sphere' else 2]).sum(axis=1)
    if max_points >= len(distance):
        return np.arange(len(distance))
    last = np.partition(distance, max_points - 1)[max_points - 1]  # faster than to sort them all
    nearer, ties = np.flatnonzero(distance < last), np.flatnonzero(distance == last)
    return np.sort(np.concatenate([nearer, ties[: max_points - len(nearer)]]))


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

    Those that stay keep their ``ground_height``, metres above the ground, where no earlier transform segmented it.
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
            ground, height = segment_ground(results['points'][:, :3], iterations=self.iterations, **self.options)
            results = results | {'ground_height': height}
        return results if ground.all() else select_points(results, ~ground)
