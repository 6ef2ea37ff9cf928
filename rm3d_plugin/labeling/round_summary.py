"""How good a round's labels are, over all scenes: for the log and the report."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.evaluation.functional.pseudo_label_counts import (
    RANGE_EDGES,
    BoxMatch,
    PseudoLabelCounts,
    SceneTruth,
    count_pseudo_labels,
)
from rm3d_plugin.evaluation.functional.pseudo_label_scores import PseudoLabelScores, pseudo_label_scores
from rm3d_plugin.structures import PseudoLabels
from rm3d_plugin.structures.label_estimate import estimate_text, has_estimate

MATCH_IOU = 0.25  # overlap from above from which a pseudo box counts as correct
MANY = 2.0  # times the expected pseudo boxes of a class are a warning
BACKGROUND = 'background'


def summarise_points(
    scenes: Iterable[tuple[PseudoLabels, SceneTruth | None]], classes: Sequence[str]
) -> dict[str, Any]:
    """Score the labels of a segmentation round; one scene is in memory at a time.

    Args:
        scenes: Labels and truth (None where nobody knows it) of each scene.
        classes: Names of the classes.

    Returns:
        See :func:`summary_of`; without ``ranges`` and ``boxes``.
    """
    counts = PseudoLabelCounts.none(len(classes))
    for labels, truth in scenes:
        counts += count_pseudo_labels(labels, truth, len(classes))
    return summary_of(counts, classes)


def summarise_boxes(scenes: Iterable[tuple[PseudoLabels, SceneTruth | None]], classes: Sequence[str]) -> dict[str, Any]:
    """Score the labels of a detection round; points that are in no object are background.

    Args:
        scenes: Labels and truth (None where nobody knows it) of each scene.
        classes: Names of the object classes.

    Returns:
        See :func:`summary_of`.
    """
    match = BoxMatch((MATCH_IOU,) * len(classes), 'bev')
    counts = PseudoLabelCounts.none(len(classes) + 1, len(RANGE_EDGES), len(classes))
    for labels, truth in scenes:
        counts += count_pseudo_labels(labels, truth, len(classes) + 1, RANGE_EDGES, match)
    return summary_of(counts, [*classes, BACKGROUND], RANGE_EDGES)


def summary_of(counts: PseudoLabelCounts, names: Sequence[str], range_edges: Sequence[float] = ()) -> dict[str, Any]:
    """The scores of a round under names, as the label store keeps them; None where there is nothing to divide by.

    Args:
        counts: Over all scenes.
        names: Of the point classes; those of boxes come first.
        range_edges: Lower ends of the range bins, metres; empty: bins are not told.

    Returns:
        ``coverage``: share of all points with a label. ``precision``: share of the pseudo labels that are correct;
        ``mean_precision``: its mean over the classes that were given. ``offset_error``: metres, see
        :func:`~rm3d_plugin.evaluation.functional.offset_error.offset_error`. ``truth_known``: whether any of these
        could be known. ``points``: by class ``pseudo`` (points with that pseudo label), ``precision``, ``recall``,
        ``coverage`` of the hidden points of the class, and ``offset_error``. ``ranges``: by distance ``coverage``,
        ``precision``, ``recall``, and the hidden points that are ``present`` or were ``given`` a label. ``boxes``: by
        class ``annotated``, ``pseudo``, ``correct`` (overlap from above of at least .25, each true box once) and
        ``true``.
    """
    scores = pseudo_label_scores(counts)
    return {
        'coverage': scores.coverage,
        'precision': _known(scores.precision),
        'mean_precision': _known(scores.mean_precision),
        'offset_error': _known(scores.offset_error),
        'truth_known': counts.scenes_with_truth > 0,
        'points': {name: _class_row(counts, scores, c) for c, name in enumerate(names)},
        'ranges': {f'>={low:g} m': _range_row(counts, scores, b) for b, low in enumerate(range_edges)},
        'boxes': {} if counts.boxes is None else _box_rows(counts, names),
    }


def _class_row(counts: PseudoLabelCounts, scores: PseudoLabelScores, c: int) -> dict[str, float | None]:
    return {
        'pseudo': int(counts.pseudo[c]),
        'precision': _known(scores.class_precision[c]),
        'recall': _known(scores.class_recall[c]),
        'coverage': _known(scores.class_coverage[c]),
        'offset_error': _known(scores.class_offset_error[c]),
    }


def _range_row(counts: PseudoLabelCounts, scores: PseudoLabelScores, b: int) -> dict[str, float | None]:
    return {
        'coverage': _known(scores.range_coverage[b]),
        'precision': _known(scores.range_precision[b]),
        'recall': _known(scores.range_recall[b]),
        'present': int(counts.points.present[b].sum()),
        'given': int(counts.points.given[b].sum()),
    }


def _box_rows(counts: PseudoLabelCounts, names: Sequence[str]) -> dict[str, dict[str, int]]:
    boxes = counts.boxes
    assert boxes is not None
    return {
        names[c]: {
            'annotated': int(boxes.annotated[c]),
            'pseudo': int(boxes.given[c]),
            'correct': int(boxes.correct[c]),
            'true': int(boxes.present[c] + boxes.annotated[c]),
        }
        for c in range(len(boxes.given))
    }


def with_steps(
    summary: dict[str, Any],
    steps: Mapping[str, Int[np.ndarray, ' classes']],
    expected: Float[np.ndarray, ' classes'] | None = None,
) -> dict[str, Any]:
    """A summary whose boxes tell what each step cost, and how many objects there seem to be.

    Args:
        summary: See :func:`summary_of`.
        steps: Step -> candidates of each class that it cost; 'found' is how many there were at first.
        expected: Objects of each class without an annotated box that the scenes seem to hold; None: nobody asked.
    """
    boxes = {}
    for c, (name, row) in enumerate(summary['boxes'].items()):
        boxes[name] = row | {'steps': {step: int(lost[c]) for step, lost in steps.items()}}
        if expected is not None:
            boxes[name]['expected'] = round(float(expected[c]), 1)
    return summary | {'boxes': boxes}


def with_agreement(summary: dict[str, Any], agreed: Mapping[str, Int[np.ndarray, ' classes']]) -> dict[str, Any]:
    """A summary whose boxes tell how far classes, instances and boxes say the same.

    Args:
        summary: See :func:`summary_of`.
        agreed: See :func:`~rm3d_plugin.pseudo_labels.detection.instances.agreement`, over all scenes; empty: nobody
            looked.
    """
    if not agreed:
        return summary
    boxes = summary['boxes'].items()
    told = {name: {kind: int(counts[c]) for kind, counts in agreed.items()} for c, (name, _) in enumerate(boxes)}
    return summary | {'boxes': {name: row | {'agreement': told[name]} for name, row in boxes}}


def agreement_text(counts: Mapping[str, int]) -> str:
    """How far classes, instances and boxes of a class agree, in words.

    >>> agreement_text({'boxes': 9, 'boxes_with_instance': 7, 'instances': 8, 'instances_with_box': 7,
    ...                 'points_in_boxes': 200, 'points_of_class': 150})
    '7 of 9 boxes are an instance, 7 of 8 instances a box, 75 % of the points in boxes have their class'
    """
    share = 100 * counts['points_of_class'] / max(counts['points_in_boxes'], 1)
    return (
        f'{counts["boxes_with_instance"]} of {counts["boxes"]} boxes are an instance, '
        f'{counts["instances_with_box"]} of {counts["instances"]} instances a box, '
        f'{share:.0f} % of the points in boxes have their class'
    )


def box_warnings(summary: Mapping[str, Any]) -> list[str]:
    """A line for each class without a pseudo box, or with far more than are expected, with the steps that did it.

    >>> row = {'pseudo': 0, 'steps': {'found': 9, 'size': 7, 'score': 2}}
    >>> box_warnings({'boxes': {'Cyclist': row}})
    ['Cyclist: no pseudo box; of 9 candidates size took 7, score 2']
    """
    found = []
    for name, row in summary['boxes'].items():
        steps, expected = row.get('steps'), row.get('expected')
        if not steps:
            continue
        lost = [f'{step} {"took " * (not i)}{n}' for i, (step, n) in enumerate(_costly(steps))]
        if row['pseudo'] == 0 and expected != 0:
            why = f'of {steps["found"]} candidates {", ".join(lost)}' if lost else 'no candidate was found'
            found.append(f'{name}: no pseudo box; {why}')
        elif expected is not None and row['pseudo'] > MANY * max(expected, 1):
            found.append(
                f'{name}: {row["pseudo"]} pseudo boxes, {expected:.0f} expected; {", ".join(lost)} of {steps["found"]}'
            )
    return found


def _costly(steps: Mapping[str, int]) -> list[tuple[str, int]]:
    return sorted(((step, n) for step, n in steps.items() if step != 'found' and n > 0), key=lambda item: -item[1])


def _known(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def describe_round(summary: dict[str, Any]) -> str:
    """One line for the log."""
    parts = [f'coverage {100 * summary["coverage"]:.1f} %']
    if summary['precision'] is not None:
        parts[0] += f', precision {100 * summary["precision"]:.1f} %'
    if summary['offset_error'] is not None:
        parts[0] += f', offset error {summary["offset_error"]:.2f} m'
    if has_estimate(summary):
        parts.insert(0, estimate_text(summary))
    for name, row in summary['points'].items():
        precision = '' if row['precision'] is None else f' ({100 * row["precision"]:.0f} % correct)'
        parts.append(f'{name} {row["pseudo"]} points{precision}')
    for name, row in summary['boxes'].items():
        found = f', {row["correct"]} correct of {row["true"]} true' if summary['truth_known'] else ''
        guess = f' ({row["expected"]:.0f} expected)' if 'expected' in row else ''
        parts.append(f'{name} boxes {row["annotated"]} annotated + {row["pseudo"]} pseudo{guess}{found}')
        if 'agreement' in row:
            parts.append(agreement_text(row['agreement']))
    return '; '.join(parts)
