"""One scene in, point and box labels out: merge its regions, and find the objects among the groups (METHOD 1)."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.ops.segment import segment_values
from rm3d_plugin.pseudo_labels.common.annotated import AnnotatedLabels, PointAnnotation, points_of_boxes
from rm3d_plugin.pseudo_labels.common.assembly import (
    Grouped,
    LabelAssembly,
    group_regions,
    keep_previous,
    labels_of_groups,
    limit_new_labels,
    pool_predictions,
    supported_points,
)
from rm3d_plugin.pseudo_labels.common.groups import likely_classes, without_doubtful
from rm3d_plugin.pseudo_labels.common.inputs import RoundContext, SceneInputs
from rm3d_plugin.pseudo_labels.common.refresh_result import RefreshResult, refresh_stats
from rm3d_plugin.pseudo_labels.detection.boxes import (
    geometric_background,
    region_tops,
    robust_extents,
    size_ranges,
)
from rm3d_plugin.pseudo_labels.detection.clusters import (
    ObjectClusters,
    like_clusters,
    looks_like_its_class,
    named_clusters,
    unlike_clusters,
)
from rm3d_plugin.pseudo_labels.detection.instances import boxes_of_instances, predicted_instances
from rm3d_plugin.pseudo_labels.detection.objects import (
    EarlierObjects,
    Evidence,
    ObjectContext,
    Objects,
    PointGroups,
    PointVotes,
    find_objects,
    fit_object,
)
from rm3d_plugin.pseudo_labels.detection.parts import PartLimits, split_mixed
from rm3d_plugin.pseudo_labels.detection.rules import DetectionRules, ObjectRules, TeacherRules
from rm3d_plugin.pseudo_labels.detection.teacher import (
    BoxLimits,
    Candidates,
    ask_annotated,
    teacher_candidates,
    teacher_objects,
)
from rm3d_plugin.structures import UNLABELLED, Boxes3D, PseudoLabels

BACKGROUND_CONFIDENCE = 0.9  # of what geometry alone calls background
GROUND_HEIGHT = 0.15  # m; points of no region that are lower than this above ground are ground


@dataclass(frozen=True, eq=False)
class ObjectKnowledge:
    """What is known of objects beside a scene's points.

    Attributes:
        mean_sizes: (C, 3) usual sizes, metres; NaN for a class without an annotated box, which then gets no pseudo box.
        height: (N,) metres above the ground of each point, or None.
        limits: (C,) score that a pseudo box of each class needs; None: any.
        box_limits: What the scores of predicted boxes mean, where these become pseudo boxes; None: no box does.
        ranges: (C, 2, 3) sizes of annotated boxes, see
            :func:`~rm3d_plugin.pseudo_labels.detection.boxes.size_ranges`; None: ``mean_sizes`` alone.
        clusters: Of the points above the ground, where rules ask for them; None: there are none.
    """

    mean_sizes: Float[np.ndarray, 'classes 3']
    height: Float[np.ndarray, ' points'] | None = None
    limits: Float[np.ndarray, ' classes'] | None = None
    box_limits: BoxLimits | None = None
    ranges: Float[np.ndarray, 'classes 2 3'] | None = None
    clusters: ObjectClusters | None = None


class _Background(NamedTuple):
    """Points without an annotated class that are background.

    Attributes:
        surely: Whatever the network says: on the ground, of regions that reach too high, or just outside an annotated
            box.
        large: Of regions that are too large: unless the network finds whole objects in them, such as a row of parked
            cars.
    """

    surely: Bool[np.ndarray, ' points']
    large: Bool[np.ndarray, ' points']


def refresh_detection(
    scene: SceneInputs, round: RoundContext[DetectionRules], knowledge: ObjectKnowledge
) -> RefreshResult:
    """Point and box labels of one scene of a detection run.

    Annotated boxes label their points exactly and propagate nowhere. Elsewhere a group of regions takes the class that
    the network gives it with confidence, and every group of an object class becomes a pseudo box, if it is plausible
    and no annotated or better box is in its place. With ``rules.teacher`` the boxes that the network predicts become
    pseudo boxes instead, anew in every round. Regions that no object can be are background from the first round on;
    only one that is merely too large may still turn out to hold objects.

    Args:
        scene: Geometry, annotated boxes, prediction (background last) and the labels of the last round.
        round: Rules and schedule; (C,) or (C + 1,) counts.
        knowledge: Sizes of objects, heights, and the score that is asked for.

    Raises:
        ValueError: A row count does not fit.
    """
    scene.check_rows(height_above_ground=knowledge.height)
    background = len(knowledge.mean_sizes)
    round = replace(round, class_counts=_pad(round.class_counts, background + 1))
    annotation = points_of_boxes(scene.xyz, scene.annotated, background)
    grouped = _group(scene, round, annotation)
    empty = _background_points(scene, annotation, knowledge, round.rules.objects)

    if round.rules.teacher is None:
        objects, labels = _objects_of_groups(scene, round, knowledge, annotation, grouped, empty)
    else:
        objects, labels = _objects_of_teacher(scene, round.rules, knowledge, annotation, empty)
    labels, objects = _fill_boxes(scene.xyz, labels, objects)
    labels = labels.overlay(annotation.known, annotation.semantic, 1.0)
    finished = _with_boxes(labels, annotation, objects, scene.annotated)
    stats = refresh_stats(finished, grouped) | objects.counts
    return RefreshResult(finished, grouped.with_record(), stats, objects.candidates, objects.steps)


def _objects_of_groups(
    scene: SceneInputs,
    round: RoundContext[DetectionRules],
    knowledge: ObjectKnowledge,
    annotation: PointAnnotation,
    grouped: Grouped,
    empty: _Background,
) -> tuple[Objects, LabelAssembly]:
    """Objects among the groups, and the labels of points; those of the last round stay where they are supported."""
    background = len(knowledge.mean_sizes)
    supported = supported_points(scene.previous, grouped, round.rules.merge)
    if supported is not None and scene.previous is not None:
        supported &= ~(empty.large & (scene.previous.semantic == background))  # asked again below, in every round
    objects = find_objects(
        _object_context(scene, knowledge, round.rules.objects),
        PointGroups(np.where(~annotation.known & ~empty.surely, grouped.points, -1), grouped.groups),
        scene.annotated.boxes,
        _earlier_objects(scene.previous, supported),
        Evidence(None if scene.prediction is None else scene.prediction.boxes, knowledge.limits),
    )
    labels = labels_of_groups(grouped).overlay(objects.rejected, UNLABELLED, 0.0)
    labels = labels.overlay(empty.surely | (empty.large & (objects.point_box < 0)), background, BACKGROUND_CONFIDENCE)
    return objects, keep_previous(labels, scene.previous, supported)


def find_candidates(scene: SceneInputs, rules: DetectionRules, knowledge: ObjectKnowledge) -> Candidates:
    """Predicted boxes of a scene that may be objects; what scores mean is told once those of all scenes are known.

    Raises:
        ValueError: There are no rules for predicted boxes.
    """
    if rules.teacher is None:
        raise ValueError('find_candidates: DetectionRules.teacher is None; give it rules')
    annotation = points_of_boxes(scene.xyz, scene.annotated, len(knowledge.mean_sizes))
    return _candidates(
        scene, rules, knowledge, annotation, _surely_background(scene, annotation, knowledge, rules.objects)
    )


def _candidates(
    scene: SceneInputs,
    rules: DetectionRules,
    knowledge: ObjectKnowledge,
    annotation: PointAnnotation,
    background: Bool[np.ndarray, ' points'],
) -> Candidates:
    assert rules.teacher is not None
    boxes = _proposed(scene, rules.teacher, _object_context(scene, knowledge, rules.objects), knowledge)
    known, sizes = scene.annotated.boxes, knowledge.ranges
    if sizes is None:
        sizes = size_ranges(np.zeros((0, 7)), np.zeros(0, dtype=np.int64), knowledge.mean_sizes)
    shown = ask_annotated(known, annotation.instance, boxes, scene.probabilities)
    if rules.teacher.source == 'clusters':
        shown = shown._replace(scores=shown.probs * np.minimum(_clusters(knowledge, 'source').annotated, 1.0))
    alike = None
    if rules.teacher.least_likeness:
        clusters = _clusters(knowledge, 'least_likeness')
        alike = looks_like_its_class(clusters, scene.xyz, boxes, rules.teacher.usual_likeness)
    return teacher_candidates(scene.xyz, background, boxes, shown, known, sizes, rules.teacher, knowledge.height, alike)


def _clusters(knowledge: ObjectKnowledge, field: str) -> ObjectClusters:
    if knowledge.clusters is None:
        raise ValueError(f'predicted_boxes.{field}: needs clusters, but nobody gave them (ObjectKnowledge.clusters)')
    return knowledge.clusters


def _proposed(scene: SceneInputs, rules: TeacherRules, context: ObjectContext, knowledge: ObjectKnowledge) -> Boxes3D:
    """Boxes that the network predicts, or those around the instances that it makes or around clusters."""
    said = scene.prediction
    if said is None:
        return Boxes3D.empty()
    if rules.source == 'clusters':
        clusters = _clusters(knowledge, 'source')
        return boxes_of_instances(context, named_clusters(clusters, said.probabilities))
    if rules.source == 'boxes':
        return Boxes3D.empty() if said.boxes is None else said.boxes
    if said.centers is None:
        raise ValueError(
            "predicted_boxes.source: 'instances' needs where points vote to, which this network does not say"
        )
    found = predicted_instances(said.probabilities, said.centers, context.mean_sizes, rules.min_points)
    return boxes_of_instances(context, found)


def _objects_of_teacher(
    scene: SceneInputs,
    rules: DetectionRules,
    knowledge: ObjectKnowledge,
    annotation: PointAnnotation,
    empty: _Background,
) -> tuple[Objects, LabelAssembly]:
    """Objects among the predicted boxes; background by geometry, and outside the boxes where the network is sure."""
    assert rules.teacher is not None
    background, sure = len(knowledge.mean_sizes), rules.teacher.background
    found = _candidates(scene, rules, knowledge, annotation, empty.surely)
    limits = knowledge.box_limits or BoxLimits(*np.full((3, background), np.inf))
    objects = teacher_objects(scene.xyz, found, limits, background)
    if rules.teacher.refit:
        objects = _refitted(objects, _object_context(scene, knowledge, rules.objects), empty.surely)
    free = (objects.point_box < 0) & ~objects.rejected & (annotation.seeds < 0)
    nothing_there, spared = empty.surely | found.empty, np.zeros(len(free), dtype=bool)
    if rules.teacher.least_likeness:
        clusters = _clusters(knowledge, 'least_likeness')
        nothing_there |= clusters.points_of(unlike_clusters(clusters, rules.teacher.least_likeness))
        spared = clusters.points_of(like_clusters(clusters, rules.teacher.usual_likeness))
    empty_points = (nothing_there & (objects.point_box < 0)) | (empty.large & free)
    if sure is not None and scene.probabilities is not None:
        empty_points |= free & ~spared & (np.nan_to_num(scene.probabilities[:, background]) >= sure)
    nothing = LabelAssembly(np.full(len(scene.xyz), UNLABELLED), np.zeros(len(scene.xyz), dtype=np.float32))
    return objects, nothing.overlay(empty_points, background, BACKGROUND_CONFIDENCE)


def _refitted(objects: Objects, context: ObjectContext, background: Bool[np.ndarray, ' points']) -> Objects:
    """The class's usual box fitted to the points of each box, where the object shows enough of them."""
    tensor = objects.boxes.tensor.copy()
    for row, label in enumerate(objects.boxes.labels.tolist()):
        members = np.flatnonzero((objects.point_box == row) & ~background)
        if len(members) >= context.rules.min_points:
            tensor[row] = fit_object(context, members, label).box
    boxes = Boxes3D(tensor, objects.boxes.labels, objects.boxes.scores)
    return objects._replace(boxes=boxes, point_box=points_in_boxes(context.xyz, tensor))


def _pad(counts: Int[np.ndarray, ' given'], classes: int) -> Int[np.ndarray, ' classes']:
    return np.append(counts, np.zeros(classes - len(counts), dtype=np.int64)).astype(np.int64)


def _group(scene: SceneInputs, round: RoundContext[DetectionRules], annotation: PointAnnotation) -> Grouped:
    """Merge the regions and name the groups, as far as this round and the rules of objects allow."""
    limits = _class_limits(round.rules.objects, len(round.class_counts))
    grouped = group_regions(scene, round, annotation, pool_predictions(scene, round))
    grouped = _cut_out_parts(grouped, scene, round)
    if limits is not None:
        record = replace(grouped.record, class_gamma=limits)
        grouped = grouped._replace(groups=without_doubtful(grouped.groups, limits), record=record)
    return limit_new_labels(grouped, round)


def _class_limits(rules: ObjectRules, classes: int) -> Float[np.ndarray, ' classes'] | None:
    given = rules.class_gamma
    if given is not None and len(given) != classes:
        raise ValueError(f'ObjectRules.class_gamma: expected {classes} numbers (background last), got {len(given)}')
    return None if given is None else np.asarray(given, dtype=np.float64)


def _cut_out_parts(grouped: Grouped, scene: SceneInputs, round: RoundContext[DetectionRules]) -> Grouped:
    rules, probabilities = round.rules.objects, scene.probabilities
    if probabilities is None or rules.part_share > 1:
        return grouped
    limits = PartLimits(round.rules.merge.gamma, rules.part_share, rules.min_points)
    regions = scene.geometry.regions.labels
    groups, points = split_mixed(grouped.groups, grouped.points, regions, probabilities, limits)
    return grouped._replace(groups=groups, points=points)


def _background_points(
    scene: SceneInputs, annotation: PointAnnotation, knowledge: ObjectKnowledge, rules: ObjectRules
) -> _Background:
    regions, sizes = scene.geometry.regions, knowledge.mean_sizes
    large = geometric_background(robust_extents(scene.xyz, regions), None, sizes, rules.background_ratio)
    of_large = segment_values(large, regions.labels, False).astype(bool)
    return _Background(_surely_background(scene, annotation, knowledge, rules), of_large & (annotation.seeds < 0))


def _surely_background(
    scene: SceneInputs, annotation: PointAnnotation, knowledge: ObjectKnowledge, rules: ObjectRules
) -> Bool[np.ndarray, ' points']:
    """See :class:`_Background`."""
    regions, height = scene.geometry.regions, knowledge.height
    if height is None:
        return annotation.shell
    flat = np.zeros((len(regions), 3))
    tall = geometric_background(flat, region_tops(height, regions), knowledge.mean_sizes, rules.background_ratio)
    ground = (regions.labels < 0) & (height < GROUND_HEIGHT)
    surely = segment_values(tall, regions.labels, False).astype(bool) | ground
    return np.asarray((surely & (annotation.seeds < 0)) | annotation.shell)


def _object_context(scene: SceneInputs, knowledge: ObjectKnowledge, rules: ObjectRules) -> ObjectContext:
    sensor = scene.geometry.cloud.sensor
    return ObjectContext(
        scene.xyz,
        knowledge.mean_sizes,
        None if knowledge.height is None else scene.xyz[:, 2] - knowledge.height,
        (0.0, 0.0) if sensor is None else (sensor[0], sensor[1]),
        _votes(scene),
        rules,
    )


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


def _votes(scene: SceneInputs) -> PointVotes:
    probabilities = scene.probabilities
    if probabilities is None:
        return PointVotes(np.full(len(scene.xyz), -1, dtype=np.int64), None)
    return PointVotes(likely_classes(probabilities), scene.centers)


def _fill_boxes(
    xyz: Float[np.ndarray, 'points 3'], labels: LabelAssembly, objects: Objects
) -> tuple[LabelAssembly, Objects]:
    """Points in a pseudo box that are of its class or of which nothing else is known are its object's."""
    assert objects.boxes.scores is not None
    inside = points_in_boxes(xyz, objects.boxes.tensor)
    label = np.append(objects.boxes.labels, -1)[inside]
    fill = (inside >= 0) & (labels.semantic == UNLABELLED)
    own = fill | ((inside >= 0) & (objects.point_box < 0) & (labels.semantic == label))
    filled = labels.overlay(fill, label, np.append(objects.boxes.scores, 0.0)[inside])
    return filled, objects._replace(point_box=np.where(own, inside, objects.point_box))


def _with_boxes(
    labels: LabelAssembly, annotation: PointAnnotation, objects: Objects, annotated: AnnotatedLabels
) -> PseudoLabels:
    """Labels with annotated boxes first, and every point's row of them."""
    found, known = objects.boxes, annotated.boxes
    assert found.scores is not None and known.scores is not None
    own = (objects.point_box >= 0) & (np.append(found.labels, -1)[objects.point_box] == labels.semantic)
    instance = np.where(own, len(known) + objects.point_box, -1)
    instance = np.where(annotation.known, annotation.instance, instance)
    boxes = Boxes3D(
        np.concatenate([known.tensor, found.tensor]),
        np.concatenate([known.labels, found.labels]),
        np.concatenate([known.scores, found.scores]),
    )
    return PseudoLabels(
        semantic=labels.semantic,
        instance=instance.astype(np.int64),
        point_is_annotated=annotation.known,
        confidence=labels.confidence,
        boxes=boxes,
        box_is_annotated=np.arange(len(boxes)) < len(known),
        complete=annotated.complete,
    )
