"""Sums, means and votes over the points of each segment, and back; a label of -1 takes a point out."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Integer, Shaped
from numba import njit


def _checked(labels: np.ndarray, rows: int, count: int) -> Int[np.ndarray, ' points']:
    out = np.ascontiguousarray(labels, dtype=np.int64)
    if out.shape != (rows,):
        raise ValueError(f'segment labels: expected shape ({rows},), one a row of values, got {out.shape}')
    if rows and (out.min() < -1 or out.max() >= count):
        raise ValueError(f'segment labels: expected -1..{count - 1}, got {out.min()}..{out.max()}')
    return out


def segment_sum(
    values: Float[np.ndarray, 'points channels'], labels: Int[np.ndarray, ' points'], count: int
) -> Float[np.ndarray, 'segments channels']:
    """Sum of the rows of each segment, float64, added in the order of the points.

    Args:
        values: Any numbers.
        labels: Segment of each point, -1 = none.
        count: Number of segments; one without points gets zeros.

    Raises:
        ValueError: A label is out of range, or the rows do not match.
    """
    rows = np.ascontiguousarray(values)
    out = np.zeros((count, rows.shape[1]))
    _add_rows(rows, _checked(labels, len(rows), count), out)
    return out


def segment_mean(
    values: Float[np.ndarray, 'points channels'], labels: Int[np.ndarray, ' points'], count: int
) -> Float[np.ndarray, 'segments channels']:
    """Mean of the rows of each segment; zeros for a segment without points."""
    sums = segment_sum(values, labels, count)
    return sums / np.maximum(segment_sizes(labels, count), 1)[:, None]


def segment_sizes(labels: Int[np.ndarray, ' points'], count: int) -> Int[np.ndarray, ' segments']:
    """Points of each segment."""
    checked = _checked(labels, len(labels), count)
    return np.bincount(checked[checked >= 0], minlength=count)


def segment_majority(
    values: Int[np.ndarray, ' points'],
    labels: Int[np.ndarray, ' points'],
    count: int,
    frequency: Int[np.ndarray, ' classes'] | None = None,
) -> Int[np.ndarray, ' segments']:
    """Most frequent value of each segment; -1 where no point has a value of 0 or more (METHOD 1).

    Args:
        values: Class (or instance) of each point, -1 = none.
        labels: Segment of each point, -1 = none.
        count: Number of segments.
        frequency: How often each value occurs among the annotated labels of training: on a tie the more frequent one
            wins, then the lower one. None: the lower one wins at once.

    Raises:
        ValueError: A label is out of range, the rows do not match, or ``frequency`` lacks a value.
    """
    given, checked = np.asarray(values), _checked(labels, len(values), count)
    voters = (checked >= 0) & (given >= 0)
    out = np.full(count, -1, dtype=np.int64)
    if not voters.any():
        return out
    if frequency is not None and given[voters].max() >= len(frequency):
        raise ValueError(f'segment_majority: frequency of {len(frequency)} values, but there is {given[voters].max()}')
    pairs, votes = np.unique(np.stack([checked[voters], given[voters]], axis=1), axis=0, return_counts=True)
    common = np.zeros(len(pairs)) if frequency is None else np.asarray(frequency)[pairs[:, 1]]
    order = np.lexsort((pairs[:, 1], -common, -votes, pairs[:, 0]))
    segments, first = np.unique(pairs[order, 0], return_index=True)
    out[segments] = pairs[order[first], 1]
    return out


class PairNumbers(NamedTuple):
    """A number for each different pair of values, in rising order of the first and then the second.

    Attributes:
        number: (N,) pair of each row.
        first: (K,) first row of each pair.
    """

    number: Int[np.ndarray, ' rows']
    first: Int[np.ndarray, ' pairs']


def number_pairs(first: Integer[np.ndarray, ' rows'], second: Integer[np.ndarray, ' rows']) -> PairNumbers:
    """Number the pairs (first, second), say class and instance; exact for integers of any two types.

    Args:
        first: Any integers.
        second: Any integers, of the same or of another type.

    >>> number_pairs(np.array([1, 0, 1]), np.array([7, 7, 7], dtype=np.uint64)).number
    array([1, 0, 1])
    """
    parts = [np.unique(values, return_inverse=True)[1].reshape(-1).astype(np.int64) for values in (first, second)]
    keys = parts[0] * (parts[1].max(initial=0) + 1) + parts[1]
    _, row, number = np.unique(keys, return_index=True, return_inverse=True)
    return PairNumbers(number.reshape(-1), row)


class Majority(NamedTuple):
    """The most frequent class of each segment, -1 where there is none, and its share of the votes, 0 there."""

    classes: Int[np.ndarray, ' segments']
    share: Float[np.ndarray, ' segments']


def majority_of_counts(counts: Int[np.ndarray, 'segments classes'], frequency: Int[np.ndarray, ' classes']) -> Majority:
    """:func:`segment_majority` where the classes of each segment are counted already; ties go the same way.

    Args:
        counts: Points of each class in each segment.
        frequency: How often each class occurs among the annotated labels of training.
    """
    segments, classes = counts.shape
    # lexsort's last key counts most: frequency in training, then the lower class.
    rank = np.empty(classes, dtype=np.int64)
    rank[np.lexsort((-np.arange(classes), frequency))] = np.arange(classes)
    best = (counts * classes + rank).argmax(axis=1) if classes else np.zeros(segments, dtype=np.int64)
    total = counts.sum(axis=1)
    share = (counts[np.arange(segments), best] if classes else total) / np.maximum(total, 1)
    return Majority(np.where(total > 0, best, -1).astype(np.int64), np.where(total > 0, share, 0.0))


def first_mask(masks: Bool[np.ndarray, 'masks points']) -> Int[np.ndarray, ' points']:
    """Lowest row whose mask holds each point, -1 = none.

    >>> first_mask(np.array([[False, True, False], [True, True, False]]))
    array([ 1,  0, -1])
    """
    out = np.full(masks.shape[1], -1, dtype=np.int64)
    for row in reversed(range(len(masks))):
        out[masks[row]] = row
    return out


def scatter_rows(
    rows: Shaped[np.ndarray, 'rows ...'], index: Int[np.ndarray, ' rows'], count: int, fill: float
) -> Shaped[np.ndarray, 'points ...']:
    """Rows put back on the points that they are about; ``fill`` elsewhere.

    Args:
        rows: Anything; the result has the same type.
        index: Point of each row.
        count: Number of points.
        fill: Value of the points without a row.

    >>> scatter_rows(np.array([7, 8]), np.array([2, 0]), 4, fill=-1)
    array([ 8, -1,  7, -1])
    """
    out = np.full((count, *rows.shape[1:]), fill, dtype=rows.dtype)
    out[index] = rows
    return out


def segment_values(
    values: Shaped[np.ndarray, 'segments ...'], labels: Int[np.ndarray, ' points'], missing: float
) -> Shaped[np.ndarray, 'points ...']:
    """The value of each point's segment; ``missing`` for points of none.

    >>> segment_values(np.array([0.5, 0.9]), np.array([1, -1, 0]), 0.0)
    array([0.9, 0. , 0.5])
    """
    last = np.full((1, *values.shape[1:]), missing, dtype=values.dtype)
    return np.concatenate([values, last])[labels]


def segment_mean_axis(
    normals: Float[np.ndarray, 'points 3'], labels: Int[np.ndarray, ' points'], count: int
) -> Float[np.ndarray, 'segments 3']:
    """Unit mean of the normals of each segment after aligning their signs (METHOD 2: nothing depends on the sign).

    The signs follow the axis that the normals agree on most (leading eigenvector of the sum of n n^T); the result
    points to the side of the segment's first non-zero normal.

    Args:
        normals: Unit vectors of either sign; zero where unknown.
        labels: Segment of each point, -1 = none.
        count: Number of segments.

    Returns:
        Unit vectors; zero for a segment without a known normal.
    """
    given = np.ascontiguousarray(normals, dtype=np.float64)
    checked = _checked(labels, len(given), count)
    axes = np.linalg.eigh(_scatter(given, checked, count))[1][:, :, 2]
    return _aligned_mean(given, checked, np.ascontiguousarray(axes))


@njit(cache=True)
def _add_rows(values: np.ndarray, labels: np.ndarray, out: np.ndarray) -> None:
    for p in range(len(labels)):
        if labels[p] >= 0:
            for c in range(values.shape[1]):
                out[labels[p], c] += values[p, c]


@njit(cache=True)
def _scatter(normals: np.ndarray, labels: np.ndarray, count: int) -> np.ndarray:
    out = np.zeros((count, 3, 3))
    for p in range(len(labels)):
        if labels[p] >= 0:
            for a in range(3):
                for b in range(3):
                    out[labels[p], a, b] += normals[p, a] * normals[p, b]
    return out


@njit(cache=True)
def _aligned_mean(normals: np.ndarray, labels: np.ndarray, axes: np.ndarray) -> np.ndarray:
    out = np.zeros_like(axes)
    side = np.zeros(len(axes))
    for p in range(len(labels)):
        r = labels[p]
        if r < 0:
            continue
        dot = normals[p, 0] * axes[r, 0] + normals[p, 1] * axes[r, 1] + normals[p, 2] * axes[r, 2]
        sign = -1.0 if dot < 0 else 1.0
        if side[r] == 0 and dot != 0:
            side[r] = sign
        for c in range(3):
            out[r, c] += sign * normals[p, c]
    for r in range(len(axes)):
        length = np.sqrt(out[r, 0] ** 2 + out[r, 1] ** 2 + out[r, 2] ** 2)
        for c in range(3):
            out[r, c] = side[r] * out[r, c] / length if length > 0 else 0.0
    return out
