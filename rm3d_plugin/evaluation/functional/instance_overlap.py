"""What instance metrics need of a scene: sizes and overlaps of true and found instances, no masks."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int, Integer

from rm3d_plugin.ops.segment import number_pairs


@dataclass(frozen=True, eq=False)
class InstanceOverlap:
    """True instances T and found instances K of one scene, of the evaluated classes.

    Attributes:
        truth_labels: (T,) int64 class of each true instance.
        truth_sizes: (T,) int64 points.
        labels: (K,) int64 class of each found instance.
        scores: (K,) float64.
        sizes: (K,) int64 points.
        void: (K,) int64 points of a found instance that are on no true instance of an evaluated class.
        unknown: (K,) int64 of these, points whose true class is not known at all.
        shared: (K, T) int64 points in both.
    """

    truth_labels: Int[np.ndarray, ' truths']
    truth_sizes: Int[np.ndarray, ' truths']
    labels: Int[np.ndarray, ' found']
    scores: Float[np.ndarray, ' found']
    sizes: Int[np.ndarray, ' found']
    void: Int[np.ndarray, ' found']
    unknown: Int[np.ndarray, ' found']
    shared: Int[np.ndarray, 'found truths']

    def select(self, rows: np.ndarray) -> 'InstanceOverlap':
        """The found instances that ``rows`` (a mask or numbers) names, and all true ones."""
        found = {name: getattr(self, name)[rows] for name in ('labels', 'scores', 'sizes', 'void', 'unknown', 'shared')}
        return replace(self, **found)

    def without_unknown(self) -> 'InstanceOverlap':
        """Found instances measured on points of known class only; one without such a point is left out."""
        known = replace(self, sizes=self.sizes - self.unknown, void=self.void - self.unknown, unknown=0 * self.unknown)
        return known.select(known.sizes > 0)

    def iou(self) -> Float[np.ndarray, 'found truths']:
        """Overlap of every pair of one class; 0 for pairs of two classes."""
        union = self.sizes[:, None] + self.truth_sizes[None] - self.shared
        same = self.labels[:, None] == self.truth_labels[None]
        return np.where(same & (union > 0), self.shared / np.maximum(union, 1), 0.0)


def instance_overlap(
    semantic: Integer[np.ndarray, ' points'],
    instance: Integer[np.ndarray, ' points'],
    masks: Bool[np.ndarray, 'found points'],
    labels: Integer[np.ndarray, ' found'],
    scores: Float[np.ndarray, ' found'],
    classes: Sequence[int],
) -> InstanceOverlap:
    """Reduce the masks of a scene to counts.

    Args:
        semantic: True class of each point; -1 or 255 = unknown.
        instance: True instance number of each point, -1 = none. Points of one number but two classes are two instances.
        masks: Points of each found instance; they may overlap.
        labels: Class of each found instance; those of classes that are not evaluated are left out.
        scores: Confidence of each.
        classes: Evaluated classes.

    Raises:
        ValueError: Rows do not fit each other, or a score is NaN.
    """
    n, count = len(semantic), len(labels)
    for name, got, expected in (
        ('instance', instance.shape, (n,)),
        ('masks', masks.shape, (count, n)),
        ('scores', scores.shape, (count,)),
    ):
        if got != expected:
            raise ValueError(f'instance_overlap: {name} has shape {got}, expected {expected}')
    if np.isnan(scores).any():
        raise ValueError(f'instance_overlap: {int(np.isnan(scores).sum())} of {count} scores are NaN')
    wanted = np.isin(labels, np.asarray(classes, dtype=np.int64))
    masks, labels, scores = masks[wanted].astype(bool), labels[wanted], scores[wanted]
    on_truth = np.isin(semantic, np.asarray(classes, dtype=np.int64)) & (instance >= 0)
    number, first = number_pairs(semantic[on_truth], instance[on_truth])
    truths = len(first)
    shared = np.zeros((len(masks), truths), dtype=np.int64)
    for row, mask in enumerate(masks):
        shared[row] = np.bincount(number[mask[on_truth]], minlength=truths)
    unknown = (semantic < 0) | (semantic == 255)
    return InstanceOverlap(
        truth_labels=semantic[on_truth][first].astype(np.int64),
        truth_sizes=np.bincount(number, minlength=truths),
        labels=labels.astype(np.int64),
        scores=scores.astype(np.float64),
        sizes=masks.sum(axis=1, dtype=np.int64),
        void=masks[:, ~on_truth].sum(axis=1, dtype=np.int64),
        unknown=masks[:, unknown].sum(axis=1, dtype=np.int64),
        shared=shared,
    )
