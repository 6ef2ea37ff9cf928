"""Precision, recall and coverage of instances as S3DIS is scored (METHOD 9).

Settled on purpose: a found instance hits a true one of its class at an overlap *above* .5, and a true instance is hit
once, so duplicates cost precision. ``asis_compat`` repeats the published script of ASIS: from .5 on, and several found
instances may hit the same true one, which raises both numbers; recall ends at 1, which the script passes. Found
instances that lie on points of unknown class are measured without those points.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.evaluation.functional.instance_overlap import InstanceOverlap
from rm3d_plugin.evaluation.functional.semantic_iou import mean_of_known


@dataclass(frozen=True, eq=False)
class InstancePrecisionRecall:
    """All shares in [0, 1].

    Attributes:
        classes: Evaluated classes.
        precision: (C,) share of the found instances that hit; 0 where none was found, NaN for a class without truth.
        recall: (C,) share of the true instances that were hit; NaN without truth.
        coverage: (C,) mean over scenes of the mean best overlap of the true instances; NaN without truth.
        weighted_coverage: (C,) the same, weighted by the true instances' points within a scene.
        truths: (C,) int64 true instances.
        found: (C,) int64 found instances.
        mean_precision: Over the classes with truth, 0 where none has; likewise the next three.
        mean_recall: mRec.
        mean_coverage: mCov.
        mean_weighted_coverage: mWCov.
    """

    classes: tuple[int, ...]
    precision: Float[np.ndarray, ' classes']
    recall: Float[np.ndarray, ' classes']
    coverage: Float[np.ndarray, ' classes']
    weighted_coverage: Float[np.ndarray, ' classes']
    truths: Int[np.ndarray, ' classes']
    found: Int[np.ndarray, ' classes']
    mean_precision: float
    mean_recall: float
    mean_coverage: float
    mean_weighted_coverage: float


def instance_precision_recall(
    scenes: Sequence[InstanceOverlap], classes: Sequence[int], overlap: float = 0.5, asis_compat: bool = False
) -> InstancePrecisionRecall:
    """Precision, recall and coverage over all scenes.

    Args:
        scenes: Results of :func:`instance_overlap` with the same classes.
        classes: Evaluated classes.
        overlap: Overlap that a hit must exceed (reach, with ``asis_compat``).
        asis_compat: Count as the script of ASIS does.
    """
    clean = [scene.without_unknown() for scene in scenes]
    rows = [_of_class(clean, label, overlap, asis_compat) for label in classes]
    table = np.array(rows, dtype=np.float64).reshape(-1, 6).T
    precision, recall, coverage, weighted = table[:4]
    return InstancePrecisionRecall(
        classes=tuple(classes),
        precision=precision,
        recall=recall,
        coverage=coverage,
        weighted_coverage=weighted,
        truths=table[4].astype(np.int64),
        found=table[5].astype(np.int64),
        mean_precision=mean_of_known(precision),
        mean_recall=mean_of_known(recall),
        mean_coverage=mean_of_known(coverage),
        mean_weighted_coverage=mean_of_known(weighted),
    )


def _of_class(scenes: Sequence[InstanceOverlap], label: int, overlap: float, compat: bool) -> tuple[float, ...]:
    """Precision, recall, coverage, weighted coverage, true and found instances of one class."""
    hits = truths = found = 0
    coverage, weighted = [], []
    for scene in scenes:
        mine, own = scene.labels == label, scene.truth_labels == label
        order = np.argsort(-scene.scores[mine], kind='stable')
        iou = scene.iou()[np.ix_(mine, own)][order]
        hits += _hits(iou, overlap, compat)
        truths, found = truths + int(own.sum()), found + int(mine.sum())
        if own.any():
            best = iou.max(axis=0, initial=0.0)
            coverage.append(best.mean())
            weighted.append(np.average(best, weights=scene.truth_sizes[own]))
    if not truths:
        return (np.nan, np.nan, np.nan, np.nan, 0, found)
    return (
        hits / found if found else 0.0,
        min(hits / truths, 1.0),
        float(np.mean(coverage)),
        float(np.mean(weighted)),
        truths,
        found,
    )


def _hits(iou: Float[np.ndarray, 'found truths'], overlap: float, compat: bool) -> int:
    """Found instances, best score first, that hit a true one."""
    if not iou.size:
        return 0
    if compat:
        return int((iou.max(axis=1) >= overlap).sum())
    free = np.ones(iou.shape[1], dtype=bool)
    hits = 0
    for row in iou:
        fits = np.where(free & (row > overlap), row, -1.0)
        if fits.max() >= 0:
            free[fits.argmax()] = False
            hits += 1
    return hits
