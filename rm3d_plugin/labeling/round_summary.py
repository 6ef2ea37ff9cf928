"""How good a round's labels are, over all scenes: for the log and the report."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.common.quality import PointCounts, SceneTruth, count_points, pseudo_report
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
        coverage and precision by distance. ``boxes``: per class ``annotated``, ``pseudo``, ``right`` (overlap from
        above of at least .25, each true box once) and ``true`` ones.
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
                'annotated': int(boxes[0, c]),
                'pseudo': int(boxes[1, c]),
                'right': int(right[c]),
                'true': int(hidden[c] + boxes[0, c]),
            }
            for c, name in enumerate(classes)
        },
    }


class PointTruth(NamedTuple):
    """The hidden truth of a segmentation scene, for reports only.

    Attributes:
        xyz: (N, 3) metres.
        semantic: (N,) true class, -1 = not known.
        instance: (N,) true instance, -1 = none; or None where the data set has none.
    """

    xyz: Float[np.ndarray, 'points 3']
    semantic: Int[np.ndarray, ' points']
    instance: Int[np.ndarray, ' points'] | None


def summarise_points(
    scenes: Iterable[tuple[PseudoLabels, PointTruth | None]], classes: Sequence[str]
) -> dict[str, Any]:
    """Add up coverage, precision and offset errors over the scenes of a segmentation round; one scene at a time.

    Args:
        scenes: Labels and truth (None where nobody knows it) of each scene.
        classes: Names of the classes.

    Returns:
        ``coverage``: share of all points with a label. ``precision``: share of the pseudo labels that are right, and
        ``mean_precision``: its mean over the classes that were given; None where unknown. ``offset_error``: metres
        between the centres of pseudo and true instance, mean over points (see :func:`offset_errors`), or None.
        ``truth_known``. ``points``: per class name ``pseudo`` (points with that pseudo label), ``precision``,
        ``recall`` and ``coverage`` of the hidden points of the class, and ``offset_error``. ``boxes``: empty.
    """
    count = len(classes)
    edges = (0.0,)
    zero = np.zeros((1, count), dtype=np.int64)
    judged = PointCounts(zero, zero, zero, zero)
    pseudo, offsets = np.zeros(count, dtype=np.int64), np.zeros((2, count))
    total = labelled = 0
    truth_known = False
    for labels, truth in scenes:
        total, labelled = total + len(labels), labelled + int((labels.semantic >= 0).sum())
        pseudo += _pseudo_points(labels, count)
        if truth is not None:
            truth_known = True
            judged += count_points(labels.semantic, truth.semantic, count, None, ~labels.point_is_annotated, edges)
            if truth.instance is not None:
                offsets += offset_errors(labels, truth, count)
    present, seen, given, correct = (
        table[0] for table in (judged.present, judged.labelled, judged.given, judged.correct)
    )
    precision = [_share(correct[c], given[c]) for c in range(count)]
    known = [value for value in precision if value is not None]
    return {
        'coverage': labelled / total if total else 0.0,
        'precision': _share(correct.sum(), given.sum()),
        'mean_precision': sum(known) / len(known) if known else None,
        'offset_error': _share(offsets[0].sum(), offsets[1].sum()),
        'truth_known': truth_known,
        'points': {
            name: {
                'pseudo': int(pseudo[c]),
                'precision': precision[c],
                'recall': _share(correct[c], present[c]),
                'coverage': _share(seen[c], present[c]),
                'offset_error': _share(offsets[0, c], offsets[1, c]),
            }
            for c, name in enumerate(classes)
        },
        'boxes': {},
    }


def offset_errors(labels: PseudoLabels, truth: PointTruth, count: int) -> Float[np.ndarray, '2 classes']:
    """How far the centres that offsets are learnt from lie from the true ones (the paper's Figure 8).

    Every point with a pseudo instance and a true one, of one class in both, has an error: the distance between the
    centroids of the two instances, each over all its points. That is the error of the point's offset label too.

    Returns:
        Sum of the errors in metres, and number of points, of each class.
    """
    assert truth.instance is not None
    own = (labels.instance >= 0) & (truth.instance >= 0) & (labels.semantic == truth.semantic) & (truth.semantic >= 0)
    distance = np.linalg.norm(_centroids(truth.xyz, labels.instance) - _centroids(truth.xyz, truth.instance), axis=1)
    classes = truth.semantic[own]
    return np.stack(
        [np.bincount(classes, weights=distance[own], minlength=count), np.bincount(classes, minlength=count)]
    )


def _centroids(
    xyz: Float[np.ndarray, 'points 3'], instance: Int[np.ndarray, ' points']
) -> Float[np.ndarray, 'points 3']:
    """Centroid of each point's instance, metres (of all points without any: meaningless, never read)."""
    _, number = np.unique(instance, return_inverse=True)
    sizes = np.maximum(np.bincount(number), 1)
    sums = [np.bincount(number, weights=column) for column in xyz.astype(np.float64).T]
    return (np.stack(sums, axis=1) / sizes[:, None])[number]


def _share(part: float, whole: float) -> float | None:
    return float(part) / float(whole) if whole else None


def _pseudo_points(labels: PseudoLabels, count: int) -> np.ndarray:
    return np.bincount(labels.semantic[(labels.semantic >= 0) & ~labels.point_is_annotated], minlength=count)


def _boxes(labels: PseudoLabels, count: int) -> np.ndarray:
    annotated = np.bincount(labels.boxes.labels[labels.box_is_annotated], minlength=count)
    return np.stack([annotated, np.bincount(labels.boxes.labels[~labels.box_is_annotated], minlength=count)])


def describe_round(summary: dict[str, Any]) -> str:
    """One line for the log."""
    parts = [f'coverage {100 * summary["coverage"]:.1f} %']
    if summary.get('precision') is not None:
        parts[0] += f', {100 * summary["precision"]:.1f} % right'
    if summary.get('offset_error') is not None:
        parts[0] += f', centres of instances off by {summary["offset_error"]:.2f} m'
    for name, row in summary['points'].items():
        precision = '' if row['precision'] is None else f' ({100 * row["precision"]:.0f} % right)'
        parts.append(f'{name} {row["pseudo"]} points{precision}')
    for name, row in summary['boxes'].items():
        judged = f', {row["right"]} right of {row["true"]} true' if summary['truth_known'] else ''
        parts.append(f'{name} boxes {row["annotated"]} annotated + {row["pseudo"]} pseudo{judged}')
    return '; '.join(parts)
