"""Classes of rows by their likeness to few labelled ones: kernel ridge regression that knows how sure it may be.

Labelled rows are often as many of each class, which rows at large are not; how frequent each class is there is
estimated from rows without labels (Saerens, Latinne and Decaestecker 2002).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg.lapack import dpotrf, dpotri

NOISE = 0.1  # of the labels of the most frequent class, against 1 of the kernel
SHARPNESS = (2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 14.0, 20.0)
CLIP = 4.0  # deviations
STEPS = 50  # of the estimate of frequencies
_CHUNK = 1 << 14  # rows that are compared at once


class Scaling(NamedTuple):
    """How columns are made comparable.

    Attributes:
        middle: (F,) what is taken off.
        scale: (F,) what it is multiplied by then; 0 for columns that are the same everywhere.
        weights: (F,) share of each column in the squared distance of two rows; of sum 1.
    """

    middle: Float[np.ndarray, ' features']
    scale: Float[np.ndarray, ' features']
    weights: Float[np.ndarray, ' features']

    def apply(self, rows: Float[np.ndarray, 'rows features']) -> Float[np.ndarray, 'rows live']:
        """Deviations, clipped, times the root of their weights, in single precision; constant columns are left out."""
        live = self.scale > 0
        scaled = ((rows[:, live] - self.middle[live]) * self.scale[live]).clip(-CLIP, CLIP)
        return np.asarray(scaled * np.sqrt(self.weights[live]), dtype=np.float32)


def scaling_of(
    rows: Float[np.ndarray, 'rows features'], weights: Float[np.ndarray, ' features'] | None = None
) -> Scaling:
    """The scaling by which these rows have mean 0, and deviation 1 before their columns are weighed.

    Args:
        rows: At least one.
        weights: Of the columns, in any unit; None: all alike. Those of constant columns go to the others.
    """
    middle, deviation = rows.mean(axis=0, dtype=np.float64), rows.std(axis=0, dtype=np.float64)
    told = deviation > 1e-6 * (1.0 + np.abs(middle))
    shares = told * (np.ones(rows.shape[1]) if weights is None else weights)
    return Scaling(middle, np.where(told, 1.0 / np.where(told, deviation, 1.0), 0.0), shares / max(shares.sum(), 1e-12))


class KernelClassifier(NamedTuple):
    """What labelled rows say of others.

    Attributes:
        scaling: Of all rows.
        length: Of the kernel, in root mean square deviations of the columns.
        rows: (M, F) labelled ones, scaled.
        weights: (M, K) of the kernel to each of them.
        classes: (K,) that have a labelled row, ascending.
        sharpness: Of the softmax over classes.
    """

    scaling: Scaling
    length: float
    rows: Float[np.ndarray, 'examples features']
    weights: Float[np.ndarray, 'examples classes']
    classes: Int[np.ndarray, ' classes']
    sharpness: float

    def shares(self, rows: Float[np.ndarray, 'rows features'], count: int) -> Float[np.ndarray, 'rows count']:
        """How likely each of ``count`` classes is for rows (not scaled yet), were all with a labelled row as frequent.

        Classes without a labelled row have 0.
        """
        out = np.zeros((len(rows), count))
        for first in range(0, len(rows), _CHUNK):
            near = gaussian_kernel(self.scaling.apply(rows[first : first + _CHUNK]), self.rows, self.length)
            out[first : first + _CHUNK, self.classes] = _softmax(self.sharpness * (near @ self.weights))
        return out


def fit_kernel_classifier(
    rows: Float[np.ndarray, 'examples features'], classes: Int[np.ndarray, ' examples'], scaling: Scaling, length: float
) -> KernelClassifier:
    """Learn from labelled rows.

    The kernel is exp(-|difference|^2 / (2 length^2)); labels of rare classes are taken to be surer (their noise goes
    with the number of their rows). How sharp the softmax is is what gives each row, left out, its own class most
    likely, all classes counting alike.

    Args:
        rows: Labelled rows, not scaled.
        classes: Of each.
        scaling: See :func:`scaling_of`.
        length: Larger: rows that differ more speak for each other.

    Raises:
        ValueError: There is no labelled row.
    """
    if not len(rows):
        raise ValueError('fit_kernel_classifier: expected at least one labelled row')
    said, own = np.unique(classes, return_inverse=True)
    counts, scaled = np.bincount(own), scaling.apply(rows)
    wanted = np.eye(len(said))[own] - 1.0 / len(said)
    noise = np.diag(NOISE * (counts / counts.max())[own])
    inverse = _inverse(gaussian_kernel(scaled, scaled, length).astype(np.float64) + noise)
    weights = inverse @ wanted
    left_out = wanted - weights / np.diag(inverse)[:, None]
    sharpness = max(SHARPNESS, key=lambda sharp: _balanced_likelihood(sharp * left_out, own, counts))
    return KernelClassifier(scaling, length, scaled, weights.astype(np.float32), said, sharpness)


def evenly_chosen(classes: Int[np.ndarray, ' rows'], most: int) -> Int[np.ndarray, ' chosen']:
    """Rows, at most so many of each class, spread evenly over those there are; ordered by class.

    >>> evenly_chosen(np.array([1, 0, 1, 1, 1, 1]), 3)
    array([1, 0, 3, 5])
    """
    chosen = [np.zeros(0, dtype=np.int64)]
    for c in np.unique(classes):
        rows = np.flatnonzero(classes == c)
        chosen.append(rows[evenly_spread(len(rows), most)])
    return np.concatenate(chosen)


def evenly_spread(count: int, most: int) -> Int[np.ndarray, ' chosen']:
    """At most so many of ``count`` rows, the first and the last among them, as far apart as may be.

    >>> evenly_spread(9, 3)
    array([0, 4, 8])
    """
    return np.linspace(0, max(count - 1, 0), min(count, most)).astype(np.int64)


def class_prior_em(
    shares: Float[np.ndarray, 'rows classes'],
    sizes: Int[np.ndarray, ' rows'] | None = None,
    possible: Bool[np.ndarray, 'rows classes'] | None = None,
) -> Float[np.ndarray, ' classes']:
    """How frequent classes are among rows, from what a classifier that knew nothing of that says of each.

    Expectation-maximisation from equal frequencies (Saerens, Latinne and Decaestecker 2002).

    Args:
        shares: Not negative; rows need not sum to 1, and rows of zeros say nothing.
        sizes: How often each row counts; None: once.
        possible: Where a class may be: it is as frequent as found among these rows. None: everywhere.

    >>> class_prior_em(np.array([[0.9, 0.1], [0.9, 0.1], [0.9, 0.1], [0.1, 0.9]])).round(2)
    array([0.81, 0.19])
    """
    weights = np.ones((len(shares), 1)) if sizes is None else sizes[:, None].astype(np.float64)
    total = np.maximum((weights * (np.ones(shares.shape) if possible is None else possible)).sum(axis=0), 1e-12)
    frequencies = np.full(shares.shape[1], 1.0 / max(shares.shape[1], 1))
    for _ in range(STEPS if len(shares) else 0):
        frequencies = (normalised(shares * frequencies) * weights).sum(axis=0) / total
    return frequencies


def normalised(shares: Float[np.ndarray, 'rows classes']) -> Float[np.ndarray, 'rows classes']:
    """Rows of sum 1; rows of zeros stay."""
    total = shares.sum(axis=1, keepdims=True)
    return np.asarray(shares / np.where(total > 0, total, 1.0))


def _inverse(matrix: Float[np.ndarray, 'rows rows']) -> Float[np.ndarray, 'rows rows']:
    """Of a symmetric positive definite matrix, by Cholesky: a third of the time of a general one."""
    lower, failed = dpotrf(matrix, lower=1)
    half, failed_too = dpotri(lower, lower=1)
    if failed or failed_too:
        raise np.linalg.LinAlgError('kernel of labelled rows: not positive definite')
    half = np.tril(half)
    return np.asarray(half + np.tril(half, -1).T)


def gaussian_kernel(
    rows: Float[np.ndarray, 'rows features'], others: Float[np.ndarray, 'others features'], length: float
) -> Float[np.ndarray, 'rows others']:
    """exp(-|difference|^2 / (2 length^2)) of every pair of rows."""
    squared = np.square(rows).sum(axis=1)[:, None] + np.square(others).sum(axis=1) - 2.0 * (rows @ others.T)
    return np.asarray(np.exp(np.maximum(squared, 0.0) / (-2.0 * length**2)))


def _softmax(values: Float[np.ndarray, 'rows classes']) -> Float[np.ndarray, 'rows classes']:
    powers = np.exp(values - values.max(axis=1, keepdims=True))
    return np.asarray(powers / powers.sum(axis=1, keepdims=True))


def _balanced_likelihood(
    values: Float[np.ndarray, 'rows classes'], own: Int[np.ndarray, ' rows'], counts: Int[np.ndarray, ' classes']
) -> float:
    said = _softmax(values)[np.arange(len(own)), own]
    return float((np.log(said + 1e-9) / counts[own]).sum())
