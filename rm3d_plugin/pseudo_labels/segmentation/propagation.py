"""How far the annotated points of a scene speak for the regions they lie in."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from rm3d_plugin.structures import UNLABELLED


class SeededRegions(NamedTuple):
    """Each region with each class of which it holds a true label, in ascending order.

    Attributes:
        regions: (S,) int64.
        classes: (S,) int64.
    """

    regions: Int[np.ndarray, ' pairs']
    classes: Int[np.ndarray, ' pairs']


def seeded_regions(region_labels: Int[np.ndarray, ' points'], true_labels: Int[np.ndarray, ' points']) -> SeededRegions:
    """Which classes the true labels of each region name."""
    seeds = (true_labels >= 0) & (region_labels >= 0)
    pairs = np.unique(np.stack([region_labels[seeds], true_labels[seeds]], axis=1), axis=0).astype(np.int64)
    return SeededRegions(pairs[:, 0], pairs[:, 1])


def mixed_regions(
    region_labels: Int[np.ndarray, ' points'], true_labels: Int[np.ndarray, ' points']
) -> Int[np.ndarray, ' mixed']:
    """Regions that hold true labels of several classes, ascending."""
    regions, classes = np.unique(seeded_regions(region_labels, true_labels).regions, return_counts=True)
    return np.asarray(regions[classes > 1], dtype=np.int64)


def nearest_seeds(
    xyz: Float[np.ndarray, 'points 3'],
    colors: Float[np.ndarray, 'points 3'] | None,
    region_labels: Int[np.ndarray, ' points'],
    true_labels: Int[np.ndarray, ' points'],
    place: float,
    color: float,
    regions: Int[np.ndarray, ' asked'] | None = None,
) -> Int[np.ndarray, ' points']:
    """The labelled point of its own region that is nearest to each point and alike.

    The distance is that of (xyz / place, colour / color).

    Args:
        xyz: Metres.
        colors: RGB in [0, 1], or None: the place alone.
        region_labels: Region of each point, -1 = none.
        true_labels: True class of each point, -1 = unknown.
        place: Metres that count as much as ``color``.
        color: Difference of colour that counts 1; larger: place decides.
        regions: Only these regions, which all hold a true label; None: all that do.

    Returns:
        (N,) int64; -1 for points of other regions.
    """
    out = np.full(len(xyz), -1, dtype=np.int64)
    where = xyz / place if colors is None else np.concatenate([xyz / place, colors / color], axis=1)
    if regions is None:
        regions = np.unique(region_labels[(true_labels >= 0) & (region_labels >= 0)])
    order = np.argsort(region_labels, kind='stable')
    bounds = np.searchsorted(region_labels[order], np.stack([regions, regions + 1], axis=1).reshape(-1))
    for first, last in bounds.reshape(-1, 2).tolist():
        members = order[first:last]
        own = members[true_labels[members] >= 0]
        _, nearest = cKDTree(where[own]).query(where[members])
        out[members] = own[nearest]
    return out


def nearest_true_classes(
    region_labels: Int[np.ndarray, ' points'],
    true_labels: Int[np.ndarray, ' points'],
    seeds: Int[np.ndarray, ' points'],
) -> Int[np.ndarray, ' points']:
    """In regions that hold true labels of several classes: the class of the labelled point that is nearest and alike.

    A majority would give the window in a wall to the wall.

    Args:
        region_labels: Region of each point, -1 = none.
        true_labels: True class of each point, -1 = unknown.
        seeds: Labelled point for each point, see :func:`nearest_seeds`.

    Returns:
        (N,) int64; -1 for points of regions whose true labels agree, or that hold none.
    """
    mixed = np.isin(region_labels, mixed_regions(region_labels, true_labels))
    return np.where(mixed, np.append(true_labels, UNLABELLED)[seeds], UNLABELLED).astype(np.int64)


def usual_lengths(
    classes: Int[np.ndarray, ' pairs'], lengths: Float[np.ndarray, ' pairs'], count: int, least: int = 3
) -> Float[np.ndarray, ' classes']:
    """Median length of the regions in which labels of each class were annotated.

    Args:
        classes: Class of each seeded region, of all scenes.
        lengths: Its length, metres.
        count: Number of classes.
        least: Regions that a class needs.

    Returns:
        (C,) metres; NaN for a class of fewer regions.
    """
    return np.array([np.median(own) if len(own := lengths[classes == c]) >= least else np.nan for c in range(count)])


def quiet_seeds(
    region_labels: Int[np.ndarray, ' points'],
    true_labels: Int[np.ndarray, ' points'],
    lengths: Float[np.ndarray, ' regions'],
    usual: Float[np.ndarray, ' classes'],
    factor: float,
) -> Bool[np.ndarray, ' points']:
    """True labels in a region that is far too long for their class: the picture's point that fell upon the wall.

    Args:
        region_labels: Region of each point, -1 = none.
        true_labels: True class of each point, -1 = unknown.
        lengths: Of each region, metres.
        usual: Usual length for each class, see :func:`usual_lengths`; NaN: never too long.
        factor: Lengths above this many usual ones are too long.
    """
    inside = (true_labels >= 0) & (region_labels >= 0)
    limit = np.append(usual, np.nan)[true_labels] * factor
    return np.asarray(inside & (np.append(lengths, 0.0)[region_labels] > limit))


def unlike_seed(
    colors: Float[np.ndarray, 'points 3'], seeds: Int[np.ndarray, ' points'], limit: float
) -> Bool[np.ndarray, ' points']:
    """Points that differ in colour from their labelled point (see :func:`nearest_seeds`) by more than the limit."""
    return np.asarray((seeds >= 0) & (np.linalg.norm(colors - colors[seeds], axis=1) > limit))
