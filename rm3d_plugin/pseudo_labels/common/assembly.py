"""Label assembly: from regions to groups, and labels of points laid over each other until a scene is finished."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.ops.segment import segment_values
from rm3d_plugin.pseudo_labels.common.annotated import PointAnnotation, annotated_regions
from rm3d_plugin.pseudo_labels.common.groups import (
    GroupLabels,
    Pooled,
    count_votes,
    pool_rows,
    seen_rows,
)
from rm3d_plugin.pseudo_labels.common.inputs import CommonRules, RoundContext, SceneInputs
from rm3d_plugin.pseudo_labels.common.record import RefreshRecord
from rm3d_plugin.pseudo_labels.common.self_training import most_confident_groups
from rm3d_plugin.regions import MergeResult, MergeRules, RegionEvidence, merge
from rm3d_plugin.structures import UNLABELLED, PointCloud, PseudoLabels

BOX_REGION_SHARE = 0.5  # share of a region that an annotated box must hold to name it


class LabelAssembly(NamedTuple):
    """Labels of points while they are put together; later layers lie over earlier ones.

    Attributes:
        semantic: (N,) int64 class, -1 = none.
        confidence: (N,) float32 in [0, 1].
    """

    semantic: Int[np.ndarray, ' points']
    confidence: Float[np.ndarray, ' points']

    def overlay(
        self, where: Bool[np.ndarray, ' points'], semantic: np.ndarray | int, confidence: np.ndarray | float
    ) -> 'LabelAssembly':
        """Other labels for some of the points."""
        return LabelAssembly(
            np.where(where, semantic, self.semantic).astype(np.int64),
            np.where(where, confidence, self.confidence).astype(np.float32),
        )


class Grouped(NamedTuple):
    """Result of merging, for groups and for points.

    Attributes:
        merge: Groups and the ledger.
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

    def with_record(self) -> MergeResult:
        """The result whose ledger holds all that is needed to decide again."""
        return self.merge._replace(ledger=replace(self.merge.ledger, known=self.record.to_arrays()))


def pool_predictions(
    scene: SceneInputs, round: RoundContext[CommonRules], use: Bool[np.ndarray, ' points'] | None = None
) -> Pooled:
    """Softmax of each region; NaN rows where the network saw nothing.

    Args:
        scene: Whose regions.
        round: Says how to pool.
        use: Points that count; None: all that the network saw.

    Raises:
        ValueError: The prediction has no column a class.
    """
    regions, classes = scene.geometry.regions, len(round.class_counts)
    expected = (len(regions.labels), classes)
    rows = np.full(expected, np.nan) if scene.probabilities is None else scene.probabilities
    if rows.shape != expected:
        raise ValueError(f'refresh: probabilities have shape {rows.shape}, expected {expected}')
    seen = seen_rows(rows) if use is None else seen_rows(rows) & use
    return pool_rows(rows, seen, regions.labels, len(regions), round.rules.merge.pooling)


def pool_centers(scene: SceneInputs) -> Float[np.ndarray, 'regions 3'] | None:
    """Mean shifted centre of each region, metres; None where the network votes for none."""
    regions, centers = scene.geometry.regions, scene.centers
    if centers is None or scene.probabilities is None:
        return None
    seen = seen_rows(scene.probabilities) & np.isfinite(centers).all(axis=1)
    return pool_rows(centers, seen, regions.labels, len(regions)).values


def group_regions(
    scene: SceneInputs, round: RoundContext[CommonRules], annotation: PointAnnotation, pooled: Pooled
) -> Grouped:
    """Merge the regions and decide the class of every group.

    Args:
        scene: Whose regions.
        round: Rules, and where their schedule stands.
        annotation: What is annotated of the points.
        pooled: What each region is likely to be.
    """
    regions, graph, rules = scene.geometry.regions, scene.geometry.graph, round.rules.merge
    known = annotated_regions(regions, annotation, round.class_counts, BOX_REGION_SHARE)
    evidence = RegionEvidence(pooled.values, known.labels, known.instances, pool_centers(scene))
    result = merge(graph, evidence, rules, round.number)
    record = _record(scene, round, annotation, pooled, evidence)
    groups = record.label(result.group, rules.gamma)
    points = segment_values(result.group, regions.labels, -1)
    return Grouped(result, groups, points, sensor_ranges(scene.geometry.cloud), record)


def _record(
    scene: SceneInputs,
    round: RoundContext[CommonRules],
    annotation: PointAnnotation,
    pooled: Pooled,
    evidence: RegionEvidence,
) -> RefreshRecord:
    regions, count = scene.geometry.regions, len(scene.geometry.regions)
    # What a box tells exactly shall not speak for the rest of its region.
    bounded = annotation.known & (annotation.seeds < 0)
    outside = pool_predictions(scene, round, ~bounded) if bounded.any() else pooled
    return RefreshRecord(
        curvatures=scene.geometry.graph.curvatures,
        ranges=regions.pool_mean(sensor_ranges(scene.geometry.cloud)[:, None])[:, 0],
        labels=evidence.labels,
        instances=evidence.instances,
        probabilities=evidence.probabilities,
        centers=evidence.centers,
        outside=outside.values if bounded.any() else None,
        seen=outside.seen,
        votes=count_votes(annotation.seeds, regions.labels, count, len(round.class_counts)),
        class_counts=round.class_counts,
        class_gamma=None,
        named=None,
        point_region=regions.labels.astype(np.int32),
        merge=round.rules.merge,
        self_training=round.rules.self_training,
        round=round.number,
    )


def sensor_ranges(cloud: PointCloud) -> Float[np.ndarray, ' points']:
    """Metres from the sensor (the origin, where it is not known) to each point."""
    origin = np.zeros(3) if cloud.sensor is None else np.asarray(cloud.sensor, dtype=np.float64)
    return np.linalg.norm(cloud.xyz - origin, axis=1)


def limit_new_labels(grouped: Grouped, round: RoundContext[CommonRules]) -> Grouped:
    """Leave only as many network-given groups as this round may take; all where nothing limits them."""
    rules = round.rules.self_training
    if rules is None or rules.cbst_fraction is None:
        return grouped
    share = rules.fraction(round.number, round.rules.merge.rounds)
    groups = most_confident_groups(grouped.groups, grouped.points, share, grouped.ranges, rules.cbst_ranges)
    return grouped._replace(groups=groups)


def labels_of_groups(grouped: Grouped) -> LabelAssembly:
    """Every point takes the label of its group."""
    return LabelAssembly(
        segment_values(grouped.groups.classes, grouped.points, UNLABELLED),
        segment_values(grouped.groups.confidence, grouped.points, 0.0).astype(np.float32),
    )


def supported_points(
    previous: PseudoLabels | None, grouped: Grouped, rules: MergeRules
) -> Bool[np.ndarray, ' points'] | None:
    """Points whose earlier pseudo label stays: all, or where labels may fall those that the network still supports."""
    if previous is None:
        return None
    labelled = (previous.semantic >= 0) & ~previous.point_is_annotated
    if rules.demote_margin is None:
        return np.asarray(labelled)
    groups, classes = grouped.groups, np.maximum(previous.semantic, 0)
    table = np.vstack([groups.probabilities, np.full((1, groups.probabilities.shape[1]), np.nan)])
    lost = table[grouped.points, classes] < rules.gamma - rules.demote_margin  # NaN: no evidence against it
    annotated = segment_values(groups.from_annotation, grouped.points, False)
    agrees = segment_values(groups.classes, grouped.points, UNLABELLED) == previous.semantic
    return np.asarray(labelled & (~lost | (annotated & agrees)))


def keep_previous(
    labels: LabelAssembly, previous: PseudoLabels | None, supported: Bool[np.ndarray, ' points'] | None
) -> LabelAssembly:
    """Earlier labels stay where they are supported (see :func:`supported_points`)."""
    if previous is None or supported is None:
        return labels
    return labels.overlay(supported, previous.semantic, previous.confidence)
