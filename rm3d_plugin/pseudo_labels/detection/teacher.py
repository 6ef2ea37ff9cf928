"""Pseudo boxes from the boxes that the network predicts: what speaks against each, and which are good enough.

Labelled boxes are few, so a predicted box has to pass what is known of its class (size), of the scene (ground,
annotated boxes, other boxes), and of the network itself: the score is held against two limits that follow from the
scores of all scenes (HINTED, CVPR 2024), and not more pass than there seem to be objects. Nothing is kept from round to
round, so a label may fall again.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.pseudo_labels.detection.boxes import suppress
from rm3d_plugin.pseudo_labels.detection.objects import Objects
from rm3d_plugin.pseudo_labels.detection.rules import TeacherRules
from rm3d_plugin.structures import Boxes3D

IGNORED_MARGIN = 0.2  # m around a doubtful box in which nothing is said


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


class Candidates(NamedTuple):
    """Predicted boxes of a scene that may be objects.

    Attributes:
        boxes: With scores, none in the place of another or of an annotated one.
        steps: As :class:`~rm3d_plugin.pseudo_labels.detection.objects.Objects` has them.
    """

    boxes: Boxes3D
    steps: dict[str, Int[np.ndarray, ' classes']]


def teacher_candidates(
    xyz: Float[np.ndarray, 'points 3'],
    background: Bool[np.ndarray, ' points'],
    predicted: Boxes3D,
    annotated: Boxes3D,
    mean_sizes: Float[np.ndarray, 'classes 3'],
    rules: TeacherRules,
) -> Candidates:
    """Predicted boxes that have the size of their class, points, and their place to themselves.

    Args:
        xyz: Points, metres.
        background: Points that are background whatever the network says.
        predicted: Boxes with scores.
        annotated: Annotated boxes; these always win.
        mean_sizes: Usual sizes, metres; NaN: the class gets no box.
        rules: Thresholds.
    """
    steps = {'found': np.bincount(predicted.labels, minlength=len(mean_sizes))}

    def left(boxes: Boxes3D, good: np.ndarray, step: str) -> Boxes3D:
        steps[step] = np.bincount(boxes.labels[~good], minlength=len(mean_sizes))
        return boxes.select(good)

    boxes = left(predicted, has_usual_size(predicted, mean_sizes, rules.size_ratio), 'size')
    inside = points_in_boxes(xyz[~background], boxes.tensor)
    held = np.bincount(inside[inside >= 0], minlength=len(boxes))
    boxes = left(boxes, held >= rules.min_points, 'points')
    assert boxes.scores is not None
    alone = suppress(boxes, boxes.scores, annotated, rules.max_iou) == np.arange(len(boxes))
    return Candidates(left(boxes, alone, 'collision'), steps)


def has_usual_size(
    boxes: Boxes3D, mean_sizes: Float[np.ndarray, 'classes 3'], ratio: float
) -> Bool[np.ndarray, ' boxes']:
    """Whether length, width and height are those of the class, up to a factor."""
    with np.errstate(invalid='ignore'):
        apart = np.abs(np.log(boxes.tensor[:, 3:6] / mean_sizes[boxes.labels]))
        return np.asarray((apart <= np.log(ratio)).all(axis=1))


def two_groups(scores: Float[np.ndarray, ' scores']) -> tuple[float, float]:
    """Means of the lower and the upper part where scores fall into two: the split of least squares (k-means, k = 2).

    >>> two_groups(np.array([0.1, 0.2, 0.8, 0.9]))
    (0.15, 0.85)
    """
    ordered = np.sort(scores)
    if len(ordered) < 2:
        return 0.0, float(ordered.sum())
    below = np.arange(1, len(ordered))
    sums = np.cumsum(ordered)[:-1]
    low, high = sums / below, (ordered.sum() - sums) / (len(ordered) - below)
    spread = below * (len(ordered) - below) * (high - low) ** 2
    best = int(spread.argmax())
    return float(low[best]), float(high[best])


def score_limits_of(
    found: Boxes3D,
    num_classes: int,
    floor: float,
    scenes_ratio: float = 1.0,
    whole_scenes: Float[np.ndarray, ' classes'] | None = None,
) -> BoxLimits:
    """Limits of each class from the scores of the candidates of all scenes.

    The scores of a class fall into a lower and an upper part. From the middle of the two on a candidate is accepted, up
    to the mean of the lower part it may be background. As many objects are expected as the scores of the candidates
    over that mean add up to, where nobody labelled whole scenes; no more than that are accepted, the best first.

    Args:
        found: Candidates with scores.
        num_classes: C.
        floor: See :class:`TeacherRules`.
        scenes_ratio: All scenes, over those that the candidates are of.
        whole_scenes: (C,) objects that completely labelled scenes let expect in the others, or None.
    """
    assert found.scores is not None
    accept, ignore, expected = (np.ones(num_classes), np.zeros(num_classes), np.zeros(num_classes))
    for c in range(num_classes):
        scores = np.sort(found.scores[found.labels == c])[::-1]
        low, high = two_groups(scores)
        ignore[c] = min(low, floor)
        expected[c] = scenes_ratio * scores[scores > ignore[c]].sum() if whole_scenes is None else whole_scenes[c]
        best = scores[: int(np.ceil(expected[c] / scenes_ratio))]
        accept[c] = max(floor, (low + high) / 2, best[-1] if len(best) else 1.0)
    return BoxLimits(accept, ignore, expected)


def expected_from_whole(
    counts: Sequence[Int[np.ndarray, ' classes']], others: int
) -> Float[np.ndarray, ' classes'] | None:
    """Objects to expect in other scenes from counts in completely labelled ones; None where there is no such scene."""
    return np.mean(counts, axis=0) * others if len(counts) else None


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
    steps = candidates.steps | {
        'doubt': np.bincount(boxes.labels[doubtful], minlength=num_classes),
        'score': np.bincount(boxes.labels[~good & ~doubtful], minlength=num_classes),
    }
    counts = {'pseudo_boxes': float(len(accepted)), 'doubtful_boxes': float(doubtful.sum())}
    return Objects(accepted, point_box, unsure & (point_box < 0), counts, boxes, steps)
