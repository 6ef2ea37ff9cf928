"""What the backbone reads of a point."""

import torch
from jaxtyping import Float
from torch import Tensor

CHANNELS = 4
_FAR = 50.0  # m; about the range where a spinning lidar grows sparse


def point_features(
    points: Float[Tensor, 'points channels'], heights: tuple[float, float]
) -> Float[Tensor, 'points features']:
    """Intensity, height, horizontal range and a one.

    Args:
        points: x, y, z in metres and intensity; further columns are ignored.
        heights: Lowest and highest usual z in metres, mapped to 0 and 1.

    Raises:
        ValueError: A point has fewer than four columns.
    """
    if points.shape[1] < CHANNELS:
        raise ValueError(f'points: expected x, y, z, intensity, got {points.shape[1]} columns')
    low, high = heights
    height = (points[:, 2] - low) / (high - low)
    far = points[:, :2].norm(dim=1) / _FAR
    return torch.stack([points[:, 3], height, far, torch.ones_like(far)], dim=1)
