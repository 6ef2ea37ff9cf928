"""How good pseudo labels are: coverage, precision, offset error (METHOD 9, the paper's Figure 8)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.pseudo_labels.common.quality import PointCounts, count_points


class OffsetError(NamedTuple):
    """Sums over points of true instances; the sums of several scenes add up.

    Attributes:
        metres: (C,) sum of the distances between the pseudo (or voted) and the true centre.
        points: (C,) int64 points that have both.
    """

    metres: Float[np.ndarray, ' classes']
    points: Int[np.ndarray, ' classes']


@dataclass(frozen=True, eq=False)
class PseudoLabelCounts:
    """Counts of one or several scenes; they add up.

    Attributes:
        points: By range and class, without the annotated points.
        offsets: Errors of the pseudo instances' centres, without the annotated points.
        votes: Errors of the centres that the network votes for, over all points of true instances.
        labelled: Points with any label, annotated ones too.
        total: Points.
    """

    points: PointCounts
    offsets: OffsetError
    votes: OffsetError
    labelled: int
    total: int

    def __add__(self, other: 'PseudoLabelCounts') -> 'PseudoLabelCounts':
        return PseudoLabelCounts(
            self.points + other.points,
            _sum(self.offsets, other.offsets),
            _sum(self.votes, other.votes),
            self.labelled + other.labelled,
            self.total + other.total,
        )


@dataclass(frozen=True, eq=False)
class PseudoLabelScores:
    """Shares in [0, 1]; NaN where there is nothing to divide by.

    Attributes:
        coverage: Share of all points with a label, annotated ones included.
        precision: Share of the pseudo labels that are right.
        class_coverage: (C,) share of a class's hidden points with any pseudo label.
        class_precision: (C,) share of a class's pseudo labels that are right.
        class_recall: (C,) share of a class's hidden points with the right pseudo label.
        range_coverage: (B,) coverage of hidden points by distance to the sensor.
        range_precision: (B,) precision by distance.
        offset_error: Metres from the pseudo instance's centre to the true one, mean over pseudo-labelled points.
        class_offset_error: (C,) the same by true class.
        vote_error: Metres from the voted centre to the true one, mean over points of true instances.
    """

    coverage: float
    precision: float
    class_coverage: Float[np.ndarray, ' classes']
    class_precision: Float[np.ndarray, ' classes']
    class_recall: Float[np.ndarray, ' classes']
    range_coverage: Float[np.ndarray, ' bins']
    range_precision: Float[np.ndarray, ' bins']
    offset_error: float
    class_offset_error: Float[np.ndarray, ' classes']
    vote_error: float


def instance_centres(
    xyz: Float[np.ndarray, 'points 3'], semantic: Int[np.ndarray, ' points'], instance: Int[np.ndarray, ' points']
) -> Float[np.ndarray, 'points 3']:
    """Centroid of the instance of each point, metres; NaN for points of none.

    Args:
        xyz: Points, metres.
        semantic: Class of each point, < 0 = none.
        instance: Instance of each point, < 0 = none; one number under two classes is two instances.
    """
    out = np.full((len(xyz), 3), np.nan)
    own = (instance >= 0) & (semantic >= 0)
    pairs, number = np.unique(np.stack([semantic, instance], axis=1)[own], axis=0, return_inverse=True)
    number = number.reshape(-1)
    size = np.maximum(np.bincount(number, minlength=len(pairs)), 1)
    sums = [np.bincount(number, weights=axis, minlength=len(pairs)) for axis in xyz[own].T.astype(np.float64)]
    out[own] = (np.stack(sums, axis=1) / size[:, None])[number]
    return out


def offset_error(
    centres: Float[np.ndarray, 'points 3'],
    true_centres: Float[np.ndarray, 'points 3'],
    truth: Int[np.ndarray, ' points'],
    num_classes: int,
) -> OffsetError:
    """Distances between two centres of each point by true class; a point without one of them does not count.

    The offset of a point is the way to its centre, so this is the length of the difference of two offsets.

    Args:
        centres: Pseudo or voted centre, metres, NaN = none.
        true_centres: True centre, metres, NaN = none.
        truth: True class.
        num_classes: Number of classes.
    """
    distance = np.linalg.norm(centres - true_centres, axis=1)
    used = np.isfinite(distance) & (truth >= 0) & (truth < num_classes)
    return OffsetError(
        np.bincount(truth[used], weights=distance[used], minlength=num_classes),
        np.bincount(truth[used], minlength=num_classes),
    )


def count_pseudo_labels(
    semantic: Int[np.ndarray, ' points'],
    instance: Int[np.ndarray, ' points'],
    is_annotated: Bool[np.ndarray, ' points'],
    truth: Int[np.ndarray, ' points'],
    true_instance: Int[np.ndarray, ' points'] | None,
    num_classes: int,
    xyz: Float[np.ndarray, 'points 3'] | None = None,
    voted_centres: Float[np.ndarray, 'points 3'] | None = None,
    ranges: Float[np.ndarray, ' points'] | None = None,
    range_edges: Sequence[float] = (0.0,),
) -> PseudoLabelCounts:
    """Compare the pseudo labels of a scene with its truth.

    Args:
        semantic: Label of each point, -1 = none.
        instance: Pseudo instance, -1 = none.
        is_annotated: The label was annotated by the budget; such points count in the coverage of the whole only.
        truth: True class, -1 or 255 = not known.
        true_instance: True instance, -1 = none; None: no offset error.
        num_classes: Number of classes.
        xyz: Points, metres; None: no offset error.
        voted_centres: Where the network sees each point's centre, metres; or None.
        ranges: Metres to the sensor; None: all in the first bin.
        range_edges: Lower ends of the bins, metres.

    Raises:
        ValueError: Rows differ in number, or a class is out of range.
    """
    truth = np.where(truth == 255, -1, truth) if num_classes <= 255 else truth
    points = count_points(semantic, truth, num_classes, ranges, ~is_annotated, range_edges)
    offsets = votes = OffsetError(np.zeros(num_classes), np.zeros(num_classes, dtype=np.int64))
    if true_instance is not None and xyz is not None:
        goal = instance_centres(xyz, truth, true_instance)
        pseudo = instance_centres(xyz, semantic, instance)
        pseudo[is_annotated] = np.nan
        offsets = offset_error(pseudo, goal, truth, num_classes)
        if voted_centres is not None:
            votes = offset_error(voted_centres, goal, truth, num_classes)
    return PseudoLabelCounts(points, offsets, votes, int((semantic >= 0).sum()), len(semantic))


def pseudo_label_scores(counts: PseudoLabelCounts) -> PseudoLabelScores:
    """Ratios of summed counts."""
    table, offsets = counts.points, counts.offsets
    by_class = [t.sum(axis=0) for t in (table.present, table.labelled, table.given, table.correct)]
    by_range = [t.sum(axis=1) for t in (table.present, table.labelled, table.given, table.correct)]
    present, labelled, given, correct = by_class
    return PseudoLabelScores(
        coverage=counts.labelled / counts.total if counts.total else float('nan'),
        precision=_mean(correct, given),
        class_coverage=_ratio(labelled, present),
        class_precision=_ratio(correct, given),
        class_recall=_ratio(correct, present),
        range_coverage=_ratio(by_range[1], by_range[0]),
        range_precision=_ratio(by_range[3], by_range[2]),
        offset_error=_mean(offsets.metres, offsets.points),
        class_offset_error=_ratio(offsets.metres, offsets.points),
        vote_error=_mean(counts.votes.metres, counts.votes.points),
    )


def _sum(a: OffsetError, b: OffsetError) -> OffsetError:
    return OffsetError(a.metres + b.metres, a.points + b.points)


def _ratio(part: np.ndarray, whole: np.ndarray) -> Float[np.ndarray, ' rows']:
    return np.where(whole > 0, part / np.maximum(whole, 1), np.nan)


def _mean(part: np.ndarray, whole: np.ndarray) -> float:
    return float(part.sum() / whole.sum()) if whole.sum() else float('nan')
