"""Panoptic quality of points (Kirillov et al., CVPR 2019) as SemanticKITTI's program counts it (METHOD 9).

A segment is the points of one class and one instance number; those without a number are one segment of their class, so
stuff is one segment a scene. A found segment hits a true one of its class at an overlap *above* .5, which at most one
can reach. Points of unknown class are taken out on both sides before. Segments of fewer than ``min_points`` points are
neither missed nor wrong, yet may hit.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from jaxtyping import Bool, Float, Int, Integer

from rm3d_plugin.evaluation.functional.semantic_iou import (
    IGNORED,
    Absent,
    confusion_counts,
    mean_of_known,
    semantic_scores,
)
from rm3d_plugin.ops.segment import number_pairs

MIN_POINTS = 50  # the program's; METHOD 9
OVERLAP = 0.5
Kind = Literal['all', 'things', 'stuff']


@dataclass(frozen=True, eq=False)
class PanopticCounts:
    """Segments by class; scenes add up.

    Attributes:
        hits: (C,) int64 true segments that were found.
        overlap: (C,) sum of the overlaps of the hits.
        missed: (C,) int64 true segments that were not found.
        wrong: (C,) int64 found segments that hit nothing.
        confusion: (C, C + 1) points, see :func:`confusion_counts`.
    """

    hits: Int[np.ndarray, ' classes']
    overlap: Float[np.ndarray, ' classes']
    missed: Int[np.ndarray, ' classes']
    wrong: Int[np.ndarray, ' classes']
    confusion: Int[np.ndarray, 'classes columns']

    def __add__(self, other: 'PanopticCounts') -> 'PanopticCounts':
        return PanopticCounts(
            self.hits + other.hits,
            self.overlap + other.overlap,
            self.missed + other.missed,
            self.wrong + other.wrong,
            self.confusion + other.confusion,
        )

    @classmethod
    def none(cls, num_classes: int) -> 'PanopticCounts':
        """Of no scene."""
        zero = np.zeros(num_classes, dtype=np.int64)
        return cls(zero, np.zeros(num_classes), zero, zero, np.zeros((num_classes, num_classes + 1), dtype=np.int64))


@dataclass(frozen=True, eq=False)
class PanopticScores:
    """All shares in [0, 1].

    Attributes:
        quality: (C,) PQ = segmentation * recognition; NaN for a class that is left out, likewise below.
        segmentation: (C,) SQ, mean overlap of the hits; 0 without a hit.
        recognition: (C,) RQ, hits over hits and half of what was missed or wrong.
        iou: (C,) intersection over union of the points.
        is_thing: (C,) classes that have instances; the others are stuff.
    """

    quality: Float[np.ndarray, ' classes']
    segmentation: Float[np.ndarray, ' classes']
    recognition: Float[np.ndarray, ' classes']
    iou: Float[np.ndarray, ' classes']
    is_thing: Bool[np.ndarray, ' classes']

    def mean(self, values: Float[np.ndarray, ' classes'], kind: Kind = 'all') -> float:
        """Mean over all classes, things or stuff; 0 where there is none of them."""
        chosen = {'all': np.ones_like(self.is_thing), 'things': self.is_thing, 'stuff': ~self.is_thing}[kind]
        return mean_of_known(values[chosen])

    @property
    def dagger(self) -> float:
        """PQ-dagger (Porzi et al., CVPR 2019): the mean of PQ for things and of the IoU of points for stuff."""
        return mean_of_known(np.where(self.is_thing, self.quality, self.iou))


def panoptic_counts(
    semantic: Integer[np.ndarray, ' points'],
    instance: Integer[np.ndarray, ' points'],
    true_semantic: Integer[np.ndarray, ' points'],
    true_instance: Integer[np.ndarray, ' points'],
    num_classes: int,
    min_points: int = MIN_POINTS,
    ignored: Sequence[int] = IGNORED,
) -> PanopticCounts:
    """Compare the segments of a scene.

    Args:
        semantic: Found class of each point; any number outside 0 .. num_classes - 1 means "no class".
        instance: Found instance; one value, say -1, stands for "none".
        true_semantic: True class of each point.
        true_instance: True instance, likewise.
        num_classes: Number of classes C.
        min_points: Smaller segments are neither missed nor wrong.
        ignored: True values of points that do not count at all.

    Raises:
        ValueError: The rows differ in number, or a true value is neither a class nor ignored.
    """
    rows = [len(values) for values in (semantic, instance, true_semantic, true_instance)]
    if len(set(rows)) > 1:
        raise ValueError(f'panoptic_counts: expected one row a point, got {", ".join(map(str, rows))} rows')
    confusion = confusion_counts(semantic, true_semantic, num_classes, ignored)
    known = (true_semantic >= 0) & (true_semantic < num_classes)
    found_class, true_class = (part[known].astype(np.int64) for part in (semantic, true_semantic))
    found, found_first = number_pairs(found_class, instance[known])
    true, true_first = number_pairs(true_class, true_instance[known])
    found_size, true_size = (
        np.bincount(part, minlength=len(first))
        for part, first in zip((found, true), (found_first, true_first), strict=True)
    )
    same = found_class == true_class
    (pair, pair_first) = number_pairs(true[same], found[same])
    of_true, of_found = true[same][pair_first], found[same][pair_first]
    shared = np.bincount(pair, minlength=len(pair_first))
    iou = shared / (true_size[of_true] + found_size[of_found] - shared)
    hit = iou > OVERLAP

    def by_class(segments: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
        real = (segments >= 0) & (segments < num_classes)
        return np.bincount(segments[real], weights, minlength=num_classes)

    missed, wrong = true_size >= min_points, found_size >= min_points
    missed[of_true[hit]] = wrong[of_found[hit]] = False
    label = true_class[true_first]
    return PanopticCounts(
        hits=by_class(label[of_true[hit]]),
        overlap=by_class(label[of_true[hit]], iou[hit]).astype(np.float64),
        missed=by_class(label[missed]),
        wrong=by_class(found_class[found_first][wrong]),
        confusion=confusion,
    )


def panoptic_scores(counts: PanopticCounts, things: Sequence[int], absent: Absent = 'zero') -> PanopticScores:
    """Turn the counts of one scene or of many into shares.

    Args:
        counts: Of :func:`panoptic_counts`.
        things: Classes that have instances.
        absent: What becomes of a class without true segments that count: 'zero' gives it 0 in every mean, as the
            program does; 'skip' leaves it out.

    Raises:
        ValueError: A choice is unknown.
    """
    if absent not in get_args(Absent):
        raise ValueError(f'panoptic_scores: absent: expected one of {get_args(Absent)}, got {absent!r}')
    segmentation = counts.overlap / np.maximum(counts.hits, 1)
    recognition = counts.hits / np.maximum(counts.hits + (counts.missed + counts.wrong) / 2, 0.5)
    iou = np.nan_to_num(semantic_scores(counts.confusion, 'zero').iou)
    gone = (counts.hits + counts.missed == 0) & (absent == 'skip')
    return PanopticScores(
        quality=np.where(gone, np.nan, segmentation * recognition),
        segmentation=np.where(gone, np.nan, segmentation),
        recognition=np.where(gone, np.nan, recognition),
        iou=np.where(gone, np.nan, iou),
        is_thing=np.isin(np.arange(len(iou)), np.asarray(things, dtype=np.int64)),
    )
