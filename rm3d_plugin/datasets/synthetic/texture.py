"""Noise in space: what makes surfaces uneven in colour and reflectance.

Everything is integer hashing and plain sums, so the same place has the same value on every machine.
"""

from typing import Any

import numpy as np
from jaxtyping import Float
from numba import njit


def noise_field(points: Float[np.ndarray, 'points 3'], size: float) -> Float[np.ndarray, ' points']:
    """Smooth noise in [0, 1) at points in metres, with features of ``size`` metres."""
    return _field(np.ascontiguousarray(points), size)


@njit(cache=True)
def _field(points: Any, size: float) -> Any:
    out = np.empty(points.shape[0])
    for i in range(points.shape[0]):
        out[i] = smooth_noise(points[i, 0] / size, points[i, 1] / size, points[i, 2] / size)
    return out


@njit(cache=True)
def cell_hash(x: int, y: int, z: int) -> Any:
    """A number in [0, 1) for each cell of the integer grid."""
    h = (
        np.uint64(x & 0x1FFFFF)
        | (np.uint64(y & 0x1FFFFF) << np.uint64(21))
        | (np.uint64(z & 0x1FFFFF) << np.uint64(42))
    )
    h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    h = h ^ (h >> np.uint64(31))
    return np.float64(h >> np.uint64(11)) / 9007199254740992.0


@njit(cache=True)
def smooth_noise(x: float, y: float, z: float) -> Any:
    """Smooth noise in [0, 1) with features of length 1."""
    i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    u, v, w = x - i, y - j, z - k
    u, v, w = u * u * (3 - 2 * u), v * v * (3 - 2 * v), w * w * (3 - 2 * w)
    total = 0.0
    for a in range(2):
        for b in range(2):
            for c in range(2):
                share = (u if a else 1 - u) * (v if b else 1 - v) * (w if c else 1 - w)
                total += share * cell_hash(i + a, j + b, k + c)
    return total
