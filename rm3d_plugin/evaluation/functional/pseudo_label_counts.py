"""Pseudo labels counted against the hidden truth, which training never sees; the counts of scenes add up (METHOD 9)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int, Integer

from rm3d_plugin.evaluation.functional.offset_error import OffsetError, instance_centres, offset_error
from rm3d_plugin.evaluation.functional.semantic_iou import IGNORED
from rm3d_plugin.ops.rotated_iou import rotated_iou_3d, rotated_iou_bev
from rm3d_plugin.structures import UNLABELLED, Boxes3D, PseudoLabels

RANGE_EDGES = (0.0, 15.0, 30.0, 45.0)  # m from the sensor; the last bin is open
SAME_PLACE = 1e-4  # m; boxes are stored in float64, so this only forgives a reader's rounding


@dataclass(frozen=True, eq=False)
class SceneTruth:
    """The hidden truth of a scene, for reports only.

    Attributes:
        semantic: (N,) true class, -1 (or 255, where that is no class) = not known.
        instance: (N,) true instance, -1 = none; None where nobody knows them.
        xyz: (N, 3) metres, for the offset error; or None.
        boxes: Every true box, the annotated ones too; None in segmentation.
        ranges: (N,) metres to the sensor; None puts all points into the first bin.
    """

    semantic: Integer[np.ndarray, ' points']
    instance: Integer[np.ndarray, ' points'] | None = None
    xyz: Float[np.ndarray, 'points 3'] | None = None
    boxes: Boxes3D | None = None
    ranges: Float[np.ndarray, ' points'] | None = None


@dataclass(frozen=True)
class BoxMatch:
    """When a pseudo box is correct.

    Attributes:
        thresholds: IoU with a true box of its class from which it is, for each class.
        overlap: IoU from above or by volume.
    """

    thresholds: Sequence[float]
    overlap: Literal['bev', '3d'] = '3d'


@dataclass(frozen=True, eq=False)
class PointCounts:
    """Points by range bin and class; scenes add up.

    Attributes:
        present: (B, C) int64 points whose true class this is.
        labelled: (B, C) int64 of these, points with any pseudo label.
        given: (B, C) int64 points with a known truth to which this class was given.
        correct: (B, C) int64 of these, points whose true class it is.
    """

    present: Int[np.ndarray, 'bins classes']
    labelled: Int[np.ndarray, 'bins classes']
    given: Int[np.ndarray, 'bins classes']
    correct: Int[np.ndarray, 'bins classes']

    def __add__(self, other: 'PointCounts') -> 'PointCounts':
        return PointCounts(
            self.present + other.present,
            self.labelled + other.labelled,
            self.given + other.given,
            self.correct + other.correct,
        )


@dataclass(frozen=True, eq=False)
class BoxCounts:
    """Boxes by class; scenes add up.

    Attributes:
        annotated: (C,) int64 annotated boxes.
        given: (C,) int64 pseudo boxes.
        correct: (C,) int64 pseudo boxes that match one true box each.
        present: (C,) int64 true boxes that are known and not annotated.
    """

    annotated: Int[np.ndarray, ' classes']
    given: Int[np.ndarray, ' classes']
    correct: Int[np.ndarray, ' classes']
    present: Int[np.ndarray, ' classes']

    def __add__(self, other: 'BoxCounts') -> 'BoxCounts':
        return BoxCounts(
            self.annotated + other.annotated,
            self.given + other.given,
            self.correct + other.correct,
            self.present + other.present,
        )


@dataclass(frozen=True, eq=False)
class PseudoLabelCounts:
    """Counts of one or several scenes; they add up.

    Attributes:
        total: Points.
        labelled: Points with any label, annotated ones too.
        pseudo: (C,) points with a pseudo label of each class, whether the truth is known or not.
        scenes_with_truth: Scenes that the counts below are of.
        points: By range and class, without the annotated points.
        offsets: Errors of the pseudo instances' centres, without the annotated points.
        votes: Errors of the centres that the network votes for, over all points of true instances.
        boxes: None where no boxes are compared.
    """

    total: int
    labelled: int
    pseudo: Int[np.ndarray, ' classes']
    scenes_with_truth: int
    points: PointCounts
    offsets: OffsetError
    votes: OffsetError
    boxes: BoxCounts | None

    def __add__(self, other: 'PseudoLabelCounts') -> 'PseudoLabelCounts':
        return PseudoLabelCounts(
            self.total + other.total,
            self.labelled + other.labelled,
            self.pseudo + other.pseudo,
            self.scenes_with_truth + other.scenes_with_truth,
            self.points + other.points,
            self.offsets + other.offsets,
            self.votes + other.votes,
            self.boxes + other.boxes if self.boxes is not None and other.boxes is not None else None,
        )

    @classmethod
    def none(cls, num_classes: int, bins: int = 1, box_classes: int | None = None) -> 'PseudoLabelCounts':
        """Of no scene."""
        table = np.zeros((bins, num_classes), dtype=np.int64)
        offsets = OffsetError.none(num_classes)
        boxes = None if box_classes is None else np.zeros(box_classes, dtype=np.int64)
        return cls(
            0,
            0,
            table[0],
            0,
            PointCounts(table, table, table, table),
            offsets,
            offsets,
            None if boxes is None else BoxCounts(boxes, boxes, boxes, boxes),
        )


def count_points(
    labels: Int[np.ndarray, ' points'],
    truth: Int[np.ndarray, ' points'],
    num_classes: int,
    ranges: Float[np.ndarray, ' points'] | None = None,
    use: Bool[np.ndarray, ' points'] | None = None,
    range_edges: Sequence[float] = RANGE_EDGES,
) -> PointCounts:
    """Compare the labels of points with their truth.

    Args:
        labels: Pseudo class of each point, -1 = none.
        truth: True class, -1 = not known; such points do not count at all.
        num_classes: Number of classes.
        ranges: Distance to the sensor, metres; None puts all points into the first bin.
        use: Points that count; None: all.
        range_edges: Lower ends of the bins, metres, rising.

    Raises:
        ValueError: The rows differ in number, or a class is out of range.
    """
    if len(labels) != len(truth):
        raise ValueError(f'count_points: {len(labels)} labels, but {len(truth)} rows of truth')
    for name, values in (('labels', labels), ('truth', truth)):
        if len(values) and values.max() >= num_classes:
            raise ValueError(f'count_points: {name} hold class {values.max()}, expected classes below {num_classes}')
    bins = len(range_edges)
    where = np.zeros(len(labels), dtype=np.int64)
    if ranges is not None:
        where = np.clip(np.searchsorted(np.asarray(range_edges), ranges, side='right') - 1, 0, bins - 1)
    known = truth >= 0 if use is None else (truth >= 0) & use

    def table(classes: np.ndarray, rows: np.ndarray) -> np.ndarray:
        flat = where[rows] * num_classes + classes[rows]
        return np.bincount(flat, minlength=bins * num_classes).reshape(bins, num_classes)

    has_label = known & (labels >= 0)
    return PointCounts(
        present=table(truth, known),
        labelled=table(truth, has_label),
        given=table(labels, has_label),
        correct=table(labels, has_label & (labels == truth)),
    )


def count_boxes(labels: PseudoLabels, truth: Boxes3D | None, match: BoxMatch) -> BoxCounts:
    """Match pseudo boxes to the hidden true boxes of their class, best score first; each true box counts once.

    Args:
        labels: With annotated and pseudo boxes, the latter with scores.
        truth: Every true box, the annotated ones too; None: not known.
        match: When a pseudo box is correct.
    """
    classes = len(match.thresholds)
    pseudo = labels.boxes.select(~labels.box_is_annotated)
    hidden = Boxes3D.empty() if truth is None else _hidden(labels, truth)
    return BoxCounts(
        annotated=np.bincount(labels.boxes.labels[labels.box_is_annotated], minlength=classes),
        given=np.bincount(pseudo.labels, minlength=classes),
        correct=_correct_boxes(pseudo, hidden, match),
        present=np.bincount(hidden.labels, minlength=classes),
    )


def _correct_boxes(pseudo: Boxes3D, truth: Boxes3D, match: BoxMatch) -> Int[np.ndarray, ' classes']:
    correct = np.zeros(len(match.thresholds), dtype=np.int64)
    if len(pseudo) == 0 or len(truth) == 0:
        return correct
    assert pseudo.scores is not None
    iou = (rotated_iou_bev if match.overlap == 'bev' else rotated_iou_3d)(pseudo.tensor, truth.tensor)
    free = np.ones(len(truth), dtype=bool)
    for i in np.argsort(-pseudo.scores, kind='stable'):
        label = pseudo.labels[i]
        fit = np.where(free & (truth.labels == label), iou[i], -1.0)
        if fit.max() >= match.thresholds[label]:
            free[fit.argmax()] = False
            correct[label] += 1
    return correct


def _hidden(labels: PseudoLabels, truth: Boxes3D) -> Boxes3D:
    """The true boxes that were not annotated (an annotated one lies at the same place)."""
    annotated = labels.boxes.tensor[labels.box_is_annotated]
    if len(annotated) == 0 or len(truth) == 0:
        return truth
    gap = np.abs(truth.tensor[:, None, :3] - annotated[None, :, :3]).max(axis=2).min(axis=1)
    return truth.select(gap > SAME_PLACE)


def count_pseudo_labels(
    labels: PseudoLabels,
    truth: SceneTruth | None,
    num_classes: int,
    range_edges: Sequence[float] = (0.0,),
    match: BoxMatch | None = None,
    voted_centres: Float[np.ndarray, 'points 3'] | None = None,
) -> PseudoLabelCounts:
    """Compare the pseudo labels of a scene with its truth; annotated points count in the coverage of the whole only.

    Args:
        labels: Labels of the scene.
        truth: None where nobody knows it: then only what there is is counted.
        num_classes: Number of point classes; in detection the last is background.
        range_edges: Lower ends of the range bins, metres, rising.
        match: When a pseudo box is correct; None: boxes are not compared.
        voted_centres: Where the network sees each point's centre, metres; or None.

    Raises:
        ValueError: Rows differ in number, or a class is out of range.
    """
    hidden = ~labels.point_is_annotated
    nothing = PseudoLabelCounts.none(num_classes, len(range_edges))
    points, offsets, votes = nothing.points, nothing.offsets, nothing.votes
    if truth is not None:
        truth = replace(truth, semantic=without_ignored(truth.semantic, num_classes))
        points = count_points(labels.semantic, truth.semantic, num_classes, truth.ranges, hidden, range_edges)
        offsets, votes = _offsets(labels, truth, num_classes, voted_centres)
    return PseudoLabelCounts(
        total=len(labels),
        labelled=int((labels.semantic >= 0).sum()),
        pseudo=np.bincount(labels.semantic[(labels.semantic >= 0) & hidden], minlength=num_classes),
        scenes_with_truth=int(truth is not None),
        points=points,
        offsets=offsets,
        votes=votes,
        boxes=None if match is None else count_boxes(labels, None if truth is None else truth.boxes, match),
    )


def without_ignored(semantic: Integer[np.ndarray, ' points'], num_classes: int) -> Int[np.ndarray, ' points']:
    """True classes, -1 for the values that stand for "not known" and are no class."""
    ignored = [value for value in IGNORED if not 0 <= value < num_classes]
    return np.where(np.isin(semantic, ignored), UNLABELLED, np.asarray(semantic).astype(np.int64))


def _offsets(
    labels: PseudoLabels, truth: SceneTruth, num_classes: int, voted: Float[np.ndarray, 'points 3'] | None
) -> tuple[OffsetError, OffsetError]:
    """Errors of the pseudo instances' centres and of the voted ones."""
    if truth.instance is None or truth.xyz is None:
        return OffsetError.none(num_classes), OffsetError.none(num_classes)
    goal = instance_centres(truth.xyz, truth.semantic, truth.instance)
    pseudo = instance_centres(truth.xyz, labels.semantic, labels.instance)
    pseudo[labels.point_is_annotated] = np.nan
    votes = np.full_like(goal, np.nan) if voted is None else voted
    return (
        offset_error(pseudo, goal, truth.semantic, num_classes),
        offset_error(votes, goal, truth.semantic, num_classes),
    )
