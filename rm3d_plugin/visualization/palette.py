"""Colours that people with any colour vision can tell apart."""

import numpy as np
from jaxtyping import Float, Int

# Okabe and Ito's set, in an order in which neighbours differ most; readable on light and on dark ground.
SERIES = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9', '#8c6bb1', '#7f7f7f')
# Sixteen more for data sets with many classes; readable on light and on dark ground, if less safe to tell apart.
MORE = (
    '#b2182b', '#a1d76a', '#5e3cb9', '#f4a6d7', '#9c6114', '#2dd4bf', '#f0e442', '#3d9a2e',
    '#ff6f61', '#2b5fd9', '#c7b198', '#c51b7d', '#6b8e23', '#b3cde3', '#a020f0', '#d9f0a3',
)  # fmt: skip
GREY = '#b0b0b0'


def class_color(number: int) -> str:
    """Colour of a class or of a line; repeats after twenty-four."""
    every = SERIES + MORE
    return every[number % len(every)]


def region_colors(labels: Int[np.ndarray, ' points']) -> Float[np.ndarray, 'points 3']:
    """A colour for each region number, the same in every picture; grey where the number is -1 (discarded)."""
    hue = (np.asarray(labels, dtype=np.float64) * 0.6180339887498949) % 1.0
    value = 0.55 + 0.4 * ((np.asarray(labels) * 7) % 5) / 4
    # HSV to RGB at saturation 0.75.
    ramp = np.abs((hue[:, None] * 6 + np.array([0.0, 4.0, 2.0])) % 6 - 3) - 1
    colors = value[:, None] * (1 - 0.75 * (1 - np.clip(ramp, 0, 1)))
    colors[np.asarray(labels) < 0] = 0.8
    return colors


_LOW_TO_HIGH = np.array([[0.17, 0.18, 0.43], [0.0, 0.45, 0.7], [0.0, 0.62, 0.45], [0.94, 0.89, 0.26]])


def by_height(xyz: Float[np.ndarray, 'points 3']) -> Float[np.ndarray, 'points 3']:
    """Colours from dark blue over green to yellow, from the lowest to the highest fiftieth of the points."""
    z = np.asarray(xyz, dtype=np.float64)[:, 2]
    low, high = np.quantile(z, (0.02, 0.98)) if len(z) else (0.0, 1.0)
    at = np.clip((z - low) / max(float(high - low), 1e-6), 0, 1) * (len(_LOW_TO_HIGH) - 1)
    return np.stack([np.interp(at, np.arange(len(_LOW_TO_HIGH)), part) for part in _LOW_TO_HIGH.T], axis=1)
