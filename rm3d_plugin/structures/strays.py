"""Points that are no part of their scene."""

import numpy as np
from jaxtyping import Bool, Float

STRAY_DISTANCE = 1e3  # m from the scan's median; nearer points are never stray
STRAY_FACTOR = 20.0  # times the distance within which nine tenths of the points lie


def stray_points(xyz: Float[np.ndarray, 'points 3']) -> Bool[np.ndarray, ' points']:
    """Points that lie absurdly far from the others: zeros of missing returns in UTM, 3e38, slips of a digit.

    A point is stray where its distance from the median (the largest of the three axes) is more than 1 km and more than
    20 times the distance within which nine tenths of the points lie.

    Args:
        xyz: Metres, finite.

    >>> stray_points(np.array([[5e5, 5e6, 1.0], [5e5, 5e6, 2.0], [5e5, 5e6, 3.0], [0.0, 0.0, 0.0]])).tolist()
    [False, False, False, True]
    """
    if len(xyz) < 3:
        return np.zeros(len(xyz), dtype=np.bool_)
    world = np.asarray(xyz, dtype=np.float64)
    low, high = world.min(axis=0), world.max(axis=0)
    if np.all(high - low <= STRAY_DISTANCE):
        return np.zeros(len(xyz), dtype=np.bool_)
    distance = np.abs(world - np.median(world, axis=0)).max(axis=1)
    usual = float(np.partition(distance, (9 * (len(distance) - 1)) // 10)[(9 * (len(distance) - 1)) // 10])
    found: np.ndarray = distance > max(STRAY_DISTANCE, STRAY_FACTOR * usual)
    return found
