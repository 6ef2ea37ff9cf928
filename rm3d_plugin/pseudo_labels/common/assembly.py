"""Labels of points on their way from groups to a finished scene."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.pseudo_labels.common.annotated import AnnotatedLabels, Truth, known_regions
from rm3d_plugin.pseudo_labels.common.groups import GroupLabels, count_votes, point_values, pool_rows, seen_rows
from rm3d_plugin.pseudo_labels.common.record import RefreshRecord
from rm3d_plugin.pseudo_labels.common.top_fraction import within_quota
from rm3d_plugin.pseudo_labels.ground.labels import level_regions
from rm3d_plugin.pseudo_labels.region_prior.prior import with_prior
from rm3d_plugin.regions import MergeResult, MergeStrategy, merge
from rm3d_plugin.structures import UNLABELLED, PointCloud, PseudoLabels, RegionGraph, Regions

BOX_REGION_SHARE = 0.5  # share of a region that an annotated box must hold to name it


class Draft(NamedTuple):
    """Labels of points before truth is laid over them."""

    semantic: Int[np.ndarray, ' points']
    confidence: Float[np.ndarray, ' points']


class Grouped(NamedTuple):
    """Result of merging, for groups and for points.

    Attributes:
        merge: Groups and the ledger, which holds all that is needed to decide again.
        groups: What each group is.
        points: (N,) group of each point, -1 = none.
        ranges: (N,) metres from the sensor.
        record: What was known.
    """

    merge: MergeResult
    groups: GroupLabels
    points: Int[np.ndarray, ' points']
    ranges: Float[np.ndarray, ' points']
    record: RefreshRecord


def check_rows(expected: int, **arrays: np.ndarray | AnnotatedLabels | None) -> None:
    """Raise a ValueError that names the first array without one row a point; None passes."""
    for name, array in arrays.items():
        if array is not None and len(array) != expected:
            raise ValueError(f'refresh: {name} has {len(array)} rows, expected {expected} (one a point of the scene)')


def group_regions(
    cloud: PointCloud,
    regions: Regions,
    graph: RegionGraph,
    truth: Truth,
    probabilities: np.ndarray | None,
    centers: np.ndarray | None,
    strategy: MergeStrategy,
    round: int,
    class_counts: np.ndarray,
    class_gamma: np.ndarray | None = None,
    prior: np.ndarray | None = None,
) -> Grouped:
    """Merge the regions and decide the class of every group; ``class_gamma`` is only put on record.

    Raises:
        ValueError: The predictions have no row a point or no column a class.
    """
    n, count = len(regions.labels), len(regions)
    rows = np.full((n, len(class_counts)), np.nan) if probabilities is None else probabilities
    if rows.shape != (n, len(class_counts)):
        raise ValueError(f'refresh: probabilities have shape {rows.shape}, expected {(n, len(class_counts))}')
    seen = seen_rows(rows)
    pooled = pool_rows(rows, seen, regions.labels, count, strategy.pooling)
    if prior is not None:
        network = None if probabilities is None else pooled
        pooled = with_prior(network, regions.sizes, prior, strategy.inverse_temperature)
    known = known_regions(regions, truth, BOX_REGION_SHARE)
    pooled_centers = None
    if centers is not None:
        check_rows(n, centers=centers)
        pooled_centers = pool_rows(centers, seen & np.isfinite(centers).all(axis=1), regions.labels, count).values
    result = merge(regions, graph, pooled.values, known.labels, strategy, round, pooled_centers, known.instances)
    # What a box tells exactly shall not speak for the rest of its region.
    bounded = (truth.semantic >= 0) & (truth.seeds < 0)
    outside = pool_rows(rows, seen & ~bounded, regions.labels, count, strategy.pooling) if bounded.any() else pooled
    ranges = sensor_ranges(cloud)
    votes = count_votes(truth.seeds, regions.labels, count, len(class_counts))
    record = RefreshRecord(
        curvatures=graph.curvatures,
        ranges=regions.pool_mean(ranges[:, None])[:, 0],
        labels=known.labels,
        instances=known.instances,
        probabilities=pooled.values,
        centers=pooled_centers,
        outside=outside.values if bounded.any() else None,
        seen=outside.seen,
        votes=votes,
        class_counts=class_counts,
        class_gamma=class_gamma,
        level=level_regions(graph, strategy.level_regions),
        point_region=regions.labels.astype(np.int32),
        strategy=strategy,
        round=round,
    )
    ledger = replace(result.ledger, known=record.to_arrays())
    groups = record.label(result.group, strategy.gamma)
    points = point_values(result.group, regions.labels, -1)
    return Grouped(result._replace(ledger=ledger), groups, points, ranges, record)


def sensor_ranges(cloud: PointCloud) -> Float[np.ndarray, ' points']:
    """Metres from the sensor (the origin, where it is not known) to each point."""
    origin = np.zeros(3) if cloud.sensor is None else np.asarray(cloud.sensor, dtype=np.float64)
    return np.linalg.norm(cloud.xyz - origin, axis=1)


def apply_quota(grouped: Grouped, strategy: MergeStrategy, round: int) -> Grouped:
    """Leave only as many network-given groups as this round may take; all where the strategy has no quota."""
    if strategy.quota is None:
        return grouped
    share = strategy.quota_share(round)
    groups = within_quota(grouped.groups, grouped.points, share, grouped.ranges, strategy.quota_ranges)
    return grouped._replace(groups=groups)


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
    labelled = (previous.semantic >= 0) & ~previous.point_is_annotated
    if strategy.permanent:
        return np.asarray(labelled)
    groups, classes = grouped.groups, np.maximum(previous.semantic, 0)
    table = np.vstack([groups.probabilities, np.full((1, groups.probabilities.shape[1]), np.nan)])
    lost = table[grouped.points, classes] < strategy.gamma - strategy.demote_margin  # NaN: no evidence against it
    by_truth = point_values(groups.from_annotation, grouped.points, False)
    agrees = point_values(groups.classes, grouped.points, UNLABELLED) == previous.semantic
    return np.asarray(labelled & (~lost | (by_truth & agrees)))


def keep_previous(draft: Draft, previous: PseudoLabels | None, supported: Bool[np.ndarray, ' points'] | None) -> Draft:
    """Earlier labels stay where they are supported (see :func:`supported_points`)."""
    if previous is None or supported is None:
        return draft
    return overlay(draft, supported, previous.semantic, previous.confidence)
