"""Colour spaces."""

import numpy as np
from jaxtyping import Float

# sRGB (D65) to XYZ, and the white point that Lab is relative to (IEC 61966-2-1, CIE 1976).
_TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
_WHITE = _TO_XYZ.sum(axis=1)
_KNEE = (6.0 / 29.0) ** 3


def rgb_to_lab(rgb: Float[np.ndarray, 'points 3']) -> Float[np.ndarray, 'points 3']:
    """SRGB in [0, 1] to CIE Lab (L in [0, 100]), white D65.

    >>> np.abs(rgb_to_lab(np.ones((1, 3))) - [[100.0, 0.0, 0.0]]).max() < 1e-9
    np.True_
    """
    value = np.clip(np.asarray(rgb, dtype=np.float64), 0.0, 1.0)
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    ratio = linear @ _TO_XYZ.T / _WHITE
    f = np.where(ratio > _KNEE, np.cbrt(ratio), ratio / (3.0 * (6.0 / 29.0) ** 2) + 4.0 / 29.0)
    return np.stack([116.0 * f[:, 1] - 16.0, 500.0 * (f[:, 0] - f[:, 1]), 200.0 * (f[:, 1] - f[:, 2])], axis=1)
