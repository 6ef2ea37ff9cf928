"""Moving a scene as a whole: points and boxes together."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from rm3d_plugin.registry import TRANSFORMS


class Moved(NamedTuple):
    """Points (n, 3 + channels) float32 and boxes (M, 7) float64 after a motion."""

    points: Float[np.ndarray, 'points channels']
    boxes: Float[np.ndarray, 'boxes 7']


def wrap_yaw(yaw: Float[np.ndarray, ' boxes']) -> Float[np.ndarray, ' boxes']:
    """Radians in [-pi, pi); angles that are there already keep their bits."""
    outside = (yaw < -np.pi) | (yaw >= np.pi)
    wrapped = (yaw + np.pi) % (2 * np.pi) - np.pi
    return np.where(outside, np.where(wrapped >= np.pi, -np.pi, wrapped), yaw)


def flip_y(points: Float[np.ndarray, 'points channels'], boxes: Float[np.ndarray, 'boxes 7']) -> Moved:
    """Mirror left and right: y and yaw change their sign.

    >>> flip_y(np.array([[1., 2, 3]]), np.array([[1., 2, 3, 4, 2, 1, .5]])).boxes[0, [1, 6]].tolist()
    [-2.0, -0.5]
    """
    points, boxes = points.copy(), boxes.copy()
    points[:, 1] = -points[:, 1]
    boxes[:, 1] = -boxes[:, 1]
    boxes[:, 6] = wrap_yaw(-boxes[:, 6])
    return Moved(points, boxes)


def rotate_scale(
    points: Float[np.ndarray, 'points channels'], boxes: Float[np.ndarray, 'boxes 7'], angle: float, scale: float
) -> Moved:
    """Turn about z through the origin, then scale from the origin; box sizes scale too.

    Args:
        points: (n, 3 + channels); channels stay.
        boxes: (M, 7).
        angle: Radians, counter-clockwise from above.
        scale: Factor.
    """
    points, boxes = points.copy(), boxes.copy()
    points[:, :3] = turned(points[:, :3], angle) * scale
    boxes[:, :3] = turned(boxes[:, :3], angle) * scale
    boxes[:, 3:6] *= scale
    boxes[:, 6] = wrap_yaw(boxes[:, 6] + angle)
    return Moved(points, boxes)


def turned(xyz: Float[np.ndarray, 'points 3'], angle: float) -> Float[np.ndarray, 'points 3']:
    """Turn about z by ``angle`` radians; float64."""
    x, y, z = np.asarray(xyz, dtype=np.float64).T
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * x - s * y, s * x + c * y, z], axis=1)


def _apply(results: dict[str, Any], moved: Moved) -> dict[str, Any]:
    out = results | {'points': moved.points}
    return out | {'boxes': moved.boxes} if 'boxes' in results else out


def _boxes(results: dict[str, Any]) -> Float[np.ndarray, 'boxes 7']:
    return np.asarray(results.get('boxes', np.zeros((0, 7))), dtype=np.float64)


def _refuse_view(results: dict[str, Any]) -> None:
    if 'views' in results:
        raise ValueError('the scene cannot move after AugmentedView; move AugmentedView behind this transform')


@TRANSFORMS.register_module()
class RandomFlipY:
    """Mirror left and right in a share of the items.

    Args:
        prob: Share, in [0, 1].
    """

    def __init__(self, prob: float = 0.5) -> None:
        if not 0 <= prob <= 1:
            raise ValueError(f'RandomFlipY: prob must lie in [0, 1], got {prob}')
        self.prob = prob

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Draw, then flip or not."""
        _refuse_view(results)
        if results['rng'].random() >= self.prob:
            return results
        return _apply(results, flip_y(results['points'], _boxes(results)))


@TRANSFORMS.register_module()
class GlobalRotScale:
    """Turn and scale the scene about the sensor.

    Args:
        rot: Least and greatest angle in radians.
        scale: Least and greatest factor.
    """

    def __init__(self, rot: tuple[float, float] = (-0.785, 0.785), scale: tuple[float, float] = (0.95, 1.05)) -> None:
        if rot[0] > rot[1] or not 0 < scale[0] <= scale[1]:
            raise ValueError(f'GlobalRotScale: expected least then greatest, scale > 0, got rot {rot}, scale {scale}')
        self.rot = rot
        self.scale = scale

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Draw, then move."""
        _refuse_view(results)
        angle, scale = results['rng'].uniform(*self.rot), results['rng'].uniform(*self.scale)
        if 'ground_height' in results:
            results = results | {'ground_height': results['ground_height'] * np.float32(scale)}
        return _apply(results, rotate_scale(results['points'], _boxes(results), angle, scale))
