"""One scene in, point labels out: merge its regions, and extend what is known of it (METHOD 1)."""

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.pseudo_labels.common.annotated import AnnotatedLabels, Truth, known_points
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
from rm3d_plugin.pseudo_labels.common.groups import confident_parts, nearest_instances, point_values
from rm3d_plugin.pseudo_labels.common.refresh_result import RefreshResult, refresh_stats
from rm3d_plugin.pseudo_labels.ground.labels import LevelLabels, level_labels, level_regions
from rm3d_plugin.pseudo_labels.segmentation.propagation import (
    mixed_regions,
    nearest_seeds,
    nearest_true_classes,
    quiet_seeds,
    unlike_seed,
)
from rm3d_plugin.regions import MergeStrategy
from rm3d_plugin.regions.features import region_lengths
from rm3d_plugin.structures import UNLABELLED, Boxes3D, PointCloud, PseudoLabels, RegionGraph, Regions


def refresh_points(
    prepared_cloud: PointCloud,
    regions: Regions,
    graph: RegionGraph,
    annotated: AnnotatedLabels,
    probabilities: Float[np.ndarray, 'points classes'] | None,
    centers: Float[np.ndarray, 'points 3'] | None,
    previous: PseudoLabels | None,
    strategy: MergeStrategy,
    round: int,
    class_counts: Int[np.ndarray, ' classes'],
    thing_classes: Int[np.ndarray, ' things'] | tuple[int, ...] = (),
    class_lengths: Float[np.ndarray, ' classes'] | None = None,
    prior: Float[np.ndarray, 'regions classes'] | None = None,
    ground: LevelLabels | None = None,
) -> RefreshResult:
    """Point labels of one scene of a segmentation run: classes and instances, no boxes.

    A group that holds annotated points takes their majority class (or each point of a region with several classes takes
    that of a near one, see ``strategy.mixed_regions``; points of quite another colour may be left out, see
    ``strategy.spread_color``, and what is said of a region too long for its class, see
    ``strategy.spread_extent``), and each of its points the instance of the nearest of them.
    On level regions the nearest annotated points, later with the network, name each point, and not the region
    (``strategy.level_regions``), or ``ground`` does.
    Other groups take the class that the network (and the ``prior``) gives them with confidence, and are one instance
    each, or none (``strategy.new_instances``).

    Args:
        prepared_cloud: Points of the scene, metres.
        regions: Partition of the same points.
        graph: Features and edges of the regions.
        annotated: What the budget shows; instances are any numbers >= 0.
        probabilities: (N, C) softmax; NaN or zero rows where the network saw nothing; None in the first round.
        centers: (N, 3) shifted points (voted instance centres), metres, or None.
        previous: Labels of the last round, or None.
        strategy: Thresholds and schedule.
        round: 0 .. strategy.rounds.
        class_counts: (C,) annotated points of each class; its length is the number of classes.
        thing_classes: Classes that have instances.
        class_lengths: (C,) metres, how long the region of an annotated point of each class usually is, for
            ``strategy.spread_extent``; NaN where unknown.
        prior: (R, C) what the regions may be by looks and place, with which the softmax is multiplied; in the first
            round it stands alone. None: the network alone is asked. See
            :mod:`~rm3d_plugin.pseudo_labels.region_prior.prior`.
        ground: What the points of level regions are, where it is known by their looks.

    Raises:
        ValueError: A row count does not fit.
    """
    xyz = prepared_cloud.xyz
    check_rows(len(xyz), regions=regions.labels, annotated=annotated)
    truth = known_points(annotated)
    counts = np.asarray(class_counts)
    spread = _that_spread(truth, regions, graph, class_lengths, strategy)
    level = point_values(level_regions(graph, strategy.level_regions), regions.labels, False)
    if ground is None:
        level &= bool((level & (spread.semantic >= 0)).any())
        ground = level_labels(xyz, level, spread.semantic, probabilities, strategy.level_reach)
    spread = _silent(spread, level)
    grouped = group_regions(
        prepared_cloud, regions, graph, spread, probabilities, centers, strategy, round, counts, None, prior
    )
    grouped = apply_quota(grouped, strategy, round)
    draft = draft_of(grouped)
    draft = _near_and_alike(draft, prepared_cloud, regions, spread, probabilities, previous, strategy)
    draft = overlay(draft, level, UNLABELLED, 0.0)  # their points are named one by one
    draft = keep_previous(draft, previous, supported_points(previous, grouped, strategy))
    draft = overlay(draft, ground.classes >= 0, *ground)
    draft = overlay(draft, truth.semantic >= 0, truth.semantic, 1.0)
    instance = _point_instances(xyz, draft.semantic, grouped, truth, thing_classes, strategy.new_instances)
    labels = PseudoLabels(
        semantic=draft.semantic,
        instance=instance,
        point_is_annotated=truth.semantic >= 0,
        confidence=draft.confidence,
        boxes=Boxes3D.empty(),
        box_is_annotated=np.zeros(0, dtype=bool),
        complete=annotated.complete,
    )
    return RefreshResult(labels, grouped.merge, refresh_stats(labels, grouped))


def _that_spread(
    truth: Truth,
    regions: Regions,
    graph: RegionGraph,
    class_lengths: Float[np.ndarray, ' classes'] | None,
    strategy: MergeStrategy,
) -> Truth:
    """The truth without the points whose region is too long for their class: those speak for themselves alone."""
    if strategy.spread_extent is None or class_lengths is None:
        return truth
    lengths = region_lengths(graph)
    quiet = quiet_seeds(regions.labels, truth.semantic, lengths, class_lengths, strategy.spread_extent)
    return _silent(truth, quiet)


def _silent(truth: Truth, points: Bool[np.ndarray, ' points']) -> Truth:
    """The truth without these points."""
    semantic = np.where(points, UNLABELLED, truth.semantic)
    return truth._replace(semantic=semantic, instance=np.where(points, -1, truth.instance), seeds=semantic)


def _near_and_alike(
    draft: Draft,
    cloud: PointCloud,
    regions: Regions,
    truth: Truth,
    probabilities: Float[np.ndarray, 'points classes'] | None,
    previous: PseudoLabels | None,
    strategy: MergeStrategy,
) -> Draft:
    """What the annotated points of a region say of its points one by one, where the strategy asks for that.

    They say the same in every round, so where labels stay only the points that they left out are asked for again.
    """
    colors = cloud.colors
    limit = None if colors is None else strategy.spread_color
    if strategy.mixed_regions == 'majority' and limit is None:
        return draft
    if previous is not None and strategy.permanent:
        if limit is None:
            return draft
        left_out = _seeded_points(regions, truth) & (previous.semantic < 0)
        return _ask_network(draft, regions, left_out, probabilities, strategy.gamma)
    asked = mixed_regions(regions.labels, truth.semantic) if limit is None else None
    places = (strategy.near_place, strategy.near_color)
    seeds = nearest_seeds(cloud.xyz, colors, regions.labels, truth.semantic, *places, asked)
    if strategy.mixed_regions == 'nearest':
        own = nearest_true_classes(regions.labels, truth.semantic, seeds)
        draft = overlay(draft, own >= 0, own, draft.confidence)
    if colors is None or limit is None:
        return draft
    return _ask_network(draft, regions, unlike_seed(colors, seeds, limit), probabilities, strategy.gamma)


def _seeded_points(regions: Regions, truth: Truth) -> Bool[np.ndarray, ' points']:
    """Points of regions with an annotated point."""
    seeded = np.zeros(len(regions) + 1, dtype=bool)
    seeded[regions.labels[truth.semantic >= 0]] = True
    seeded[-1] = False
    return seeded[regions.labels]


def _ask_network(
    draft: Draft,
    regions: Regions,
    points: Bool[np.ndarray, ' points'],
    probabilities: Float[np.ndarray, 'points classes'] | None,
    gamma: float,
) -> Draft:
    """Nothing but the network names these points, those of each region together."""
    draft = overlay(draft, points, UNLABELLED, 0.0)
    if probabilities is None:
        return draft
    return overlay(draft, points, *confident_parts(probabilities, regions.labels, points, gamma))


def _point_instances(
    xyz: Float[np.ndarray, 'points 3'],
    semantic: Int[np.ndarray, ' points'],
    grouped: Grouped,
    truth: Truth,
    thing_classes: Int[np.ndarray, ' things'] | tuple[int, ...],
    new_instances: bool,
) -> Int[np.ndarray, ' points']:
    """True instances spread to their group; a group without any may be a new instance, numbered after the true ones."""
    thing = np.isin(semantic, np.asarray(thing_classes, dtype=np.int64))
    spread = nearest_instances(xyz, grouped.points, semantic, truth.semantic, truth.instance)
    first = int(truth.instance.max(initial=-1)) + 1
    fresh = thing & (spread < 0) & (grouped.points >= 0) & new_instances
    _, number = np.unique(np.stack([grouped.points, semantic], axis=1)[fresh], axis=0, return_inverse=True)
    spread[fresh] = first + number.reshape(-1)
    instance = np.where(thing, spread, -1)
    return np.where(truth.semantic >= 0, truth.instance, instance).astype(np.int64)
