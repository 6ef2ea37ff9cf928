"""How far the annotated points of a scene speak for the regions they lie in."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from rm3d_plugin.pseudo_labels.common.annotated import PointAnnotation, annotated_region_classes
from rm3d_plugin.pseudo_labels.common.assembly import LabelAssembly
from rm3d_plugin.pseudo_labels.common.groups import confident_parts
from rm3d_plugin.pseudo_labels.common.inputs import CommonRules, RoundContext, SceneInputs
from rm3d_plugin.structures import UNLABELLED, PointCloud
from rm3d_plugin.structures.check_field import check_positive, check_switches

NEAR_PLACE = 0.5  # m that count as much as NEAR_COLOR
NEAR_COLOR = 0.16  # RGB difference, of 1


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


class RulesWithPropagation(CommonRules, Protocol):
    """Rules of a task in which annotated points speak for regions."""

    @property
    def propagation(self) -> PropagationRules | None:
        """How far they do, or None."""


def mixed_regions(
    region_labels: Int[np.ndarray, ' points'], annotated: Int[np.ndarray, ' points']
) -> Int[np.ndarray, ' mixed']:
    """Regions that hold annotated points of several classes, ascending."""
    regions, classes = np.unique(annotated_region_classes(region_labels, annotated).regions, return_counts=True)
    return np.asarray(regions[classes > 1], dtype=np.int64)


def nearest_seeds(
    cloud: PointCloud,
    region_labels: Int[np.ndarray, ' points'],
    annotated: Int[np.ndarray, ' points'],
    regions: Int[np.ndarray, ' asked'] | None = None,
) -> Int[np.ndarray, ' points']:
    """The annotated point of its own region that is nearest to each point and alike.

    The distance is that of (xyz / :data:`NEAR_PLACE`, RGB / :data:`NEAR_COLOR`); without colours the place decides.

    Args:
        cloud: Points.
        region_labels: Region of each point, -1 = none.
        annotated: Annotated class of each point, -1 = none.
        regions: Only these regions, which all hold an annotated point; None: all that do.

    Returns:
        (N,) int64; -1 for points of other regions.
    """
    out = np.full(len(cloud), -1, dtype=np.int64)
    where = cloud.xyz / NEAR_PLACE
    if cloud.colors is not None:
        where = np.concatenate([where, cloud.colors / NEAR_COLOR], axis=1)
    if regions is None:
        regions = np.unique(region_labels[(annotated >= 0) & (region_labels >= 0)])
    order = np.argsort(region_labels, kind='stable')
    bounds = np.searchsorted(region_labels[order], np.stack([regions, regions + 1], axis=1).reshape(-1))
    for first, last in bounds.reshape(-1, 2).tolist():
        members = order[first:last]
        own = members[annotated[members] >= 0]
        _, nearest = cKDTree(where[own]).query(where[members])
        out[members] = own[nearest]
    return out


def nearest_classes(
    region_labels: Int[np.ndarray, ' points'],
    annotated: Int[np.ndarray, ' points'],
    seeds: Int[np.ndarray, ' points'],
) -> Int[np.ndarray, ' points']:
    """In regions with annotated points of several classes: the class of the one that is nearest and alike.

    A majority would give the window in a wall to the wall.

    Args:
        region_labels: Region of each point, -1 = none.
        annotated: Annotated class of each point, -1 = none.
        seeds: Annotated point for each point, see :func:`nearest_seeds`.

    Returns:
        (N,) int64; -1 for points of regions whose annotated points agree, or that hold none.
    """
    mixed = np.isin(region_labels, mixed_regions(region_labels, annotated))
    return np.where(mixed, np.append(annotated, UNLABELLED)[seeds], UNLABELLED).astype(np.int64)


def seeds_of_long_regions(
    region_labels: Int[np.ndarray, ' points'],
    annotated: Int[np.ndarray, ' points'],
    lengths: Float[np.ndarray, ' regions'],
    longest: Float[np.ndarray, ' classes'],
) -> Bool[np.ndarray, ' points']:
    """Annotated points in a region that is far too long for their class, as a picture's that fell upon the wall.

    Args:
        region_labels: Region of each point, -1 = none.
        annotated: Annotated class of each point, -1 = none.
        lengths: Of each region, metres.
        longest: Longest region of each class, metres; NaN: any.
    """
    inside = (annotated >= 0) & (region_labels >= 0)
    limit = np.append(longest, np.nan)[annotated]
    return np.asarray(inside & (np.append(lengths, 0.0)[region_labels] > limit))


def differs_from_seed(
    colors: Float[np.ndarray, 'points 3'], seeds: Int[np.ndarray, ' points'], limit: float
) -> Bool[np.ndarray, ' points']:
    """Points that differ in colour from their annotated point (see :func:`nearest_seeds`) by more than the limit."""
    return np.asarray((seeds >= 0) & (np.linalg.norm(colors - colors[seeds], axis=1) > limit))


def named_one_by_one(
    votes: Int[np.ndarray, 'regions classes'], rules: PropagationRules | None, colored: bool
) -> Bool[np.ndarray, ' regions']:
    """Regions whose points :func:`name_single_points` names, so that no threshold of merging has a say in them.

    Args:
        votes: Annotated points of each region by class.
        rules: How far they speak, or None.
        colored: Whether the scan has colours.
    """
    classes = (votes > 0).sum(axis=1)
    if rules is None:
        return np.zeros(len(votes), dtype=bool)
    return np.asarray(classes > (0 if colored and rules.max_color is not None else 1))


def name_single_points(
    labels: LabelAssembly, scene: SceneInputs, round: RoundContext[RulesWithPropagation], annotation: PointAnnotation
) -> LabelAssembly:
    """What the annotated points of a region say of its points one by one, where the rules ask for that.

    They say the same in every round, so where labels stay only the points that they left out are asked for again.
    """
    rules, merging, cloud = round.rules.propagation, round.rules.merge, scene.geometry.cloud
    if rules is None:
        return labels
    limit = None if cloud.colors is None else rules.max_color
    regions = scene.geometry.regions.labels
    if scene.previous is not None and merging.demote_margin is None:
        if limit is None:
            return labels
        left_out = _in_annotated_regions(scene, annotation) & (scene.previous.semantic < 0)
        return _ask_network(labels, scene, left_out, merging.gamma)
    asked = mixed_regions(regions, annotation.semantic) if limit is None else None
    seeds = nearest_seeds(cloud, regions, annotation.semantic, asked)
    own = nearest_classes(regions, annotation.semantic, seeds)
    labels = labels.overlay(own >= 0, own, labels.confidence)
    if cloud.colors is None or limit is None:
        return labels
    return _ask_network(labels, scene, differs_from_seed(cloud.colors, seeds, limit), merging.gamma)


def _in_annotated_regions(scene: SceneInputs, annotation: PointAnnotation) -> Bool[np.ndarray, ' points']:
    """Points of regions with an annotated point."""
    regions = scene.geometry.regions
    annotated = np.zeros(len(regions) + 1, dtype=bool)
    annotated[regions.labels[annotation.known]] = True
    annotated[-1] = False
    return annotated[regions.labels]


def _ask_network(
    labels: LabelAssembly, scene: SceneInputs, points: Bool[np.ndarray, ' points'], gamma: float
) -> LabelAssembly:
    """Nothing but the network names these points, those of each region together."""
    labels = labels.overlay(points, UNLABELLED, 0.0)
    if scene.probabilities is None:
        return labels
    parts = confident_parts(scene.probabilities, scene.geometry.regions.labels, points, gamma)
    return labels.overlay(points, *parts)
