"""What a sensor measured beside places: colour and return strength, in columns."""

import numpy as np
from jaxtyping import Float

from rm3d_plugin.ops.color import rgb_to_lab
from rm3d_plugin.structures import PointCloud


def channel_groups(cloud: PointCloud) -> list[Float[np.ndarray, 'points columns']]:
    """CIE Lab of the colours, and the return strength, each where there is one; a constant channel tells nothing.

    Args:
        cloud: N points.

    Returns:
        Of each channel its columns, three or one.
    """
    groups: list[np.ndarray] = []
    if cloud.colors is not None:
        groups.append(rgb_to_lab(cloud.colors))
    if cloud.intensity is not None:
        groups.append(in_unit(cloud.intensity.astype(np.float64))[:, None])
    return [group for group in groups if len(group) and np.ptp(group, axis=0).max() > 0]


def in_unit(strength: Float[np.ndarray, ' points']) -> Float[np.ndarray, ' points']:
    """Return strengths in [0, 1]: as they are, or where a sensor counts otherwise, by their 1st and 99th percentile.

    >>> in_unit(np.array([0.2, 0.9])), in_unit(np.array([0.0, 100.0, 200.0])).round(2)
    (array([0.2, 0.9]), array([0. , 0.5, 1. ]))
    """
    if not len(strength) or (strength.min() >= 0.0 and strength.max() <= 1.0):
        return strength
    low, high = np.percentile(strength, [1, 99])
    return np.asarray(((strength - low) / (high - low)).clip(0.0, 1.0)) if high > low else strength
