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
        groups.append(cloud.intensity[:, None].astype(np.float64))
    return [group for group in groups if len(group) and np.ptp(group, axis=0).max() > 0]
