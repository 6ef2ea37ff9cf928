"""Transforms of indoor training: crops that fit memory, elastic distortion, and colours that cannot be relied on.

Points keep their order; points and labels stay in step. Chance comes from ``results['rng']`` alone.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, get_args

import numpy as np
from jaxtyping import Float

from rm3d_plugin.datasets.transforms.augmented_view import elastic_shift, rgb_columns
from rm3d_plugin.datasets.transforms.points import Shape, crop_rows, select_points
from rm3d_plugin.registry import TRANSFORMS

SCALES = ((0.2, 0.12), (0.8, 0.4))  # m: grid cell and greatest shift; a fine and a coarse wave


# ---------------------------------------------------------------------- crops


@TRANSFORMS.register_module()
class RandomCrop:
    """Keep the part of a scene around a random point, where the scene has more points than memory allows.

    Args:
        max_points: Most points to keep.
        shape: See :func:`crop_rows`.
        labelled: Share of the crops that lie around a labelled point, where there is one; with few labels, most other
            crops teach nothing.
    """

    def __init__(self, max_points: int, shape: Shape = 'sphere', labelled: float = 0.5) -> None:
        if max_points < 1 or not 0 <= labelled <= 1:
            raise ValueError(f'RandomCrop: expected max_points >= 1 and a share, got {max_points} and {labelled}')
        if shape not in get_args(Shape):
            raise ValueError(f'RandomCrop.shape: expected one of {get_args(Shape)}, got {shape!r}')
        self.max_points, self.shape, self.labelled = max_points, shape, labelled

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Draw a centre, then crop."""
        points, rng = results['points'], results['rng']
        if len(points) <= self.max_points:
            return results
        known = np.flatnonzero(results['semantic'] >= 0) if 'semantic' in results else np.zeros(0, dtype=np.int64)
        around_label = rng.random() < self.labelled and len(known) > 0
        row = known[rng.integers(len(known))] if around_label else rng.integers(len(points))
        rows = crop_rows(points[:, :3], points[row, :3].astype(np.float64), self.max_points, self.shape)
        return select_points(results, rows)


# ---------------------------------------------------------------------- shapes


def elastic(
    points: Float[np.ndarray, 'points channels'], scales: Sequence[Sequence[float]], rng: np.random.Generator
) -> Float[np.ndarray, 'points channels']:
    """Warp points by smooth random waves, one after the other.

    Args:
        points: (n, 3 + channels), metres; channels stay.
        scales: (grid cell, greatest shift) of each wave, metres; see :func:`elastic_shift`.
        rng: Source of the waves.
    """
    out, xyz = points.copy(), points[:, :3].astype(np.float64)
    for cell, magnitude in scales:
        xyz = xyz + elastic_shift(xyz, cell, magnitude, rng)
    out[:, :3] = xyz
    return out


@TRANSFORMS.register_module()
class ElasticDistortion:
    """Warp the shapes of a scene without boxes.

    Args:
        scales: (grid cell, greatest shift) of each wave, metres; larger shifts: stranger shapes.
        prob: Share of the items.
    """

    def __init__(self, scales: Sequence[Sequence[float]] = SCALES, prob: float = 0.95) -> None:
        if not 0 <= prob <= 1 or any(len(scale) != 2 or min(scale) <= 0 for scale in scales):
            raise ValueError(f'ElasticDistortion: expected pairs of metres and a share, got {scales} and {prob}')
        self.scales, self.prob = scales, prob

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Draw, then warp or not.

        Raises:
            ValueError: The scene has boxes, which would no longer fit, or an augmented view was already taken.
        """
        if len(results.get('boxes', ())) or 'views' in results:
            raise ValueError('ElasticDistortion: expected a scene without boxes, and AugmentedView behind it')
        if results['rng'].random() >= self.prob:
            return results
        return results | {'points': elastic(results['points'], self.scales, results['rng'])}


# ---------------------------------------------------------------------- colours


def auto_contrast(
    colors: Float[np.ndarray, 'points 3'], blend: float, low: float = 0.01, high: float = 0.99
) -> Float[np.ndarray, 'points 3']:
    """Stretch each channel so that its quantiles ``low`` and ``high`` become 0 and 1; a flat channel stays.

    Args:
        colors: In [0, 1].
        blend: 0 leaves the colours, 1 stretches them fully.
        low: Quantile that becomes 0.
        high: Quantile that becomes 1.
    """
    if len(colors) == 0:
        return colors.copy()
    bottom, top = np.quantile(colors, [low, high], axis=0)
    span = top - bottom
    stretched = np.clip((colors - bottom) / np.where(span > 0, span, 1.0), 0.0, 1.0)
    return (1 - blend) * colors + blend * np.where(span > 0, stretched, colors)


def _checked_share(part: str, *shares: float) -> None:
    if any(not 0 <= share <= 1 for share in shares):
        raise ValueError(f'{part}: shares lie in [0, 1], got {shares}')


class _ColorTransform(ABC):
    """Changes the colours of a share of the items; scans without colour pass unchanged."""

    def __init__(self, prob: float) -> None:
        _checked_share(type(self).__name__, prob)
        self.prob = prob

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Draw, then change the colours or not."""
        columns = rgb_columns(results['points'])
        if columns is None or results['rng'].random() >= self.prob:
            return results
        points = results['points'].copy()
        points[:, columns] = np.clip(self._changed(points[:, columns].astype(np.float64), results['rng']), 0.0, 1.0)
        return results | {'points': points}

    @abstractmethod
    def _changed(self, colors: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """The colours after the change; they are clipped to [0, 1] afterwards."""


@TRANSFORMS.register_module()
class ColorAutoContrast(_ColorTransform):
    """Stretch the contrast by a random amount.

    Args:
        prob: Share of the items.
    """

    def __init__(self, prob: float = 0.2) -> None:
        super().__init__(prob)

    def _changed(self, colors: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return auto_contrast(colors, float(rng.random()))


@TRANSFORMS.register_module()
class ColorJitter(_ColorTransform):
    """Shift the colours of the whole scene, and those of each point a little more.

    Args:
        shift: Greatest shift of a channel.
        noise: Standard deviation of each value.
        prob: Share of the items.
    """

    def __init__(self, shift: float = 0.1, noise: float = 0.02, prob: float = 0.95) -> None:
        super().__init__(prob)
        _checked_share('ColorJitter', shift, noise)
        self.shift, self.noise = shift, noise

    def _changed(self, colors: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        shift = rng.uniform(-self.shift, self.shift, 3)
        return colors + shift + rng.normal(0.0, self.noise, colors.shape)


@TRANSFORMS.register_module()
class ColorDrop(_ColorTransform):
    """Make the scene grey, so that shapes must do.

    Args:
        prob: Share of the items.
        grey: Value of every channel; 0.5 is what the network reads as no colour.
    """

    def __init__(self, prob: float = 0.2, grey: float = 0.5) -> None:
        super().__init__(prob)
        _checked_share('ColorDrop', grey)
        self.grey = grey

    def _changed(self, colors: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return np.full_like(colors, self.grey)
