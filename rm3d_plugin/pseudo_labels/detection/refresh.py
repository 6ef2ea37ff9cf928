"""One scene in, point and box labels out: merge its regions, and find the objects among the groups (METHOD 1)."""

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.pseudo_labels.common.annotated import AnnotatedLabels, Truth, known_by_boxes
from rm3d_plugin.pseudo_labels.common.assembly import (
    Draft,
    Grouped,
    apply_quota,
    check_rows,
    draft_of,
    group_regions,
    keep_previous,
    overlay,
    supported_points,
)
from rm3d_plugin.pseudo_labels.common.groups import point_values, seen_rows, split_mixed, without_doubtful
from rm3d_plugin.pseudo_labels.common.refresh_result import RefreshResult, refresh_stats
from rm3d_plugin.pseudo_labels.detection.boxes import geometric_background, region_tops, robust_extents
from rm3d_plugin.pseudo_labels.detection.objects import (
    NO_EVIDENCE,
    EarlierObjects,
    Evidence,
    ObjectRules,
    Objects,
    PointVotes,
    find_objects,
)
from rm3d_plugin.regions import MergeStrategy
from rm3d_plugin.structures import UNLABELLED, Boxes3D, PointCloud, PseudoLabels, RegionGraph, Regions

BACKGROUND_CONFIDENCE = 0.9  # of what geometry alone calls background
GROUND_HEIGHT = 0.15  # m; points of no region that are lower than this above ground are ground


def refresh_detection(
    prepared_cloud: PointCloud,
    regions: Regions,
    graph: RegionGraph,
    annotated: AnnotatedLabels,
    probabilities: Float[np.ndarray, 'points classes'] | None,
    centers: Float[np.ndarray, 'points 3'] | None,
    previous: PseudoLabels | None,
    strategy: MergeStrategy,
    round: int,
    priors: Float[np.ndarray, 'classes 3'],
    class_counts: Int[np.ndarray, ' classes'],
    height_above_ground: Float[np.ndarray, ' points'] | None = None,
    rules: ObjectRules | None = None,
    evidence: Evidence = NO_EVIDENCE,
) -> RefreshResult:
    """Point and box labels of one scene of a detection run.

    Annotated boxes label their points exactly and spread nowhere. Elsewhere a group of regions takes the class that the
    network gives it with confidence, and every group of an object class becomes a pseudo box, if it is plausible and
    no true or better box is in its place. Regions that no object can be are background from the first round on; only
    one that is merely too large may still turn out to hold objects.

    Args:
        prepared_cloud: Points of the scene, metres.
        regions: Partition of the same points.
        graph: Features and edges of the regions.
        annotated: What the budget shows; instances are rows of its boxes.
        probabilities: (N, C + 1) softmax, background last; NaN or zero rows where the network saw nothing; None in the
            first round.
        centers: (N, 3) voted object centres, metres, or None.
        previous: Labels of the last round, or None.
        strategy: Thresholds and schedule.
        round: 0 .. strategy.rounds.
        priors: (C, 3) usual sizes, metres; NaN for a class without a labelled box, which then gets no pseudo box.
        class_counts: (C,) or (C + 1,) annotated labels of each class; breaks ties.
        height_above_ground: Metres above the ground of each point, or None.
        rules: When a group of points is an object, and when a region cannot be one.
        evidence: Predicted boxes, and the score that a pseudo box needs.

    Raises:
        ValueError: A row count does not fit.
    """
    rules = rules or ObjectRules()
    xyz, background = prepared_cloud.xyz, len(priors)
    check_rows(len(xyz), regions=regions.labels, annotated=annotated, height_above_ground=height_above_ground)
    truth = known_by_boxes(xyz, annotated, background)
    counts = _pad(class_counts, background + 1)
    grouped = _group(prepared_cloud, regions, graph, truth, probabilities, centers, strategy, round, counts, rules)
    surely, large = _background_points(xyz, regions, priors, height_above_ground, rules, truth)
    supported = supported_points(previous, grouped, strategy)
    if supported is not None and previous is not None:
        supported &= ~(large & (previous.semantic == background))  # asked again below, in every round
    objects = find_objects(
        xyz,
        np.where((truth.semantic < 0) & ~surely, grouped.points, -1),
        grouped.groups,
        annotated.boxes,
        priors,
        None if height_above_ground is None else xyz[:, 2] - height_above_ground,
        (0.0, 0.0) if prepared_cloud.sensor is None else (prepared_cloud.sensor[0], prepared_cloud.sensor[1]),
        _earlier_objects(previous, supported),
        _votes(probabilities, centers, len(xyz)),
        rules,
        evidence,
    )
    draft = overlay(draft_of(grouped), objects.rejected, UNLABELLED, 0.0)
    draft = overlay(draft, surely | (large & (objects.point_box < 0)), background, BACKGROUND_CONFIDENCE)
    draft = keep_previous(draft, previous, supported)
    draft, objects = _fill_boxes(xyz, draft, objects)
    draft = overlay(draft, truth.semantic >= 0, truth.semantic, 1.0)
    labels = _with_boxes(draft, truth, objects, annotated)
    return RefreshResult(labels, grouped.merge, refresh_stats(labels, grouped) | objects.counts, objects.candidates)


def _group(
    cloud: PointCloud,
    regions: Regions,
    graph: RegionGraph,
    truth: Truth,
    probabilities: Float[np.ndarray, 'points classes'] | None,
    centers: Float[np.ndarray, 'points 3'] | None,
    strategy: MergeStrategy,
    round: int,
    counts: Int[np.ndarray, ' classes'],
    rules: ObjectRules,
) -> Grouped:
    """Merge the regions and name the groups, as far as this round and the rules of objects allow."""
    limits = _class_limits(rules, len(counts))
    grouped = group_regions(cloud, regions, graph, truth, probabilities, centers, strategy, round, counts, limits)
    grouped = _split(grouped, regions, probabilities, strategy, rules)
    if limits is not None:
        grouped = grouped._replace(groups=without_doubtful(grouped.groups, limits))
    return apply_quota(grouped, strategy, round)


def _class_limits(rules: ObjectRules, classes: int) -> Float[np.ndarray, ' classes'] | None:
    given = rules.class_gamma
    if given is not None and len(given) != classes:
        raise ValueError(f'ObjectRules.class_gamma: expected {classes} numbers (background last), got {len(given)}')
    return None if given is None else np.asarray(given, dtype=np.float64)


def _pad(counts: Int[np.ndarray, ' given'], classes: int) -> Int[np.ndarray, ' classes']:
    return np.append(counts, np.zeros(classes - len(counts), dtype=np.int64)).astype(np.int64)


def _split(
    grouped: Grouped,
    regions: Regions,
    probabilities: Float[np.ndarray, 'points classes'] | None,
    strategy: MergeStrategy,
    rules: ObjectRules,
) -> Grouped:
    if probabilities is None or rules.part_share > 1:
        return grouped
    groups, points = split_mixed(
        grouped.groups,
        grouped.points,
        regions.labels,
        probabilities,
        strategy.gamma,
        rules.part_share,
        rules.min_points,
    )
    return grouped._replace(groups=groups, points=points)


def _background_points(
    xyz: Float[np.ndarray, 'points 3'],
    regions: Regions,
    priors: Float[np.ndarray, 'classes 3'],
    height: Float[np.ndarray, ' points'] | None,
    rules: ObjectRules,
    truth: Truth,
) -> tuple[Bool[np.ndarray, ' points'], Bool[np.ndarray, ' points']]:
    """Points without an annotated class that are background whatever the network says, or unless it finds an object.

    Returns:
        Those on the ground, of regions that reach too high, or just outside an annotated box: surely. Those of regions
        that are too large: unless the network finds whole objects in them, such as a row of parked cars.
    """
    large = geometric_background(robust_extents(xyz, regions), None, priors, rules.background_ratio)
    of_large = point_values(large, regions.labels, False).astype(bool)
    surely = np.zeros(len(xyz), dtype=bool)
    if height is not None:
        small = np.zeros((len(regions), 3))
        tall = geometric_background(small, region_tops(height, regions), priors, rules.background_ratio)
        ground = (regions.labels < 0) & (height < GROUND_HEIGHT)
        surely = point_values(tall, regions.labels, False).astype(bool) | ground
    free = truth.seeds < 0
    return (surely & free) | truth.shell, of_large & free


def _earlier_objects(
    previous: PseudoLabels | None, supported: Bool[np.ndarray, ' points'] | None
) -> EarlierObjects | None:
    """Pseudo boxes of the last round of which some point still carries its label."""
    if previous is None or supported is None:
        return None
    points = np.where(supported, previous.instance, -1)
    alive = ~previous.box_is_annotated & np.isin(np.arange(len(previous.boxes)), points)
    rows = np.append(np.where(alive, np.cumsum(alive) - 1, -1), -1)
    return EarlierObjects(previous.boxes.select(alive), rows[points])


def _votes(
    probabilities: Float[np.ndarray, 'points classes'] | None, centers: Float[np.ndarray, 'points 3'] | None, count: int
) -> PointVotes:
    if probabilities is None:
        return PointVotes(np.full(count, -1, dtype=np.int64), None)
    likely = np.where(seen_rows(probabilities), np.nan_to_num(probabilities).argmax(axis=1), -1)
    return PointVotes(likely, centers)


def _fill_boxes(xyz: Float[np.ndarray, 'points 3'], draft: Draft, objects: Objects) -> tuple[Draft, Objects]:
    """Points in a pseudo box that are of its class or of which nothing else is known are its object's."""
    assert objects.boxes.scores is not None
    inside = points_in_boxes(xyz, objects.boxes.tensor)
    label = np.append(objects.boxes.labels, -1)[inside]
    fill = (inside >= 0) & (draft.semantic == UNLABELLED)
    own = fill | ((inside >= 0) & (objects.point_box < 0) & (draft.semantic == label))
    filled = overlay(draft, fill, label, np.append(objects.boxes.scores, 0.0)[inside])
    return filled, objects._replace(point_box=np.where(own, inside, objects.point_box))


def _with_boxes(draft: Draft, truth: Truth, objects: Objects, annotated: AnnotatedLabels) -> PseudoLabels:
    """Labels with true boxes first, and every point's row of them."""
    found, known = objects.boxes, annotated.boxes
    assert found.scores is not None and known.scores is not None
    own = (objects.point_box >= 0) & (np.append(found.labels, -1)[objects.point_box] == draft.semantic)
    instance = np.where(own, len(known) + objects.point_box, -1)
    instance = np.where(truth.semantic >= 0, truth.instance, instance)
    boxes = Boxes3D(
        np.concatenate([known.tensor, found.tensor]),
        np.concatenate([known.labels, found.labels]),
        np.concatenate([known.scores, found.scores]),
    )
    return PseudoLabels(
        semantic=draft.semantic,
        instance=instance.astype(np.int64),
        point_is_annotated=truth.semantic >= 0,
        confidence=draft.confidence,
        boxes=boxes,
        box_is_annotated=np.arange(len(boxes)) < len(known),
        complete=annotated.complete,
    )
