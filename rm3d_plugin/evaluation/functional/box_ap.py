"""Average precision of boxes with all-point interpolation, as indoor detection counts it (METHOD 9: AP25, AP50).

The same numbers as VoteNet's and mmdetection3d's programs: a hit overlaps by more than the threshold, and classes count
that have truth. (mmdetection3d also averages over classes that were found but never true, which makes its mean NaN.)
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from rm3d_plugin.ops.boxes import rotated_iou_3d
from rm3d_plugin.structures import Boxes3D


class BoxAp(NamedTuple):
    """Result at one overlap threshold; all shares in [0, 1].

    Attributes:
        iou: A detection hits above this 3D overlap.
        ap: (C,) average precision; NaN where a class has no truth.
        recall: (C,) greatest recall; NaN where a class has no truth.
        mean_ap: Over the classes with truth; 0 where none has.
        mean_recall: The same of the recall.
    """

    iou: float
    ap: Float[np.ndarray, ' classes']
    recall: Float[np.ndarray, ' classes']
    mean_ap: float
    mean_recall: float = 0.0


def all_point_ap(is_hit: Bool[np.ndarray, ' found'], num_truth: int) -> float:
    """Area under the precision envelope of detections sorted by falling score.

    >>> all_point_ap(np.array([True, False, True]), 2)
    0.8333333333333333
    """
    if len(is_hit) == 0:
        return 0.0
    hits = np.cumsum(is_hit)
    precision = hits / np.arange(1, len(is_hit) + 1)
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    return float((envelope * is_hit).sum() / num_truth)


def box_ap(
    ground_truths: Sequence[Boxes3D],
    detections: Sequence[Boxes3D],
    num_classes: int,
    iou_thresholds: Sequence[float] = (0.25, 0.5),
) -> tuple[BoxAp, ...]:
    """Average precision of each class at each threshold.

    Detections are taken by falling score over all scenes (ties: the earlier scene and row). Each belongs to the truth
    of its class that it overlaps most; it hits if the overlap exceeds the threshold and no better detection took that
    truth.

    Args:
        ground_truths: True boxes of each scene.
        detections: Found boxes with scores, of the same scenes.
        num_classes: Number of classes; other class numbers are passed over.
        iou_thresholds: 3D overlaps above which a detection hits.

    Raises:
        ValueError: The numbers of scenes differ, or a score is NaN.
    """
    if len(ground_truths) != len(detections):
        raise ValueError(f'box_ap: {len(ground_truths)} scenes of truth, {len(detections)} of detections')
    ap, recall = np.full((2, len(iou_thresholds), num_classes), np.nan)
    for number in range(num_classes):
        truths = [boxes.select(boxes.labels == number) for boxes in ground_truths]
        found = [boxes.select(boxes.labels == number) for boxes in detections]
        count = sum(map(len, truths))
        if count == 0:
            continue
        scores = np.concatenate([np.zeros(0), *(b.scores for b in found if b.scores is not None)])
        if np.isnan(scores).any():
            raise ValueError(f'box_ap: {int(np.isnan(scores).sum())} scores of class {number} are NaN')
        order = np.argsort(-scores, kind='stable')
        best = [_best_truth(f.tensor, t.tensor) for f, t in zip(found, truths, strict=True)]
        scene = np.repeat(np.arange(len(found)), [len(f) for f in found])
        index = np.concatenate([np.zeros(0, dtype=np.int64), *(b[0] for b in best)])
        overlap = np.concatenate([np.zeros(0), *(b[1] for b in best)])
        for k, iou in enumerate(iou_thresholds):
            taken: set[tuple[int, int]] = set()
            is_hit = np.zeros(len(order), dtype=bool)
            for rank, row in enumerate(order):
                key = (int(scene[row]), int(index[row]))
                if overlap[row] > iou and key not in taken:
                    taken.add(key)
                    is_hit[rank] = True
            ap[k, number] = all_point_ap(is_hit, count)
            recall[k, number] = is_hit.sum() / count
    return tuple(
        BoxAp(float(iou), ap[k], recall[k], _mean(ap[k]), _mean(recall[k])) for k, iou in enumerate(iou_thresholds)
    )


def _mean(values: Float[np.ndarray, ' classes']) -> float:
    return float(np.nanmean(values)) if np.isfinite(values).any() else 0.0


def _best_truth(
    found: Float[np.ndarray, 'found 7'], truth: Float[np.ndarray, 'truths 7']
) -> tuple[np.ndarray, np.ndarray]:
    """Number and overlap of the truth that each detection overlaps most; 0 and 0 without truth."""
    if len(truth) == 0:
        return np.zeros(len(found), dtype=np.int64), np.zeros(len(found))
    overlap = rotated_iou_3d(found, truth)
    index = overlap.argmax(axis=1)
    return index, overlap[np.arange(len(found)), index]
