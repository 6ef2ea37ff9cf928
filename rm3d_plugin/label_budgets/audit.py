"""What training may see of a scene's truth, and the noise that proves it sees nothing else (METHOD 8)."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.label_budgets.base import BudgetError
from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.structures import UNLABELLED, Boxes3D, PseudoLabels


class DenseTruth(Protocol):
    """Ground truth of a scene, as ``datasets.Truth`` holds it."""

    @property
    def boxes(self) -> Boxes3D:
        """All boxes."""

    @property
    def semantic(self) -> Int[np.ndarray, ' points'] | None:
        """Class of each point."""

    @property
    def instance(self) -> Int[np.ndarray, ' points'] | None:
        """Object of each point."""


AnyTruth = TypeVar('AnyTruth', bound=DenseTruth)


def hide(
    xyz: Float[np.ndarray, 'points 3'], truth: DenseTruth, annotated: Sequence[int], complete: bool = False
) -> PseudoLabels:
    """What training may see: the annotated boxes, and the points inside them.

    The truth's point labels are not read: an annotated box tells the class of the points in it, and no more.

    Args:
        xyz: (N, 3) metres, the scene's points.
        truth: Everything that is known of the scene.
        annotated: Rows of ``truth.boxes``.
        complete: True where the budget shows everything; what has no label then is background.

    Returns:
        Labels with ``instance`` a row of the annotated boxes, in the order of ``annotated``; where two boxes hold a
        point, the first has it.

    Raises:
        ValueError: A row is out of range or comes twice.
    """
    rows = _check_rows(annotated, len(truth.boxes))
    boxes = truth.boxes.select(rows)
    instance = points_in_boxes(xyz, boxes.tensor)
    inside = instance >= 0
    semantic = np.full(len(xyz), UNLABELLED, dtype=np.int64)
    semantic[inside] = boxes.labels[instance[inside]]
    return PseudoLabels(
        semantic=semantic,
        instance=instance,
        point_is_annotated=inside,
        confidence=inside.astype(np.float32),
        boxes=boxes,
        box_is_annotated=np.ones(len(boxes), dtype=bool),
        complete=complete,
    )


def scramble_hidden(truth: AnyTruth, annotated: Sequence[int], rng: np.random.Generator) -> AnyTruth:
    """The same truth with noise for every hidden box and every point label.

    Training on it must give bit-identical losses: whatever differs has leaked. All point labels are hidden, since
    under a budget of boxes those in annotated boxes follow from the boxes alone. The number of boxes stays, since
    the budget is checked against it.

    Args:
        truth: A frozen dataclass with ``boxes``, ``semantic`` and ``instance``.
        annotated: Rows of ``truth.boxes`` to leave as they are.
        rng: Source of the noise.

    Returns:
        The same type; sizes stay positive, class numbers stay in range.
    """
    rows = _check_rows(annotated, len(truth.boxes))
    hidden = np.setdiff1d(np.arange(len(truth.boxes)), rows)
    tensor, labels = truth.boxes.tensor.copy(), truth.boxes.labels.copy()
    tensor[hidden, :3] += rng.normal(0.0, 10.0, size=(len(hidden), 3))
    tensor[hidden, 3:6] = rng.uniform(0.2, 8.0, size=(len(hidden), 3))
    tensor[hidden, 6] = rng.uniform(-np.pi, np.pi, size=len(hidden))
    top = labels.max(initial=0) + 1
    labels[hidden] = rng.integers(0, top, size=len(hidden))
    noise = {
        name: None if values is None else rng.integers(UNLABELLED, max(1, values.max(initial=0) + 1), size=len(values))
        for name, values in (('semantic', truth.semantic), ('instance', truth.instance))
    }
    boxes = Boxes3D(tensor, labels, truth.boxes.scores)
    scrambled: AnyTruth = replace(truth, boxes=boxes, **noise)  # type: ignore[type-var]
    return scrambled


class PastedObject(Protocol):
    """An object that training copies into other scenes."""

    @property
    def box(self) -> Float[np.ndarray, '7']:
        """Its box, in the scene that it is from."""

    @property
    def label(self) -> int:
        """Its class."""

    @property
    def annotated(self) -> bool:
        """False for a pseudo object, which nobody labelled."""


def check_objects(objects: Iterable[PastedObject], shown: Iterable[Boxes3D]) -> None:
    """Refuse a bank of objects to paste that holds an annotated object which the budget does not show.

    Args:
        objects: Of the bank; pseudo objects pass.
        shown: Annotated boxes of each scene.

    Raises:
        BudgetError: An object is none of them.
    """
    known = list(shown)
    for item in objects:
        same = (((boxes.tensor == item.box).all(axis=1) & (boxes.labels == item.label)).any() for boxes in known)
        if item.annotated and not any(same):
            raise BudgetError(
                f'annotated object of class {item.label} at {np.round(item.box[:3], 2).tolist()}: expected one of the '
                f'{sum(map(len, known))} boxes that the budget shows; the bank read labels beside the label store'
            )


class AnnotatedPoints(NamedTuple):
    """The labelled points of one scene that training may see.

    Attributes:
        points: (P,) int64 point numbers, ascending.
        semantic: (P,) int64 their classes.
        instance: (P,) int64 their instances, -1 = none or hidden.
    """

    points: Int[np.ndarray, ' annotated']
    semantic: Int[np.ndarray, ' annotated']
    instance: Int[np.ndarray, ' annotated']


def hide_points(
    truth: DenseTruth, annotated: Sequence[int] | Int[np.ndarray, ' annotated'], instances: bool = True
) -> AnnotatedPoints:
    """What training may see of a scene's points: class and instance of the annotated ones that have a class.

    Args:
        truth: Everything that is known of the scene; its boxes are not read.
        annotated: Point numbers.
        instances: False hides the instances of the annotated points too.

    Raises:
        ValueError: The truth has no point labels, or a point is out of range or comes twice.
    """
    if truth.semantic is None:
        raise ValueError('hide_points: the truth has no point labels (semantic is None)')
    rows = np.sort(_check_rows(annotated, len(truth.semantic), 'points'))
    rows = rows[truth.semantic[rows] >= 0]
    nothing = np.full(len(rows), UNLABELLED, dtype=np.int64)
    instance = nothing if truth.instance is None or not instances else truth.instance[rows].astype(np.int64)
    return AnnotatedPoints(rows, truth.semantic[rows].astype(np.int64), instance)


def scramble_hidden_points(
    truth: AnyTruth,
    annotated: Sequence[int] | Int[np.ndarray, ' annotated'],
    rng: np.random.Generator,
    instances: bool = True,
) -> AnyTruth:
    """The same truth with noise for the class and instance of every point that is not annotated.

    Training on it must give bit-identical losses: whatever differs has leaked. Boxes stay: a budget of points shows
    none, and none are read.

    Args:
        truth: A frozen dataclass with ``semantic`` and ``instance``.
        annotated: Point numbers to leave as they are.
        rng: Source of the noise.
        instances: False: the instances of the annotated points are hidden, so they become noise too.
    """
    assert truth.semantic is not None
    rows = _check_rows(annotated, len(truth.semantic), 'points')
    noise = {}
    for name, values, kept in (('semantic', truth.semantic, True), ('instance', truth.instance, instances)):
        if values is not None:
            top = max(1, values.max(initial=0) + 1)
            noise[name] = rng.integers(UNLABELLED, top, size=len(values)).astype(values.dtype)
            noise[name][rows if kept else rows[:0]] = values[rows if kept else rows[:0]]
    scrambled: AnyTruth = replace(truth, **noise)  # type: ignore[type-var]
    return scrambled


def _check_rows(
    annotated: Sequence[int] | Int[np.ndarray, ' annotated'], count: int, things: str = 'boxes'
) -> Int[np.ndarray, ' annotated']:
    rows = np.asarray(annotated, dtype=np.int64).reshape(-1)
    if len(rows) and (rows.min() < 0 or rows.max() >= count):
        raise ValueError(f'annotated: expected rows of {count} {things}, got {_few(rows)}; draw the label budget again')
    if len(np.unique(rows)) != len(rows):
        raise ValueError(f'annotated: a row comes twice in {_few(rows)}')
    return rows


def _few(rows: Int[np.ndarray, ' annotated']) -> str:
    return str(rows.tolist()) if len(rows) <= 20 else f'{rows[:20].tolist()} ... ({rows.min()} to {rows.max()})'
