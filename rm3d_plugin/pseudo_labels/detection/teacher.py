"""Pseudo boxes from the boxes that the network predicts: what speaks against each, and which are good enough.

A predicted box has to pass what is known of its class (size), of the scene (ground, annotated boxes, other boxes), and
of the network: what a good score is, the annotated objects tell, class by class, since the network was shown them; and
not more boxes pass than there seem to be objects. Between the two limits of a class nothing is said of a place (as in
HINTED, CVPR 2024). Nothing is kept from round to round, so a label may fall again.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.ops.box_reach import BoxReach, box_reach
from rm3d_plugin.ops.boxes import points_in_boxes, rotated_iou_bev
from rm3d_plugin.pseudo_labels.detection.boxes import has_usual_size, suppress
from rm3d_plugin.pseudo_labels.detection.objects import Objects
from rm3d_plugin.pseudo_labels.detection.rules import TeacherRules
from rm3d_plugin.structures import Boxes3D

IGNORED_MARGIN = 0.2  # m around a doubtful box in which nothing is said
ABOVE = 1.0  # m over a box, where the points of a pole, a trunk or a bush go on
FOUND_IOU = 0.25  # overlap from above from which a predicted box is that of an annotated object


class BoxLimits(NamedTuple):
    """What scores mean, class by class.

    Attributes:
        accept: (C,) score from which a candidate is a pseudo box.
        ignore: (C,) score under which its place may be background; in between nothing is said.
        expected: (C,) objects without an annotated box that all scenes seem to hold.
    """

    accept: Float[np.ndarray, ' classes']
    ignore: Float[np.ndarray, ' classes']
    expected: Float[np.ndarray, ' classes']


class Shown(NamedTuple):
    """What the network says of annotated objects.

    Attributes:
        labels: (K,) int64 their classes.
        scores: (K,) of the best predicted box of the class in their place, 0 = none.
        probs: (K,) mean probability of their points for the class.
    """

    labels: Int[np.ndarray, ' objects']
    scores: Float[np.ndarray, ' objects']
    probs: Float[np.ndarray, ' objects']


class Candidates(NamedTuple):
    """Predicted boxes of a scene that may be objects.

    Attributes:
        boxes: With scores, none in the place of another or of an annotated one.
        empty: (N,) points in boxes that are too low or too high for an object of any class; none where the size of a
            class is not known.
        steps: As :class:`~rm3d_plugin.pseudo_labels.detection.objects.Objects` has them.
        shown: What the network says of the scene's annotated objects.
    """

    boxes: Boxes3D
    empty: Bool[np.ndarray, ' points']
    steps: dict[str, Int[np.ndarray, ' classes']]
    shown: Shown


def teacher_candidates(
    xyz: Float[np.ndarray, 'points 3'],
    background: Bool[np.ndarray, ' points'],
    predicted: Boxes3D,
    shown: Shown,
    annotated: Boxes3D,
    ranges: Float[np.ndarray, 'classes 2 3'],
    rules: TeacherRules,
    height: Float[np.ndarray, ' points'] | None = None,
    alike: Bool[np.ndarray, ' predicted'] | None = None,
) -> Candidates:
    """Predicted boxes of the size and height of their class, with their place to themselves and points that end there.

    Args:
        xyz: Points, metres.
        background: Points that are background whatever the network says.
        predicted: Boxes with scores.
        shown: From :func:`ask_annotated`; handed on.
        annotated: Annotated boxes; these always win.
        ranges: Sizes, see :func:`~rm3d_plugin.pseudo_labels.detection.boxes.size_ranges`; NaN: the class gets no box.
        rules: Thresholds.
        height: Metres of each point above the ground; None: nobody asks how far up the points of a box reach.
        alike: Whether what each predicted box holds looks like its class, see
            :func:`~rm3d_plugin.pseudo_labels.detection.clusters.looks_like_its_class`; None: nobody asks.
    """
    steps = {'found': np.bincount(predicted.labels, minlength=len(ranges))}

    def left(boxes: Boxes3D, good: np.ndarray, step: str) -> Boxes3D:
        steps[step] = np.bincount(boxes.labels[~good], minlength=len(ranges))
        return boxes.select(good)

    sized = has_usual_size(predicted, ranges, rules.size_ratio)
    boxes = left(predicted, sized, 'size')
    boxes = left(boxes, np.ones(len(boxes), dtype=bool) if alike is None else alike[sized], 'looks')
    assert boxes.scores is not None
    alone = suppress(boxes, boxes.scores, annotated, rules.max_iou) == np.arange(len(boxes))
    boxes = left(boxes, alone, 'collision')
    boxes = left(boxes, _points_of(xyz[~background], boxes.tensor) >= rules.min_points, 'points')
    columns = columns_of(boxes, ranges, rules.top)
    held, above = (_points_of(*of) for of in ((xyz[~background], columns), (xyz, boxes_above(columns))))
    ends = held >= rules.free_above * (held + above)
    boxes, columns = left(boxes, ends, 'above'), columns[ends]
    if height is None or not rules.top:
        return Candidates(boxes, np.zeros(len(xyz), dtype=bool), steps, shown)
    owner = points_in_boxes(xyz, columns)
    inside, column = (box_reach(height, own, len(boxes)) for own in (points_in_boxes(xyz, boxes.tensor), owner))
    is_seen = inside.top + inside.gap >= rules.seen_height * boxes.tensor[:, 5]
    is_seen &= column.top + column.gap >= rules.lowest * ranges[boxes.labels, 0, 2]
    low, high = wrong_heights(column, ranges[:, :, 2], rules.top)
    too_high = high[boxes.labels, np.arange(len(boxes))]
    nothing = (low | high).all(axis=0) & np.isfinite(ranges).all()  # it has the height of no class, and all are known
    nothing &= ~is_seen | too_high  # what passes is a candidate
    boxes = left(boxes, is_seen, 'low')
    boxes = left(boxes, ~too_high[is_seen], 'high')
    return Candidates(boxes, (owner >= 0) & np.append(nothing, False)[owner], steps, shown)


def wrong_heights(
    reach: BoxReach, ranges: Float[np.ndarray, 'classes 2'], share: float
) -> tuple[Bool[np.ndarray, 'classes boxes'], Bool[np.ndarray, 'classes boxes']]:
    """Which boxes are too low, and which too high, for an object of each class.

    Args:
        reach: How far up their points reach.
        ranges: Least and greatest height of annotated boxes, metres; NaN: nothing is of the class.
        share: :attr:`TeacherRules.top`, above 0.
    """
    least, greatest = ranges[:, :1], ranges[:, 1:]
    return ~(reach.top + reach.gap >= share * least), reach.top > greatest / share


def columns_of(boxes: Boxes3D, ranges: Float[np.ndarray, 'classes 2 3'], share: float) -> Float[np.ndarray, 'boxes 7']:
    """The boxes, each up to where the tallest annotated box of its class would end: many are predicted too low.

    Args:
        boxes: That stand on the ground.
        ranges: Sizes of the classes.
        share: :attr:`TeacherRules.top`: the tallest, over this share; 0: the boxes as they are.
    """
    columns = boxes.tensor.copy()
    if share:
        rise = np.maximum(ranges[boxes.labels, 1, 2] / share - columns[:, 5], 0.0)
        columns[:, 2] += rise / 2
        columns[:, 5] += rise
    return columns


def boxes_above(boxes: Float[np.ndarray, 'boxes 7'], height: float = ABOVE) -> Float[np.ndarray, 'boxes 7']:
    """Boxes of so many metres that stand on the given ones."""
    above = boxes.copy()
    above[:, 2] += (boxes[:, 5] + height) / 2
    above[:, 5] = height
    return above


def _points_of(xyz: Float[np.ndarray, 'points 3'], boxes: Float[np.ndarray, 'boxes 7']) -> Int[np.ndarray, ' boxes']:
    inside = points_in_boxes(xyz, boxes)
    return np.bincount(inside[inside >= 0], minlength=len(boxes))


def ask_annotated(
    annotated: Boxes3D,
    instance: Int[np.ndarray, ' points'],
    predicted: Boxes3D,
    probabilities: Float[np.ndarray, 'points classes'] | None,
) -> Shown:
    """What the network says of the annotated objects of a scene.

    Args:
        annotated: Their boxes.
        instance: Row of ``annotated`` of each point, -1 = none.
        predicted: Boxes with scores.
        probabilities: Softmax of the points, NaN where the network saw none; None: it saw none at all.
    """
    labels = annotated.labels
    assert predicted.scores is not None
    if not len(annotated):
        return Shown(labels, np.zeros(0), np.zeros(0))
    overlap = rotated_iou_bev(annotated.tensor, predicted.tensor)
    same = (labels[:, None] == predicted.labels[None]) & (overlap >= FOUND_IOU)
    scores = np.where(same, predicted.scores[None], 0.0).max(axis=1, initial=0.0)
    probs = np.zeros(len(labels))
    for row, label in enumerate(labels.tolist()):
        own = np.zeros(0) if probabilities is None else probabilities[instance == row, label]
        probs[row] = own[np.isfinite(own)].mean() if np.isfinite(own).any() else 0.0
    return Shown(labels, scores, probs)


def joined_shown(parts: Sequence[Shown]) -> Shown:
    """Those of all scenes."""
    empty = Shown(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0))
    return Shown(*(np.concatenate(column) for column in zip(empty, *parts, strict=True)))


def lower_mean(scores: Float[np.ndarray, ' scores']) -> float:
    """Mean of the lower part where scores fall into two: the split of least squares (k-means, k = 2); 0 for no two.

    >>> lower_mean(np.array([0.1, 0.2, 0.8, 0.9]))
    0.15
    """
    ordered = np.sort(scores)
    if len(ordered) < 2:
        return 0.0
    below = np.arange(1, len(ordered))
    sums = np.cumsum(ordered)[:-1]
    low, high = sums / below, (ordered.sum() - sums) / (len(ordered) - below)
    spread = below * (len(ordered) - below) * (high - low) ** 2
    return float(round(low[int(spread.argmax())], 12))


def box_limits(
    found: Boxes3D,
    shown: Shown,
    num_classes: int,
    rules: TeacherRules,
    scenes_ratio: float = 1.0,
    expected: Float[np.ndarray, ' classes'] | None = None,
    most: Float[np.ndarray, ' classes'] | None = None,
) -> BoxLimits:
    """Limits of each class from the scores of the candidates of all scenes.

    A box is taken for an object with a probability of (its score over the median score of annotated objects)^2, 1 at
    most: squared, since many doubtful boxes are to count little beside a few good ones. As many objects are expected as
    these add up to, where nothing else tells the number. The best are accepted, no more than are expected, from a share
    of that median on.

    Args:
        found: Candidates with scores.
        shown: What the network says of annotated objects.
        num_classes: C.
        rules: ``share`` and ``recognised`` are asked.
        scenes_ratio: All scenes, over those that the candidates are of.
        expected: (C,) objects in all scenes, as completely labelled scenes tell, or None.
        most: (C,) objects to expect at most, or None: a network that learnt from pseudo boxes confirms them.

    Returns:
        A class without annotated objects, or whose annotated objects the network does not recognise, accepts nothing
        (infinity).
    """
    assert found.scores is not None
    accept, ignore, number = np.full(num_classes, np.inf), np.zeros(num_classes), np.zeros(num_classes)
    for c in range(num_classes):
        scores, own = np.sort(found.scores[found.labels == c])[::-1], shown.labels == c
        usual = float(np.median(shown.scores[own])) if own.any() else 0.0
        ignore[c] = min(lower_mean(scores), rules.share * usual)
        worth = np.minimum(scores / max(usual, 1e-9), 1.0) ** 2
        number[c] = scenes_ratio * worth.sum() if expected is None else expected[c]
        number[c] = min(number[c], np.inf if most is None else most[c])
        best = scores[: int(np.ceil(number[c] / scenes_ratio))]
        if usual > 0 and len(best) and np.median(shown.probs[own]) >= rules.recognised:
            accept[c] = max(rules.share * usual, float(best[-1]))
    return BoxLimits(accept, ignore, number)


def expected_from_whole(
    counts: Sequence[Int[np.ndarray, ' classes']], others: int
) -> Float[np.ndarray, ' classes'] | None:
    """Objects to expect in other scenes from counts in completely labelled ones; None where there is no such scene."""
    return np.mean(counts, axis=0) * others if len(counts) else None


def most_expected(told: Sequence[float], found: Sequence[int], growth: float) -> Float[np.ndarray, ' classes']:
    """How many objects of each class a round may expect: any number where the last had no pseudo box.

    Args:
        told: (C,) objects that the last round expected.
        found: (C,) pseudo boxes that it had.
        growth: :attr:`TeacherRules.growth`.

    >>> most_expected([20.0, 90.0], [20, 0], 2.0)
    array([40., inf])
    """
    return np.where(np.asarray(found) > 0, growth * np.asarray(told, dtype=np.float64), np.inf)


def teacher_objects(
    xyz: Float[np.ndarray, 'points 3'], candidates: Candidates, limits: BoxLimits, num_classes: int
) -> Objects:
    """The accepted boxes, and the points of which nothing is said: in a doubtful box and in no accepted one."""
    boxes = candidates.boxes
    assert boxes.scores is not None
    good = boxes.scores >= limits.accept[boxes.labels]
    doubtful = ~good & (boxes.scores >= limits.ignore[boxes.labels])
    accepted = boxes.select(good)
    point_box = points_in_boxes(xyz, accepted.tensor)
    unsure = points_in_boxes(xyz, boxes.tensor[doubtful], margin=IGNORED_MARGIN) >= 0
    unknown = np.isinf(limits.accept[boxes.labels])
    why = {'unrecognised': unknown, 'doubt': doubtful & ~unknown, 'score': ~good & ~doubtful & ~unknown}
    steps = candidates.steps | {
        step: np.bincount(boxes.labels[lost], minlength=num_classes) for step, lost in why.items()
    }
    counts = {'pseudo_boxes': float(len(accepted)), 'doubtful_boxes': float(doubtful.sum())}
    return Objects(accepted, point_box, unsure & (point_box < 0), counts, boxes, steps)
