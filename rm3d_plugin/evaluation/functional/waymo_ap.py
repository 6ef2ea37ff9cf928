"""Average precision as Waymo's detection benchmark counts it: AP, and APH, which weighs hits by their heading.

What the official program does, and so do we: at each score cutoff the detections of a class are matched to its truths
so that the sum of the overlaps is greatest (Hungarian, overlaps in millionths, single precision); a truth of level 2
that is found is a hit at level 1, too, and one that is missed counts at level 2 alone; the curve is integrated by
trapezoids over the greatest precision at or above each recall, filled in where recalls lie more than .05 apart.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment

from rm3d_plugin.ops.boxes import rotated_iou_3d
from rm3d_plugin.structures import Boxes3D

WAYMO_IOU: Mapping[str, float] = {'Vehicle': 0.7, 'Pedestrian': 0.5, 'Cyclist': 0.5, 'Sign': 0.5}
LEVELS = (1, 2)
CUTOFFS: tuple[float, ...] = tuple(i * 0.01 for i in range(100)) + (1.0,)
RECALL_STEP = 0.05
RANGES: Mapping[str, tuple[float, float]] = {'0-30 m': (0.0, 30.0), '30-50 m': (30.0, 50.0), '50 m+': (50.0, np.inf)}
_GRAINS = 1_000_000  # of an overlap


class WaymoTruth(NamedTuple):
    """What is to be found in one frame.

    Attributes:
        boxes: (M, 7) rows as :class:`~rm3d_plugin.structures.Boxes3D`.
        labels: (M,) class numbers; others than those evaluated are passed over.
        level: (M,) difficulty, 1 or 2.
    """

    boxes: Float[np.ndarray, 'boxes 7']
    labels: Int[np.ndarray, ' boxes']
    level: Int[np.ndarray, ' boxes']


class WaymoEntry(NamedTuple):
    """One cell of the table.

    Attributes:
        class_name: Class.
        level: 1 or 2.
        ap: In [0, 1]; NaN where there is no truth up to that level.
        aph: The same, hits weighted by their heading.
        num_truth: Truths up to the level.
    """

    class_name: str
    level: int
    ap: float
    aph: float
    num_truth: int


class _Counts(NamedTuple):
    """Sums over all frames, one for each cutoff."""

    hits: np.ndarray
    false: np.ndarray
    missed: np.ndarray  # (levels, cutoffs)
    heading: np.ndarray


def heading_accuracy(a: Float[np.ndarray, ' pairs'], b: Float[np.ndarray, ' pairs']) -> Float[np.ndarray, ' pairs']:
    """1 for the same heading, 0 for the opposite one; radians.

    >>> heading_accuracy(np.array([0.0, 0.0]), np.array([0.0, np.pi])).tolist()
    [1.0, 0.0]
    """
    apart = np.abs((a - b + np.pi) % (2 * np.pi) - np.pi)
    return np.clip(1.0 - apart / np.pi, 0.0, 1.0)


def match(
    overlap: Float[np.ndarray, 'found truths'], iou: float
) -> tuple[Int[np.ndarray, ' pairs'], Int[np.ndarray, ' pairs']]:
    """Rows and columns of the pairs that overlap by ``iou`` at least and together the most."""
    able = overlap >= np.float32(iou)
    rows, columns = linear_sum_assignment(np.where(able, np.round(overlap * _GRAINS), 0.0), maximize=True)
    hit = able[rows, columns]
    return rows[hit], columns[hit]


def waymo_ap(
    truths: Sequence[WaymoTruth],
    detections: Sequence[Boxes3D],
    classes: Sequence[str],
    iou_thresholds: Mapping[str, float] = WAYMO_IOU,
    cutoffs: Sequence[float] = CUTOFFS,
) -> tuple[WaymoEntry, ...]:
    """AP and APH of each class at both levels.

    Args:
        truths: One entry a frame; boxes without a lidar point left out, as the official program does.
        detections: Found boxes with scores in [0, 1], of the same frames.
        classes: Names of the class numbers.
        iou_thresholds: 3D overlap from which a detection hits, for each class.
        cutoffs: Scores at which the curve is sampled, ascending.

    Raises:
        ValueError: The numbers of frames differ, a class has no threshold, or a score is NaN.
    """
    if len(truths) != len(detections):
        raise ValueError(f'waymo_ap: {len(truths)} frames of truth, {len(detections)} of detections')
    if missing := [name for name in classes if name not in iou_thresholds]:
        raise ValueError(f'iou_thresholds: no value for class {missing[0]!r}; got {dict(iou_thresholds)}')
    if bad := sum(int(np.isnan(boxes.scores).sum()) for boxes in detections if boxes.scores is not None):
        raise ValueError(f'waymo_ap: {bad} scores are NaN')
    table = []
    for number, name in enumerate(classes):
        counts = _count(truths, detections, number, iou_thresholds[name], np.asarray(cutoffs, dtype=np.float32))
        levels = np.concatenate([t.level[t.labels == number] for t in truths] or [np.zeros(0, dtype=np.int64)])
        for i, level in enumerate(LEVELS):
            total = int((levels <= level).sum())
            ap, aph = _areas(counts, i) if total else (np.nan, np.nan)
            table.append(WaymoEntry(name, level, ap, aph, total))
    return tuple(table)


def of_range(
    truths: Sequence[WaymoTruth], detections: Sequence[Boxes3D], limits: tuple[float, float]
) -> tuple[list[WaymoTruth], list[Boxes3D]]:
    """Truths and detections whose middles lie so far from the vehicle's origin, metres; each side by its own place."""

    def inside(boxes: Float[np.ndarray, 'boxes 7']) -> np.ndarray:
        away = np.linalg.norm(boxes[:, :3], axis=1)
        return (away >= limits[0]) & (away < limits[1])

    kept = [inside(truth.boxes) for truth in truths]
    some = [WaymoTruth(*(values[keep] for values in truth)) for truth, keep in zip(truths, kept, strict=True)]
    return some, [boxes.select(inside(boxes.tensor)) for boxes in detections]


def _count(
    truths: Sequence[WaymoTruth], detections: Sequence[Boxes3D], number: int, iou: float, cutoffs: np.ndarray
) -> _Counts:
    size = len(cutoffs)
    total = _Counts(np.zeros(size), np.zeros(size), np.zeros((len(LEVELS), size)), np.zeros(size))
    for truth, found in zip(truths, detections, strict=True):
        assert found.scores is not None
        mine, wanted = found.labels == number, truth.labels == number
        boxes, level = truth.boxes[wanted], truth.level[wanted]
        scores = found.scores[mine].astype(np.float32)
        overlap = rotated_iou_3d(found.tensor[mine], boxes).astype(np.float32)
        there, sums = -1, (0, 0.0, np.zeros(len(LEVELS)))
        for i, cutoff in enumerate(cutoffs):
            kept = scores >= cutoff
            if there != kept.sum():  # cutoffs ascend: as many are the same ones
                rows, columns = match(overlap[kept], iou)
                accuracy = heading_accuracy(found.tensor[mine][kept][rows, 6], boxes[columns, 6])
                left = np.delete(level, columns)
                there = int(kept.sum())
                sums = len(rows), float(accuracy.sum()), np.array([(left <= x).sum() for x in LEVELS])
            total.hits[i] += sums[0]
            total.false[i] += there - sums[0]
            total.missed[:, i] += sums[2]
            total.heading[i] += sums[1]
    return total


def _areas(counts: _Counts, level: int) -> tuple[float, float]:
    found, true = counts.hits + counts.false, counts.hits + counts.missed[level]
    recall = np.divide(counts.hits, true, out=np.zeros_like(true), where=true > 0)
    areas = []
    for part in (counts.hits, counts.heading):
        precision = np.divide(part, found, out=np.zeros_like(found), where=found > 0)
        areas.append(area_under_curve(np.where(recall == 0, 1.0, precision), recall))
    return areas[0], areas[1]


def area_under_curve(precision: Float[np.ndarray, ' points'], recall: Float[np.ndarray, ' points']) -> float:
    """Area under the greatest precision at or above each recall, sampled where recalls lie far apart.

    The point (recall 0, precision 1) is no measurement: it takes the precision of its neighbour.

    >>> round(area_under_curve(np.array([0.5, 1.0]), np.array([1.0, 0.5])), 4)
    0.7625
    """
    best: dict[np.float32, np.float32] = {np.float32(0): np.float32(1)}
    for p, r in zip(precision.astype(np.float32), recall.astype(np.float32), strict=True):
        best[r] = max(best.get(r, np.float32(0)), p)
    curve: list[tuple[np.float32, np.float32]] = []  # (recall, greatest precision), falling recall
    highest, last = np.float32(0), np.float32(0)
    for r in sorted(best, reverse=True):
        while last - r > np.float32(RECALL_STEP) + np.float32(1e-6):
            last = last - np.float32(RECALL_STEP)
            curve.append((last, highest))
        highest, last = max(highest, best[r]), r
        curve.append((r, highest))
    if len(curve) >= 2:
        curve[-1] = (curve[-1][0], curve[-2][1])
    return float(sum(0.5 * (a[0] - b[0]) * (a[1] + b[1]) for a, b in zip(curve, curve[1:], strict=False)))
