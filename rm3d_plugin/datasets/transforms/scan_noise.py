"""Scans that were taken otherwise: fewer points, and noise on their places and on what else is known of them.

A handful of scenes teaches a network how dense and how exact just these are; other scenes then look strange to it.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from rm3d_plugin.datasets.transforms.points import random_subset, select_points
from rm3d_plugin.registry import TRANSFORMS

_FAR = 3.0  # standard deviations; noise goes no further


def noisy_points(
    points: Float[np.ndarray, 'points columns'], jitter: float, columns: float, rng: np.random.Generator
) -> Float[np.ndarray, 'points columns']:
    """Each coordinate off by its own noise; each further column by noise that all points share, and by its own.

    Args:
        points: x, y, z in metres, then columns in [0, 1], which stay within.
        jitter: Standard deviation in metres.
        columns: Standard deviation, of the shared noise and of each value's own.
        rng: Source of the noise; what is switched off draws no numbers.
    """
    out = points.copy()
    if jitter > 0:
        noise = rng.standard_normal((len(points), 3)).clip(-_FAR, _FAR)
        out[:, :3] += (jitter * noise).astype(points.dtype)
    if columns > 0 and points.shape[1] > 3:
        width = points.shape[1] - 3
        noise = rng.normal(0.0, columns, (1, width)) + rng.normal(0.0, columns, (len(points), width))
        out[:, 3:] = np.clip(out[:, 3:] + noise, 0.0, 1.0)
    return out


@TRANSFORMS.register_module()
class RandomDownsample:
    """Keep a random share of the points, drawn for each item.

    Args:
        keep: Least and greatest share; smaller: sparser scans, fewer labels in an item.
    """

    def __init__(self, keep: tuple[float, float] = (0.4, 1.0)) -> None:
        if len(keep) != 2 or not 0 < keep[0] <= keep[1] <= 1:
            raise ValueError(f'RandomDownsample.keep: expected two shares, 0 < least <= greatest <= 1, got {keep}')
        self.keep = keep

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Draw the share, then the points; at least one stays.

        Raises:
            ValueError: An augmented view was already taken.
        """
        rng, count = results['rng'], len(results['points'])
        kept = max(1, round(rng.uniform(*self.keep) * count))
        return select_points(results, random_subset(count, kept, rng))


@TRANSFORMS.register_module()
class PointNoise:
    """Noise on the places of points and on the columns behind them, see :func:`noisy_points`.

    Args:
        jitter: Metres.
        columns: In units of the columns, which lie in [0, 1].
    """

    def __init__(self, jitter: float = 0.02, columns: float = 0.05) -> None:
        if not 0 <= jitter < np.inf or not 0 <= columns < np.inf:
            raise ValueError(f'PointNoise: expected deviations from 0, got {jitter} and {columns}')
        self.jitter, self.columns = jitter, columns

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Draw, then add.

        Raises:
            ValueError: An augmented view was already taken, which would not have the noise.
        """
        if 'views' in results:
            raise ValueError('PointNoise: expected AugmentedView behind it')
        return results | {'points': noisy_points(results['points'], self.jitter, self.columns, results['rng'])}
