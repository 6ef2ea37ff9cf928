"""One scene in, point labels out: merge its regions, and extend what is known of it (METHOD 1)."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.ops.segment import segment_values
from rm3d_plugin.pseudo_labels.common.annotated import PointAnnotation, annotated_points
from rm3d_plugin.pseudo_labels.common.assembly import (
    Grouped,
    group_regions,
    keep_previous,
    labels_of_groups,
    limit_new_labels,
    pool_predictions,
    supported_points,
)
from rm3d_plugin.pseudo_labels.common.groups import Pooled, nearest_instances
from rm3d_plugin.pseudo_labels.common.inputs import RoundContext, SceneInputs
from rm3d_plugin.pseudo_labels.common.refresh_result import RefreshResult, refresh_stats
from rm3d_plugin.pseudo_labels.ground.labels import GroundLabels, ground_regions, nearest_ground_labels
from rm3d_plugin.pseudo_labels.ground.rules import GroundRules
from rm3d_plugin.pseudo_labels.region_prior.prior import with_prior
from rm3d_plugin.pseudo_labels.segmentation.propagation import (
    name_single_points,
    named_one_by_one,
    seeds_of_long_regions,
)
from rm3d_plugin.pseudo_labels.segmentation.rules import SegmentationRules
from rm3d_plugin.regions.features import region_lengths
from rm3d_plugin.structures import UNLABELLED, Boxes3D, PseudoLabels


@dataclass(frozen=True, eq=False)
class SceneKnowledge:
    """What all scenes together tell of one, where the rules ask for it.

    Attributes:
        class_lengths: (C,) metres, how long the region of an annotated point of each class usually is, for
            ``PropagationRules.max_extent``; NaN where unknown.
        prior: (R, C) what the regions may be, see :mod:`~rm3d_plugin.pseudo_labels.region_prior.prior`; None: the
            network alone is asked.
        ground: What the points of the ground are, where a classifier names them.
    """

    class_lengths: Float[np.ndarray, ' classes'] | None = None
    prior: Float[np.ndarray, 'regions classes'] | None = None
    ground: GroundLabels | None = None


def refresh_segmentation(
    scene: SceneInputs, round: RoundContext[SegmentationRules], knowledge: SceneKnowledge | None = None
) -> RefreshResult:
    """Point labels of one scene of a segmentation run: classes and instances, no boxes.

    A group that holds annotated points takes their majority class, as far as :class:`PropagationRules` let them speak
    for it, and each of its points the instance of the nearest of them. Points of the ground are named one by one
    (:class:`GroundRules`). Other groups take the class that the network (and the region prior) gives them with
    confidence.

    Args:
        scene: Geometry, annotated labels, prediction and the labels of the last round.
        round: Rules and schedule.
        knowledge: What all scenes together tell of this one.
    """
    knowledge = knowledge or SceneKnowledge()
    annotated = annotated_points(scene.annotated)
    speaking = _that_name_regions(scene, round, annotated, knowledge)
    ground = _ground(scene, speaking, knowledge.ground, round.rules.ground)
    speaking = speaking.without(ground.points)

    grouped = group_regions(scene, round, speaking, _likely_classes(scene, round, knowledge.prior))
    grouped = limit_new_labels(_with_named_regions(grouped, scene, round, ground), round)
    labels = name_single_points(labels_of_groups(grouped), scene, round, speaking)
    labels = labels.overlay(ground.points, UNLABELLED, 0.0)
    labels = keep_previous(labels, scene.previous, supported_points(scene.previous, grouped, round.rules.merge))
    labels = labels.overlay(ground.labels.classes >= 0, *ground.labels)
    labels = labels.overlay(annotated.known, annotated.semantic, 1.0)
    instance = _instances(scene, round, annotated, grouped, labels.semantic)
    finished = PseudoLabels(
        semantic=labels.semantic,
        instance=instance,
        point_is_annotated=annotated.known,
        confidence=labels.confidence,
        boxes=Boxes3D.empty(),
        box_is_annotated=np.zeros(0, dtype=bool),
        complete=scene.annotated.complete,
    )
    return RefreshResult(finished, grouped.with_record(), refresh_stats(finished, grouped))


def _that_name_regions(
    scene: SceneInputs, round: RoundContext[SegmentationRules], annotated: PointAnnotation, knowledge: SceneKnowledge
) -> PointAnnotation:
    """The annotation without the points whose region is too long for their class: those name themselves alone."""
    rules = round.rules.propagation
    if rules is None or rules.max_extent is None or knowledge.class_lengths is None:
        return annotated
    lengths, regions = region_lengths(scene.geometry.graph), scene.geometry.regions.labels
    long = seeds_of_long_regions(regions, annotated.semantic, lengths, knowledge.class_lengths * rules.max_extent)
    return annotated.without(long)


class _Ground(NamedTuple):
    """Regions and points of the ground, and their labels."""

    regions: Bool[np.ndarray, ' regions']
    points: Bool[np.ndarray, ' points']
    labels: GroundLabels


def _ground(
    scene: SceneInputs, speaking: PointAnnotation, known: GroundLabels | None, rules: GroundRules | None
) -> _Ground:
    """What is ground, and what its points are: as a classifier has it, else by the nearest annotated ones."""
    regions = ground_regions(scene.geometry.graph, None if rules is None else rules.min_upright)
    points = segment_values(regions, scene.geometry.regions.labels, False)
    if known is not None:
        return _Ground(regions, points, known)
    if not (points & speaking.known).any():  # nobody names them: they belong to their groups
        regions, points = np.zeros_like(regions), np.zeros_like(points)
    limit = None if rules is None else rules.max_distance
    return _Ground(
        regions, points, nearest_ground_labels(scene.xyz, points, speaking.semantic, scene.probabilities, limit)
    )


def _likely_classes(
    scene: SceneInputs, round: RoundContext[SegmentationRules], prior: Float[np.ndarray, 'regions classes'] | None
) -> Pooled:
    """What the regions are likely to be: the network's word, the prior's, or both."""
    pooled, rules = pool_predictions(scene, round), round.rules.region_prior
    if prior is None or rules is None:
        return pooled
    if scene.prediction is None:
        return Pooled(prior, scene.geometry.regions.sizes)
    return with_prior(pooled, prior, rules.inverse_temperature)


def _with_named_regions(
    grouped: Grouped, scene: SceneInputs, round: RoundContext[SegmentationRules], ground: _Ground
) -> Grouped:
    """Put on record which regions' points are named one by one."""
    colored = scene.geometry.cloud.colors is not None
    named = named_one_by_one(grouped.record.votes, round.rules.propagation, colored) | ground.regions
    return grouped._replace(record=replace(grouped.record, named=named))


def _instances(
    scene: SceneInputs,
    round: RoundContext[SegmentationRules],
    annotated: PointAnnotation,
    grouped: Grouped,
    semantic: Int[np.ndarray, ' points'],
) -> Int[np.ndarray, ' points']:
    """Annotated instances propagate in their group; a group without any may be a new one, numbered after those."""
    thing = np.isin(semantic, np.asarray(round.thing_classes, dtype=np.int64))
    found = nearest_instances(scene.xyz, grouped.points, semantic, annotated.semantic, annotated.instance)
    if round.rules.propagation is None or round.rules.propagation.new_instances:
        fresh = thing & (found < 0) & (grouped.points >= 0)
        _, number = np.unique(np.stack([grouped.points, semantic], axis=1)[fresh], axis=0, return_inverse=True)
        found[fresh] = int(annotated.instance.max(initial=-1)) + 1 + number.reshape(-1)
    instance = np.where(thing, found, -1)
    return np.where(annotated.known, annotated.instance, instance).astype(np.int64)
