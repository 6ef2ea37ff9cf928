"""Distance prior: where annotated points lie, and how likely their class is from there."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from rm3d_plugin.structures import Regions

DECAY = 1.5  # exponent of the distance decay
SAMPLE = 32  # points of a region whose distance is measured


def annotated_distances(
    xyz: Float[np.ndarray, 'points 3'], regions: Regions, annotated: Int[np.ndarray, ' points'], count: int
) -> Float[np.ndarray, 'regions classes']:
    """Mean distance of the points of each region to the nearest annotated point of each class.

    Of a large region some points, evenly chosen, stand for all.

    Args:
        xyz: Metres.
        regions: Partition of the same points.
        annotated: Annotated class of each point, -1 = none.
        count: Number of classes.

    Returns:
        (R, C) metres; infinite for classes of which the scene holds no annotated point.
    """
    out = np.full((len(regions), count), np.inf)
    if not len(regions):
        return out
    steps = np.linspace(0, regions.sizes - 1, SAMPLE, axis=1).astype(np.int64)
    sample = xyz[regions.indices[regions.offsets[:-1, None] + steps]]
    for c in np.unique(annotated[annotated >= 0]).tolist():
        distance, _ = cKDTree(xyz[annotated == c]).query(sample)
        out[:, c] = distance.mean(axis=1)
    return out


def distance_decay(distance: Float[np.ndarray, '*any'], scale: float) -> Float[np.ndarray, '*any']:
    """How likely the class of an annotated point is so far away: (1 + distance / scale) ^ -:data:`DECAY`.

    Args:
        distance: Metres; infinite: 0.
        scale: Metres at which it has begun to decay.
    """
    return np.asarray((1.0 + distance / scale) ** -DECAY)


def distance_prior(
    distance: Float[np.ndarray, 'regions classes'], lengths: Float[np.ndarray, ' classes'], scale: float | None
) -> Float[np.ndarray, 'regions classes']:
    """How likely each class is at a region by its nearest annotated points.

    With a scale it decays slowly (:func:`distance_decay`), as small things of a class stand anywhere. Without, it is
    exp(-distance / length) / sqrt(length) with the usual length of the class's regions: most points belong to a thing
    of which one was annotated, and what is long, as a floor, says less of each place.

    Args:
        distance: See :func:`annotated_distances`.
        lengths: (C,) metres, how long regions of each class usually are; NaN, unknown: the median of the others.
        scale: Metres, or None.

    Returns:
        (R, C) not negative; 0 at infinite distance, but 1 for all classes where the scene holds no annotated point.
    """
    if not np.isfinite(distance).any():
        return np.ones_like(distance)
    if scale is not None:
        return distance_decay(distance, scale)
    known = np.isfinite(lengths)
    reach = np.where(known, lengths, np.median(lengths[known]) if known.any() else 1.0)
    return np.asarray(np.exp(-distance / reach) / np.sqrt(reach))
