"""How good a round's labels are, over all scenes: for the log and the report."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from rm3d_plugin.pseudo_labels.quality import SceneTruth, pseudo_report
from rm3d_plugin.structures import PseudoLabels

MATCH_IOU = 0.25  # overlap from above from which a pseudo box counts as right
BACKGROUND = 'background'


def summarise(scenes: Sequence[tuple[PseudoLabels, SceneTruth | None]], classes: Sequence[str]) -> dict[str, Any]:
    """Add up coverage, precision and kept boxes over the scenes of a round.

    Args:
        scenes: Labels and truth (None where nobody knows it) of each scene.
        classes: Names of the object classes.

    Returns:
        ``coverage``: share of all points with a label. ``truth_known``: whether precision and right boxes mean
        anything. ``points``: per class name, how many points have that pseudo label and its ``precision``. ``ranges``:
        coverage and precision by distance. ``boxes``: per class ``revealed``, ``pseudo``, ``right`` (overlap from above
        of at least .25, each true box once) and ``true`` ones.
    """
    names = [*classes, BACKGROUND]
    known = [(labels, truth) for labels, truth in scenes if truth is not None]
    quality = pseudo_report(known, names, [MATCH_IOU] * len(classes), overlap='bev')
    judged = quality.as_dict()
    points = sum((_pseudo_points(labels, len(names)) for labels, _ in scenes), np.zeros(len(names), dtype=np.int64))
    boxes = sum((_boxes(labels, len(classes)) for labels, _ in scenes), np.zeros((2, len(classes)), dtype=np.int64))
    hidden, right = (quality.boxes.present, quality.boxes.correct) if quality.boxes is not None else (0 * boxes,) * 2
    total = sum(len(labels) for labels, _ in scenes)
    return {
        'coverage': sum(labels.coverage * len(labels) for labels, _ in scenes) / total if total else 0.0,
        'truth_known': bool(known),
        'points': {
            name: {'pseudo': int(points[c]), 'precision': judged['classes'][name]['precision']}
            for c, name in enumerate(names)
        },
        'ranges': judged['ranges'],
        'boxes': {
            name: {
                'revealed': int(boxes[0, c]),
                'pseudo': int(boxes[1, c]),
                'right': int(right[c]),
                'true': int(hidden[c] + boxes[0, c]),
            }
            for c, name in enumerate(classes)
        },
    }


def _pseudo_points(labels: PseudoLabels, count: int) -> np.ndarray:
    return np.bincount(labels.semantic[(labels.semantic >= 0) & ~labels.point_is_true], minlength=count)


def _boxes(labels: PseudoLabels, count: int) -> np.ndarray:
    revealed = np.bincount(labels.boxes.labels[labels.box_is_true], minlength=count)
    return np.stack([revealed, np.bincount(labels.boxes.labels[~labels.box_is_true], minlength=count)])


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
