"""Average precision of instances as ScanNet counts it (METHOD 9).

Settled on purpose: overlaps are .5, .55 .. .9 (.95 is left out, as in the official program) and .25, and must be
*exceeded*. The official greedy matching can depend on the order of the predictions at .25, where one of them may
overlap several true instances; here predictions take their true instance by falling score (ties: the lower row), each
the free one that it overlaps most (ties: the lower class and number), so the order of the rows is of no account.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from rm3d_plugin.evaluation.functional.instance_overlap import InstanceOverlap
from rm3d_plugin.evaluation.functional.semantic_iou import mean_of_known

OVERLAPS = (0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9)
MIN_POINTS = 100  # smaller instances are ignored, true and found ones


@dataclass(frozen=True, eq=False)
class InstanceAp:
    """All in [0, 1].

    Attributes:
        classes: Evaluated classes.
        overlaps: Overlaps of ``table``.
        table: (overlaps, C) average precision; NaN for a class without truth.
        ap: (C,) mean over .5 .. .9.
        ap50: (C,) at .5.
        ap25: (C,) at .25.
        mean_ap: Mean of ``ap`` over the classes with truth; 0 where none has. Likewise the next two.
        mean_ap50: Of ``ap50``.
        mean_ap25: Of ``ap25``.
    """

    classes: tuple[int, ...]
    overlaps: tuple[float, ...]
    table: Float[np.ndarray, 'overlaps classes']
    ap: Float[np.ndarray, ' classes']
    ap50: Float[np.ndarray, ' classes']
    ap25: Float[np.ndarray, ' classes']
    mean_ap: float
    mean_ap50: float
    mean_ap25: float


class Matches(NamedTuple):
    """Found instances that count, and how many true ones there are.

    Attributes:
        scores: (K,) of hits and false alarms; ignored ones are left out.
        is_hit: (K,) bool.
        truths: Number of true instances that count.
    """

    scores: Float[np.ndarray, ' found']
    is_hit: Bool[np.ndarray, ' found']
    truths: int


def match_instances(scene: InstanceOverlap, label: int, overlap: float, min_points: int) -> Matches:
    """Hits and false alarms of one class in one scene.

    Left out of the count are: instances under ``min_points`` points; what overlaps a true instance that small by more
    than ``overlap``; and what hits nothing, but lies by more than ``overlap`` of its points on void or on such small
    ones.
    """
    found = np.flatnonzero((scene.labels == label) & (scene.sizes >= max(min_points, 1)))
    found = found[np.argsort(-scene.scores[found], kind='stable')]
    own = np.flatnonzero(scene.truth_labels == label)
    big = scene.truth_sizes[own] >= min_points
    iou, shared = scene.iou()[np.ix_(found, own)], scene.shared[np.ix_(found, own)]
    free = big.copy()
    is_hit, counts = np.zeros((2, len(found)), dtype=bool)
    for row in range(len(found)):
        fits = np.where(free & (iou[row] > overlap), iou[row], -1.0)
        if len(own) and fits.max() >= 0:
            free[fits.argmax()] = False
            is_hit[row] = counts[row] = True
        elif (iou[row] > overlap).any():
            counts[row] = bool((iou[row] > overlap)[big].any())  # a second one on a taken truth; small truths excuse
        else:
            ignored = scene.void[found[row]] + shared[row][~big].sum()
            counts[row] = ignored / scene.sizes[found[row]] <= overlap
    return Matches(scene.scores[found][counts], is_hit[counts], int(big.sum()))


def trapezoid_ap(scores: Float[np.ndarray, ' found'], is_hit: Bool[np.ndarray, ' found'], truths: int) -> float:
    """Area under the precision-recall curve by trapezoids from (recall 0, precision 1); equal scores are one step.

    >>> trapezoid_ap(np.array([0.9, 0.8]), np.array([True, True]), 2)
    1.0
    >>> trapezoid_ap(np.array([0.9, 0.8]), np.array([False, True]), 1)
    0.25

    Raises:
        ValueError: A score is NaN, or there are more hits than truths: each truth is found once.
    """
    unknown, hits = int(np.isnan(scores).sum()), int(is_hit.sum())
    if unknown or hits > truths:
        raise ValueError(
            f'trapezoid_ap: expected scores that are numbers and at most {truths} hits, '
            f'got {unknown} NaN and {hits} hits'
        )
    if truths == 0 or len(scores) == 0:
        return 0.0
    order = np.argsort(-scores, kind='stable')
    falling = scores[order]  # compared, not subtracted: scores may be infinite
    last = np.append(np.flatnonzero(falling[1:] != falling[:-1]), len(order) - 1)  # last of each run of equal scores
    risen = np.cumsum(is_hit[order])[last]
    precision = np.append(1.0, risen / (last + 1))
    recall = np.append(0.0, risen / truths)
    return float((np.diff(recall) * (precision[1:] + precision[:-1]) / 2).sum())


def instance_ap(
    scenes: Sequence[InstanceOverlap],
    classes: Sequence[int],
    min_points: int = MIN_POINTS,
    overlaps: Sequence[float] = OVERLAPS,
) -> InstanceAp:
    """ScanNet's average precision over all scenes; AP50 and AP25 are always counted too.

    Args:
        scenes: Results of :func:`instance_overlap` with the same classes.
        classes: Evaluated classes.
        min_points: Smallest instance that counts.
        overlaps: Overlaps over which AP is a mean.
    """
    asked = tuple(dict.fromkeys((*overlaps, 0.5, 0.25)))
    table = np.full((len(asked), len(classes)), np.nan)
    for column, label in enumerate(classes):
        for row, overlap in enumerate(asked):
            matches = [match_instances(scene, label, overlap, min_points) for scene in scenes]
            truths = sum(m.truths for m in matches)
            if truths:
                scores = np.concatenate([m.scores for m in matches])
                table[row, column] = trapezoid_ap(scores, np.concatenate([m.is_hit for m in matches]), truths)
    ap = table[: len(overlaps)].mean(axis=0)
    ap50, ap25 = table[asked.index(0.5)], table[asked.index(0.25)]
    return InstanceAp(
        classes=tuple(classes),
        overlaps=asked,
        table=table,
        ap=ap,
        ap50=ap50,
        ap25=ap25,
        mean_ap=mean_of_known(ap),
        mean_ap50=mean_of_known(ap50),
        mean_ap25=mean_of_known(ap25),
    )
