"""A part of the annotated points, the holdout, is kept aside and tells whether a round made the labels worse.

These points are neither trained on nor used for merging. After a refresh, the share of them that the new pseudo labels
contradict is compared with the former round's; where it is worse by a margin, the round's new labels are dropped.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.pseudo_labels.common.annotated import AnnotatedLabels
from rm3d_plugin.structures import UNLABELLED, PseudoLabels

MIN_COMPARED = 5  # holdout points under a class's pseudo labels; fewer are no evidence


@dataclass(frozen=True, eq=False)
class Holdout:
    """Annotated labels in two parts.

    Attributes:
        annotated: What training and merging may know.
        points: (H,) int64 the points kept aside, ascending.
        classes: (H,) int64 their annotated classes.
    """

    annotated: AnnotatedLabels
    points: Int[np.ndarray, ' held']
    classes: Int[np.ndarray, ' held']


@dataclass(frozen=True, eq=False)
class HoldoutErrors:
    """Holdout points by the class that the pseudo labels give them; scenes add up.

    Attributes:
        compared: (C,) int64 of them, points with a pseudo label of the class.
        wrong: (C,) int64 of these, points of another class.
    """

    compared: Int[np.ndarray, ' classes']
    wrong: Int[np.ndarray, ' classes']

    def __add__(self, other: 'HoldoutErrors') -> 'HoldoutErrors':
        return HoldoutErrors(self.compared + other.compared, self.wrong + other.wrong)

    @property
    def share(self) -> Float[np.ndarray, ' classes']:
        """Share of the compared points that are contradicted; NaN where none was compared."""
        return np.where(self.compared > 0, self.wrong / np.maximum(self.compared, 1), np.nan)

    def whole(self) -> 'HoldoutErrors':
        """All classes as one."""
        return HoldoutErrors(self.compared.sum(keepdims=True), self.wrong.sum(keepdims=True))


def split_holdout(annotated: AnnotatedLabels, share: float, rng: np.random.Generator) -> Holdout:
    """Keep a part of the annotated points aside.

    Every class keeps at least one annotated point, and every instance too; so where each class has one point only,
    nothing can be kept aside, and there is no check. Scenes that are complete, and scenes with boxes, are left whole.

    Args:
        annotated: The annotated labels of a scene.
        share: Share of the annotated points, rounded; 0: none.
        rng: Of the draw; seed it by the scene, so that every round keeps the same points.

    Raises:
        ValueError: The share is not in [0, 1).
    """
    if not 0 <= share < 1:
        raise ValueError(f'split_holdout: share: expected a number in [0, 1), got {share}')
    known = np.flatnonzero(annotated.semantic >= 0)
    count = round(share * len(known))
    if not count or annotated.complete or len(annotated.boxes):
        return Holdout(annotated, known[:0], annotated.semantic[:0])
    order = rng.permutation(known)
    # The first point of each (class, instance) in the drawn order stays; instances without a number are one a class.
    pairs = np.stack([annotated.semantic[order], annotated.instance[order]], axis=1)
    _, first = np.unique(pairs, axis=0, return_index=True)
    free = np.delete(order, first)
    points = np.sort(free[:count])
    semantic, instance = annotated.semantic.copy(), annotated.instance.copy()
    semantic[points] = UNLABELLED
    instance[points] = -1
    kept = replace(annotated, semantic=semantic, instance=instance)
    return Holdout(kept, points, annotated.semantic[points])


def holdout_errors(labels: Int[np.ndarray, ' points'], held: Holdout, num_classes: int) -> HoldoutErrors:
    """How many of the points kept aside the labels contradict; a point without a label is no evidence.

    Args:
        labels: Pseudo class of each point of the scene, -1 = none.
        held: The points kept aside.
        num_classes: Number of classes.
    """
    given = labels[held.points]
    compared = given >= 0
    return HoldoutErrors(
        np.bincount(given[compared], minlength=num_classes),
        np.bincount(given[compared & (given != held.classes)], minlength=num_classes),
    )


def got_worse(
    new: HoldoutErrors, old: HoldoutErrors, margin: float, min_compared: int = MIN_COMPARED
) -> Bool[np.ndarray, ' classes']:
    """Classes whose labels of this round contradict more of the points kept aside than those of the former round.

    Args:
        new: Errors of this round, of one scene or summed over scenes.
        old: Errors of the former round; a class with nothing compared there had no error.
        margin: By how much the share must exceed the former one.
        min_compared: Fewest points of this round that are evidence.
    """
    before = np.nan_to_num(old.share)
    return np.asarray((new.compared >= min_compared) & (np.nan_to_num(new.share) > before + margin))


def without_new_labels(
    labels: PseudoLabels, previous: PseudoLabels | None, classes: Bool[np.ndarray, ' classes']
) -> PseudoLabels:
    """Take back what a round newly gave to some classes: these points have the former round's label again.

    Annotated labels stay. Coverage does not fall under the former round's.

    Args:
        labels: Of this round, without boxes.
        previous: Of the former round; None: there was none.
        classes: Classes whose new labels are dropped, as :func:`got_worse` says.

    Raises:
        ValueError: The labels hold boxes; this check is for segmentation.
    """
    if len(labels.boxes):
        raise ValueError('without_new_labels: expected labels of segmentation, got boxes')
    rows = len(labels)
    nothing = np.full(rows, UNLABELLED, dtype=np.int64)
    old = nothing if previous is None else previous.semantic
    dropped = np.append(classes, False)[labels.semantic] & (labels.semantic != old) & ~labels.point_is_annotated
    instance = nothing if previous is None else previous.instance
    fresh = (instance >= 0) & ~np.isin(instance, labels.instance[labels.point_is_annotated])
    # Numbers of pseudo instances start anew in every round: what comes back must not meet one of this round.
    instance = np.where(fresh, instance + int(labels.instance.max(initial=-1)) + 1, instance)
    confidence = np.zeros(rows, dtype=np.float32) if previous is None else previous.confidence
    return replace(
        labels,
        semantic=np.where(dropped, old, labels.semantic),
        instance=np.where(dropped, instance, labels.instance),
        confidence=np.where(dropped, confidence, labels.confidence).astype(np.float32),
    )
