"""Intersection over union of classes of points (METHOD 9).

Two habits of reference programs are settled here on purpose. A predicted number that is no class (the class count
itself, 255, -1) counts as "no class": it goes into a column of its own and cannot spill into the next row of the table.
A class without truth has no IoU (NaN) and no part in the mean, whatever was predicted; points wrongly given to it are
missing from the classes that they belong to, so they cost all the same. ``absent='zero'`` counts such a class as 0
where something was predicted as it, as programs do that divide by the union alone.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float, Int, Integer

IGNORED = (-1, 255)
Absent = Literal['skip', 'zero']
AccuracyOver = Literal['known', 'predicted']


@dataclass(frozen=True, eq=False)
class SemanticScores:
    """All shares in [0, 1].

    Attributes:
        iou: (C,) intersection over union; NaN for a class without truth (see the module's text for ``absent``).
        recall: (C,) share of a class's points that were found; NaN without truth.
        precision: (C,) share of the points given to a class that are of it; NaN where none was.
        points: (C,) int64 true points of each class.
        mean_iou: Over the classes that have an IoU; 0 where none has.
        mean_accuracy: Mean of ``recall`` over the classes with truth; 0 where none has.
        accuracy: Share of correct points; 0 where there is no point.
        confusion: (C, C + 1) int64, rows are true and columns predicted classes, the last column is "no class".
    """

    iou: Float[np.ndarray, ' classes']
    recall: Float[np.ndarray, ' classes']
    precision: Float[np.ndarray, ' classes']
    points: Int[np.ndarray, ' classes']
    mean_iou: float
    mean_accuracy: float
    accuracy: float
    confusion: Int[np.ndarray, 'classes columns']


def confusion_counts(
    prediction: Integer[np.ndarray, ' points'],
    truth: Integer[np.ndarray, ' points'],
    num_classes: int,
    ignored: Sequence[int] = IGNORED,
) -> Int[np.ndarray, 'classes columns']:
    """How often each true class was predicted as each class; tables of several scenes add up.

    Args:
        prediction: Class of each point; any number outside 0 .. num_classes - 1 means "no class".
        truth: True class of each point.
        num_classes: Number of classes C.
        ignored: True values that do not count at all; a value below C is a class and cannot be ignored by it.

    Returns:
        (C, C + 1) int64; the last column is "no class".

    Raises:
        ValueError: The rows differ in number, or a true value is neither a class nor ignored.

    >>> confusion_counts(np.array([0, 1, 2, 1]), np.array([0, 1, 1, 255]), 2)
    array([[1, 0, 0],
           [0, 1, 1]])
    """
    if prediction.shape != truth.shape:
        raise ValueError(f'confusion_counts: {prediction.shape} predictions, but truth is {truth.shape}')
    is_class = (truth >= 0) & (truth < num_classes)
    strange = ~is_class & ~np.isin(truth, np.asarray(ignored))
    if strange.any():
        raise ValueError(
            f'confusion_counts: truth holds {int(truth[strange][0])}; expected 0..{num_classes - 1} or one of the '
            f'ignored values {tuple(ignored)}'
        )
    row = truth[is_class].astype(np.int64)
    column = prediction[is_class].astype(np.int64)
    column = np.where((column >= 0) & (column < num_classes), column, num_classes)
    width = num_classes + 1
    return np.bincount(row * width + column, minlength=num_classes * width).reshape(num_classes, width)


def semantic_scores(
    confusion: Int[np.ndarray, 'classes columns'], absent: Absent = 'skip', accuracy_over: AccuracyOver = 'known'
) -> SemanticScores:
    """Scores of a table of :func:`confusion_counts`.

    Args:
        confusion: (C, C + 1) counts.
        absent: What becomes of a class without truth as which something was predicted: 'skip' leaves it out of the
            mean, 'zero' counts it as 0. A class that occurs nowhere is always left out.
        accuracy_over: 'known': a point predicted as no class is wrong. 'predicted': it is left out of the accuracy (of
            nothing else), as SemanticKITTI's program does.

    Raises:
        ValueError: A choice is unknown.
    """
    if absent not in get_args(Absent):
        raise ValueError(f'semantic_scores: absent: expected one of {get_args(Absent)}, got {absent!r}')
    if accuracy_over not in get_args(AccuracyOver):
        raise ValueError(
            f'semantic_scores: accuracy_over: expected one of {get_args(AccuracyOver)}, got {accuracy_over!r}'
        )
    classes = confusion[:, :-1]
    hit = np.diag(classes).astype(np.float64)
    points, given = confusion.sum(axis=1), classes.sum(axis=0)
    iou = _share(hit, points + given - hit)
    counted = points > 0
    if absent == 'skip':
        iou = np.where(counted, iou, np.nan)
    recall = _share(hit, points)
    counted_points = confusion.sum() if accuracy_over == 'known' else classes.sum()
    return SemanticScores(
        iou=iou,
        recall=recall,
        precision=_share(hit, given),
        points=points,
        mean_iou=mean_of_known(iou),
        mean_accuracy=mean_of_known(recall),
        accuracy=float(hit.sum() / counted_points) if counted_points else 0.0,
        confusion=confusion,
    )


def semantic_iou(
    predictions: Iterable[Integer[np.ndarray, ' _points']],
    truths: Iterable[Integer[np.ndarray, ' _points']],
    num_classes: int,
    ignored: Sequence[int] = IGNORED,
    absent: Absent = 'skip',
    accuracy_over: AccuracyOver = 'known',
) -> SemanticScores:
    """Scores over the points of all scenes together.

    Args:
        predictions: Classes of the points of each scene.
        truths: True classes of the same points.
        num_classes: Number of classes.
        ignored: See :func:`confusion_counts`.
        absent: See :func:`semantic_scores`.
        accuracy_over: See :func:`semantic_scores`.

    Raises:
        ValueError: Scenes or points differ in number, or a true value is no class.

    >>> semantic_iou([np.array([0, 0, 1])], [np.array([0, 1, 1])], 3).mean_iou
    0.5
    """
    total = np.zeros((num_classes, num_classes + 1), dtype=np.int64)
    for prediction, truth in zip(predictions, truths, strict=True):
        total += confusion_counts(prediction, truth, num_classes, ignored)
    return semantic_scores(total, absent, accuracy_over)


def mean_of_known(values: Float[np.ndarray, ' classes']) -> float:
    """Mean of what is not NaN; 0 where nothing is."""
    known = values[~np.isnan(values)]
    return float(known.mean()) if len(known) else 0.0


def _share(part: np.ndarray, whole: np.ndarray) -> Float[np.ndarray, ' classes']:
    return np.where(whole > 0, part / np.maximum(whole, 1), np.nan)
