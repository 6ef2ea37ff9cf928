"""Where in its scene a point lies, as further columns of the points."""

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float

from rm3d_plugin.registry import TRANSFORMS

WAVELENGTHS = (160.0, 40.0)  # m; the long one tells the ends of a scan apart, the short one its neighbourhoods


def place_columns(
    xyz: Float[np.ndarray, 'points 3'], wavelengths: Sequence[float] = WAVELENGTHS
) -> Float[np.ndarray, 'points columns']:
    """Sine and cosine of x and y, counted from the middle of the scene, for each wavelength; in [0, 1].

    Near points have like values, and within half the longest wavelength of the middle no two places have the same.

    Args:
        xyz: (n, 3) metres.
        wavelengths: Metres.
    """
    if len(xyz) == 0:
        return np.zeros((0, 4 * len(wavelengths)), dtype=np.float32)
    plane = xyz[:, :2] - np.median(xyz[:, :2], axis=0)
    angles = np.concatenate([2 * np.pi * plane / length for length in wavelengths], axis=1)
    return ((1 + np.concatenate([np.sin(angles), np.cos(angles)], axis=1)) / 2).astype(np.float32)


@TRANSFORMS.register_module()
class SinusoidalPosition:
    """Appends ``place`` columns (:class:`~rm3d_plugin.models.segmentors.PointInputs`) behind those the points have.

    For networks that are asked about the very scans they learn from: near points tend to be alike. Belongs before any
    crop or turn, so that a place keeps its values whatever view of the scene is taken.

    Args:
        wavelengths: Two lengths, metres.
    """

    column: ClassVar[str] = 'place'

    def __init__(self, wavelengths: Sequence[float] = WAVELENGTHS) -> None:
        if len(wavelengths) != 2 or min(wavelengths) <= 0:
            raise ValueError(f'SinusoidalPosition.wavelengths: expected two lengths > 0, got {list(wavelengths)}')
        self.wavelengths = tuple(float(length) for length in wavelengths)

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Compute, then append.

        Raises:
            ValueError: An augmented view was already taken.
        """
        if 'views' in results:
            raise ValueError('SinusoidalPosition: expected AugmentedView behind it')
        points = results['points']
        values = place_columns(points[:, :3], self.wavelengths)
        return results | {'points': np.concatenate([points, values.astype(points.dtype)], axis=1)}
