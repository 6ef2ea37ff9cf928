"""What a sensor sees of things: from where, and how bright, beside what is usual so far off."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.structures import PointCloud

WIDEST = 30.0  # m from the path of the sensor, from which on all is far
RANGES = np.concatenate([[0.0], np.arange(3.0, 31.0), [33, 36, 40, 45, 50, 60, 80, np.inf]])  # m
_LEAST_IN_RANGE = 50  # points


class IntensityByRange(NamedTuple):
    """Mean return strength at each range; what falls off with it says nothing of a thing.

    Attributes:
        ranges: (K,) metres, ascending.
        strengths: (K,) mean of the points about that far off.
    """

    ranges: Float[np.ndarray, ' bins']
    strengths: Float[np.ndarray, ' bins']


def intensity_of(cloud: PointCloud) -> Float[np.ndarray, ' points'] | None:
    """Intensity, else the mean of the colours; None: neither is there."""
    if cloud.intensity is not None:
        return cloud.intensity.astype(np.float64)
    return None if cloud.colors is None else cloud.colors.mean(axis=1, dtype=np.float64)


def seen_from_sensor(cloud: PointCloud) -> Float[np.ndarray, 'points 3']:
    """Points less the place of the sensor; where that is unknown the origin stands for it."""
    xyz = cloud.xyz.astype(np.float64)
    return xyz if cloud.sensor is None else xyz - np.asarray(cloud.sensor)


def range_normalised_intensity(scenes: Iterable[tuple[PointCloud, Bool[np.ndarray, ' points']]]) -> IntensityByRange:
    """Mean strength by range over all scenes.

    Args:
        scenes: Points of each, and which of them are ground.
    """
    sums = np.zeros((3, len(RANGES) - 1))
    for cloud, ground in scenes:
        strength = intensity_of(cloud)
        if strength is not None:
            sums += intensity_sums(np.linalg.norm(seen_from_sensor(cloud)[ground], axis=1), strength[ground])
    return intensity_by_range(sums)


def intensity_sums(
    ranges: Float[np.ndarray, ' rows'],
    strengths: Float[np.ndarray, ' rows'],
    sizes: Int[np.ndarray, ' rows'] | None = None,
) -> Float[np.ndarray, '3 bins']:
    """Points, sum of their strengths, and of their ranges, by :data:`RANGES`; rows of ``sizes`` points, or of one."""
    weights = np.ones(len(ranges)) if sizes is None else sizes
    return np.stack(
        [np.histogram(ranges, RANGES, weights=w)[0] for w in (weights, weights * strengths, weights * ranges)]
    )


def intensity_by_range(sums: Float[np.ndarray, '3 bins']) -> IntensityByRange:
    """The means of :func:`intensity_sums`, where they are of some points."""
    counts, strengths, ranges = sums[:, sums[0] >= _LEAST_IN_RANGE]
    return IntensityByRange(ranges / counts, strengths / counts)


def brightness(
    strengths: Float[np.ndarray, ' rows'], ranges: Float[np.ndarray, ' rows'], usual: IntensityByRange
) -> Float[np.ndarray, ' rows']:
    """Strength over what is usual at that range."""
    return strengths / np.maximum(np.interp(ranges, usual.ranges, usual.strengths), 1e-6)
