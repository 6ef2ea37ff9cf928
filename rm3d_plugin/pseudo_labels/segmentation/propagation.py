"""How far the annotated points of a scene speak for the regions they lie in."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from rm3d_plugin.structures import UNLABELLED
from rm3d_plugin.structures.check_field import check_positive, check_switches


@dataclass(frozen=True)
class PropagationRules:
    """How far an annotated point names the points of its region; without these rules it names all, by majority.

    In a region with annotated points of several classes each point takes the class of the one that is nearest in place
    and colour. Segmentation only.

    Attributes:
        max_color: RGB difference, of 1, from the near and alike annotated point of a region up to which its points take
            an annotated class; the rest of the region asks the network. Smaller: fewer and purer labels. None: no
            limit. Of coloured scans only.
        max_extent: An annotated point names its region only where that is at most this many times as long as the
            regions of its class usually are (their median over all training scenes); else itself alone, and the region
            asks the network. Smaller: fewer and purer labels. None: no limit.
        new_instances: A group of a thing class in which no instance was annotated is an instance of its own. False: its
            points are of no known instance, so that pieces of an object do not teach offsets to their own middles.
    """

    max_color: float | None = None
    max_extent: float | None = None
    new_instances: bool = True

    def __post_init__(self) -> None:
        check_positive(self, 'max_color', 'max_extent', optional=True)
        check_switches(self, 'new_instances')


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
