"""How good pseudo labels are, against the truth that training never sees: for reports only (METHOD 9)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.ops.rotated_iou import rotated_iou_3d, rotated_iou_bev
from rm3d_plugin.structures import Boxes3D, PseudoLabels

RANGE_EDGES = (0.0, 15.0, 30.0, 45.0)  # m from the sensor; the last bin is open


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
    """Pseudo boxes by class; scenes add up.

    Attributes:
        present: (C,) int64 true boxes that were not annotated.
        given: (C,) int64 pseudo boxes.
        correct: (C,) int64 pseudo boxes that match one true box each.
    """

    present: Int[np.ndarray, ' classes']
    given: Int[np.ndarray, ' classes']
    correct: Int[np.ndarray, ' classes']

    def __add__(self, other: 'BoxCounts') -> 'BoxCounts':
        return BoxCounts(self.present + other.present, self.given + other.given, self.correct + other.correct)


@dataclass(frozen=True, eq=False)
class PseudoReport:
    """Quality of one round over all its scenes.

    Attributes:
        classes: Names; in detection the last is background.
        points: Counts of points, without those whose label was annotated.
        boxes: Counts of boxes, without the annotated ones, or None.
        coverage: Share of the points with a label (an annotated one or a pseudo label), in [0, 1].
        range_edges: Lower ends of the range bins, metres.
    """

    classes: tuple[str, ...]
    points: PointCounts
    boxes: BoxCounts | None
    coverage: float
    range_edges: tuple[float, ...]

    def as_dict(self) -> dict[str, Any]:
        """Ratios by name, for json; a ratio over nothing is None."""
        point, edges = self.points, self.range_edges
        out: dict[str, Any] = {
            'coverage': self.coverage,
            'precision': _ratio(point.correct.sum(), point.given.sum()),
            'classes': {
                name: _point_ratios(point, slice(None), slice(c, c + 1)) for c, name in enumerate(self.classes)
            },
            'ranges': {
                f'>={low:g} m': _point_ratios(point, slice(b, b + 1), slice(None)) for b, low in enumerate(edges)
            },
        }
        if self.boxes is not None:
            out['boxes'] = {
                name: {
                    'precision': _ratio(self.boxes.correct[c], self.boxes.given[c]),
                    'recall': _ratio(self.boxes.correct[c], self.boxes.present[c]),
                    'given': int(self.boxes.given[c]),
                    'present': int(self.boxes.present[c]),
                }
                for c, name in enumerate(self.classes[: len(self.boxes.given)])
            }
        return out


def _ratio(part: np.integer | int, whole: np.integer | int) -> float | None:
    return float(part) / float(whole) if whole else None


def _point_ratios(counts: PointCounts, bins: slice, classes: slice) -> dict[str, float | int | None]:
    present, labelled, given, correct = (
        int(table[bins, classes].sum()) for table in (counts.present, counts.labelled, counts.given, counts.correct)
    )
    return {
        'coverage': _ratio(labelled, present),
        'precision': _ratio(correct, given),
        'recall': _ratio(correct, present),
        'present': present,
        'given': given,
    }


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


def count_boxes(
    pseudo: Boxes3D,
    truth: Boxes3D,
    thresholds: Sequence[float],
    overlap: Literal['bev', '3d'] = '3d',
) -> BoxCounts:
    """Match pseudo boxes to true boxes of their class, best score first; each true box counts once.

    Args:
        pseudo: Pseudo boxes with scores.
        truth: Hidden true boxes.
        thresholds: IoU for each class from which a box counts as found.
        overlap: IoU from above or by volume.
    """
    assert pseudo.scores is not None
    classes = len(thresholds)
    iou = (rotated_iou_bev if overlap == 'bev' else rotated_iou_3d)(pseudo.tensor, truth.tensor)
    free = np.ones(len(truth), dtype=bool)
    correct = np.zeros(classes, dtype=np.int64)
    for i in np.argsort(-pseudo.scores, kind='stable'):
        label = pseudo.labels[i]
        fit = np.where(free & (truth.labels == label), iou[i], -1.0)
        if len(fit) and fit.max() >= thresholds[label]:
            free[fit.argmax()] = False
            correct[label] += 1
    return BoxCounts(
        present=np.bincount(truth.labels, minlength=classes),
        given=np.bincount(pseudo.labels, minlength=classes),
        correct=correct,
    )


@dataclass(frozen=True, eq=False)
class SceneTruth:
    """The hidden truth of a scene, for reports only.

    Attributes:
        semantic: (N,) int64 true class, -1 = not known.
        boxes: Every true box, the annotated ones too; or None in segmentation.
        ranges: (N,) metres to the sensor, or None.
    """

    semantic: Int[np.ndarray, ' points']
    boxes: Boxes3D | None = None
    ranges: Float[np.ndarray, ' points'] | None = None


def pseudo_report(
    scenes: Sequence[tuple[PseudoLabels, SceneTruth]],
    classes: Sequence[str],
    box_thresholds: Sequence[float] = (),
    overlap: Literal['bev', '3d'] = '3d',
    range_edges: Sequence[float] = RANGE_EDGES,
) -> PseudoReport:
    """Quality of the pseudo labels of a round; annotated labels and boxes do not count, except in the coverage.

    Args:
        scenes: Labels and truth of each scene.
        classes: Names of the point classes; in detection the last is background.
        box_thresholds: IoU for each box class; empty: boxes are not compared.
        overlap: IoU from above or by volume.
        range_edges: Lower ends of the range bins, metres.
    """
    zero = np.zeros((len(range_edges), len(classes)), dtype=np.int64)
    points = PointCounts(zero, zero, zero, zero)
    none = np.zeros(len(box_thresholds), dtype=np.int64)
    boxes = BoxCounts(none, none, none)
    total = labelled = 0
    for labels, truth in scenes:
        points += count_points(
            labels.semantic, truth.semantic, len(classes), truth.ranges, ~labels.point_is_annotated, range_edges
        )
        total, labelled = total + len(labels), labelled + int((labels.semantic >= 0).sum())
        if len(box_thresholds) and truth.boxes is not None:
            boxes += count_boxes(
                labels.boxes.select(~labels.box_is_annotated), _hidden(labels, truth.boxes), box_thresholds, overlap
            )
    coverage = labelled / total if total else 0.0
    compared = boxes if len(box_thresholds) else None
    return PseudoReport(tuple(classes), points, compared, coverage, tuple(range_edges))


def _hidden(labels: PseudoLabels, truth: Boxes3D) -> Boxes3D:
    """The true boxes that were not annotated (an annotated one lies at the same place)."""
    annotated = labels.boxes.tensor[labels.box_is_annotated]
    if len(annotated) == 0 or len(truth) == 0:
        return truth
    gap = np.abs(truth.tensor[:, None, :3] - annotated[None, :, :3]).max(axis=2).min(axis=1)
    return truth.select(gap > 1e-4)  # m; boxes are stored in float64, so this only forgives a reader's rounding
