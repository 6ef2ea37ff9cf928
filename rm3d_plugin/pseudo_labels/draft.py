"""Labels of points on their way from groups to a finished scene."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.pseudo_labels.propagate import GroupLabels, label_groups, point_values, pool_rows, seen_rows
from rm3d_plugin.pseudo_labels.weak import Truth, WeakLabels, known_regions
from rm3d_plugin.regions import MergeResult, MergeStrategy, merge
from rm3d_plugin.structures import UNLABELLED, PseudoLabels, RegionGraph, Regions

BOX_REGION_SHARE = 0.5  # share of a region that a revealed box must hold to name it


class Draft(NamedTuple):
    """Labels of points before truth is laid over them."""

    semantic: Int[np.ndarray, ' points']
    confidence: Float[np.ndarray, ' points']


class Grouped(NamedTuple):
    """Result of merging, for groups and for points."""

    merge: MergeResult
    groups: GroupLabels
    points: Int[np.ndarray, ' points']


def check_rows(expected: int, **arrays: np.ndarray | WeakLabels | None) -> None:
    """Raise a ValueError that names the first array without one row a point; None passes."""
    for name, array in arrays.items():
        if array is not None and len(array) != expected:
            raise ValueError(f'refresh: {name} has {len(array)} rows, expected {expected} (one a point of the scene)')


def group_regions(
    regions: Regions,
    graph: RegionGraph,
    truth: Truth,
    probabilities: np.ndarray | None,
    centers: np.ndarray | None,
    strategy: MergeStrategy,
    round: int,
    class_counts: np.ndarray,
) -> Grouped:
    """Merge the regions and decide the class of every group.

    Raises:
        ValueError: The predictions have no row a point or no column a class.
    """
    n, count = len(regions.labels), len(regions)
    rows = np.full((n, len(class_counts)), np.nan) if probabilities is None else probabilities
    if rows.shape != (n, len(class_counts)):
        raise ValueError(f'refresh: probabilities have shape {rows.shape}, expected {(n, len(class_counts))}')
    seen = seen_rows(rows)
    pooled = pool_rows(rows, seen, regions.labels, count, strategy.pooling)
    known = known_regions(regions, truth, BOX_REGION_SHARE)
    pooled_centers = None
    if centers is not None:
        check_rows(n, centers=centers)
        pooled_centers = pool_rows(centers, seen & np.isfinite(centers).all(axis=1), regions.labels, count).values
    result = merge(regions, graph, pooled.values, known.labels, strategy, round, pooled_centers, known.instances)
    # What a box tells exactly shall not speak for the rest of its region.
    bounded = (truth.semantic >= 0) & (truth.seeds < 0)
    outside = pool_rows(rows, seen & ~bounded, regions.labels, count, strategy.pooling)
    groups = label_groups(result.group, outside, regions.labels, truth.seeds, class_counts, strategy.gamma)
    return Grouped(result, groups, point_values(result.group, regions.labels, -1))


def draft_of(grouped: Grouped) -> Draft:
    """Every point takes the label of its group."""
    return Draft(
        point_values(grouped.groups.classes, grouped.points, UNLABELLED),
        point_values(grouped.groups.confidence, grouped.points, 0.0).astype(np.float32),
    )


def overlay(
    draft: Draft, where: Bool[np.ndarray, ' points'], semantic: np.ndarray | int, confidence: np.ndarray | float
) -> Draft:
    """Other labels for some of the points."""
    return Draft(
        np.where(where, semantic, draft.semantic).astype(np.int64),
        np.where(where, confidence, draft.confidence).astype(np.float32),
    )


def supported_points(
    previous: PseudoLabels | None, grouped: Grouped, strategy: MergeStrategy
) -> Bool[np.ndarray, ' points'] | None:
    """Points whose earlier pseudo label stays: all, or where demotion is on those that the network still supports."""
    if previous is None:
        return None
    check_rows(len(grouped.points), previous=previous.semantic)
    labelled = (previous.semantic >= 0) & ~previous.point_is_true
    if strategy.permanent:
        return np.asarray(labelled)
    groups, classes = grouped.groups, np.maximum(previous.semantic, 0)
    table = np.vstack([groups.probabilities, np.full((1, groups.probabilities.shape[1]), np.nan)])
    lost = table[grouped.points, classes] < strategy.gamma - strategy.demote_margin  # NaN: no evidence against it
    by_truth = point_values(groups.from_truth, grouped.points, False)
    agrees = point_values(groups.classes, grouped.points, UNLABELLED) == previous.semantic
    return np.asarray(labelled & (~lost | (by_truth & agrees)))


def keep_previous(draft: Draft, previous: PseudoLabels | None, supported: Bool[np.ndarray, ' points'] | None) -> Draft:
    """Earlier labels stay where they are supported (see :func:`supported_points`)."""
    if previous is None or supported is None:
        return draft
    return overlay(draft, supported, previous.semantic, previous.confidence)
