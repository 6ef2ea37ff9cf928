"""How good a round's labels are, over all scenes: for the log and the report."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from rm3d_plugin.datasets.base import Truth
from rm3d_plugin.ops.rotated_iou import rotated_iou_bev
from rm3d_plugin.structures import UNLABELLED, PseudoLabels

MATCH_IOU = 0.25  # overlap from above from which a pseudo box counts as right
BACKGROUND = 'background'


def summarise(scenes: Iterable[tuple[PseudoLabels, Truth | None]], classes: Sequence[str]) -> dict[str, Any]:
    """Add up coverage, precision and kept boxes over the scenes of a round.

    Args:
        scenes: Labels and truth (None where nobody knows it) of each scene.
        classes: Names of the object classes.

    Returns:
        ``coverage``: share of all points with a label. ``points``: per class name, how many points have that pseudo
        label and, where the truth is known, ``precision``. ``boxes``: per class, revealed, pseudo, right (overlap from
        above of at least .25 with a true box of the class) and true ones.
    """
    names = [*classes, BACKGROUND]
    total = labelled = 0
    points = np.zeros((len(names), 3), dtype=np.int64)  # pseudo, judged, right
    boxes = np.zeros((len(classes), 4), dtype=np.int64)  # revealed, pseudo, right, true
    known = False
    for labels, truth in scenes:
        total += len(labels)
        labelled += int((labels.semantic != UNLABELLED).sum())
        known = known or truth is not None
        points += _points_of(labels, truth, len(names))
        boxes += _boxes_of(labels, truth, len(classes))
    return {
        'coverage': labelled / total if total else 0.0,
        'truth_known': known,
        'points': {
            name: {'pseudo': int(row[0]), 'precision': float(row[2] / row[1]) if row[1] else None}
            for name, row in zip(names, points, strict=True)
        },
        'boxes': {
            name: dict(zip(('revealed', 'pseudo', 'right', 'true'), map(int, row), strict=True))
            for name, row in zip(classes, boxes, strict=True)
        },
    }


def _points_of(labels: PseudoLabels, truth: Truth | None, count: int) -> np.ndarray:
    pseudo = (labels.semantic != UNLABELLED) & ~labels.point_is_true
    out = np.zeros((count, 3), dtype=np.int64)
    out[:, 0] = np.bincount(labels.semantic[pseudo], minlength=count)
    if truth is not None and truth.semantic is not None:
        judged = pseudo & (truth.semantic != UNLABELLED)
        out[:, 1] = np.bincount(labels.semantic[judged], minlength=count)
        out[:, 2] = np.bincount(labels.semantic[judged & (truth.semantic == labels.semantic)], minlength=count)
    return out


def _boxes_of(labels: PseudoLabels, truth: Truth | None, count: int) -> np.ndarray:
    out = np.zeros((count, 4), dtype=np.int64)
    out[:, 0] = np.bincount(labels.boxes.labels[labels.box_is_true], minlength=count)
    pseudo = labels.boxes.select(~labels.box_is_true)
    out[:, 1] = np.bincount(pseudo.labels, minlength=count)
    if truth is not None:
        out[:, 3] = np.bincount(truth.boxes.labels, minlength=count)
        same = pseudo.labels[:, None] == truth.boxes.labels[None]
        overlap = np.where(same, rotated_iou_bev(pseudo.tensor, truth.boxes.tensor), 0.0)
        right = overlap.max(axis=1, initial=0.0) >= MATCH_IOU
        out[:, 2] = np.bincount(pseudo.labels[right], minlength=count)
    return out


def describe_round(summary: dict[str, Any]) -> str:
    """One line for the log."""
    parts = [f'coverage {100 * summary["coverage"]:.1f} %']
    for name, row in summary['points'].items():
        precision = '' if row['precision'] is None else f' ({100 * row["precision"]:.0f} % right)'
        parts.append(f'{name} {row["pseudo"]} points{precision}')
    for name, row in summary['boxes'].items():
        judged = f', {row["right"]} right of {row["true"]} true' if summary['truth_known'] else ''
        parts.append(f'{name} boxes {row["revealed"]} revealed + {row["pseudo"]} pseudo{judged}')
    return '; '.join(parts)
