"""Classes of rows by their likeness to few labelled ones: kernel ridge regression that knows how sure it may be.

Labelled rows are often as many of each class, which rows at large are not; how frequent each class is there is
estimated from rows without labels (Saerens, Latinne and Decaestecker 2002).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

LENGTH = 1.5  # of the kernel, in deviations of one column, for each column
NOISE = 0.1  # of the labels of the most frequent class, against 1 of the kernel
SHARPNESS = (2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 14.0, 20.0)
CLIP = 4.0  # deviations
STEPS = 50  # of the estimate of frequencies
_CHUNK = 1 << 14  # rows that are compared at once


class Scaling(NamedTuple):
    """How columns are made alike.

    Attributes:
        middle: (F,) what is taken off.
        scale: (F,) what it is multiplied by then; 0 for columns that are the same everywhere.
    """

    middle: Float[np.ndarray, ' features']
    scale: Float[np.ndarray, ' features']

    def apply(self, rows: Float[np.ndarray, 'rows features']) -> Float[np.ndarray, 'rows features']:
        """Columns of mean 0 and deviation 1, clipped, in single precision; constant ones are left out."""
        live = self.scale > 0
        scaled = (rows[:, live] - self.middle[live]) * self.scale[live]
        return np.asarray(scaled.clip(-CLIP, CLIP), dtype=np.float32)


def scaling_of(rows: Float[np.ndarray, 'rows features']) -> Scaling:
    """The scaling by which these rows have mean 0 and deviation 1."""
    middle, deviation = rows.mean(axis=0, dtype=np.float64), rows.std(axis=0, dtype=np.float64)
    told = deviation > 1e-6 * (1.0 + np.abs(middle))
    return Scaling(middle, np.where(told, 1.0 / np.where(told, deviation, 1.0), 0.0))


class KernelClasses(NamedTuple):
    """What labelled rows say of others.

    Attributes:
        scaling: Of all rows.
        rows: (M, F) labelled ones, scaled.
        weights: (M, K) of the kernel to each of them.
        classes: (K,) that have a labelled row, ascending.
        sharpness: Of the softmax over classes.
        frequencies: (K,) share of each class among the rows at large.
    """

    scaling: Scaling
    rows: Float[np.ndarray, 'examples features']
    weights: Float[np.ndarray, 'examples classes']
    classes: Int[np.ndarray, ' classes']
    sharpness: float
    frequencies: Float[np.ndarray, ' classes']

    def shares(self, rows: Float[np.ndarray, 'rows features'], count: int) -> Float[np.ndarray, 'rows count']:
        """How likely each of ``count`` classes is for rows (not scaled yet); 0 for classes without a labelled row."""
        out = np.zeros((len(rows), count))
        for first in range(0, len(rows), _CHUNK):
            part = self.scaling.apply(rows[first : first + _CHUNK])
            said = _softmax(self.sharpness * (_kernel(part, self.rows) @ self.weights)) * self.frequencies
            out[first : first + _CHUNK, self.classes] = said / said.sum(axis=1, keepdims=True)
        return out


def fit_kernel_classes(
    rows: Float[np.ndarray, 'examples features'],
    classes: Int[np.ndarray, ' examples'],
    scaling: Scaling,
    at_large: Float[np.ndarray, 'rows features'],
) -> KernelClasses:
    """Learn from labelled rows, and estimate frequencies from others.

    The kernel is exp(-|difference|^2 / (2 LENGTH^2 F)); labels of rare classes are taken to be surer (their noise goes
    with the number of their rows). How sharp the softmax is is what gives each row, left out, its own class most
    likely, all classes counting alike.

    Args:
        rows: Labelled rows, not scaled.
        classes: Of each.
        scaling: See :func:`scaling_of`.
        at_large: Rows, not scaled, among which classes are as frequent as anywhere.

    Raises:
        ValueError: There is no labelled row.
    """
    if not len(rows):
        raise ValueError('fit_kernel_classes: expected at least one labelled row')
    said, own = np.unique(classes, return_inverse=True)
    counts, scaled = np.bincount(own), scaling.apply(rows)
    wanted = np.eye(len(said))[own] - 1.0 / len(said)
    noise = np.diag(NOISE * (counts / counts.max())[own])
    inverse = np.linalg.inv(_kernel(scaled, scaled).astype(np.float64) + noise)
    weights = inverse @ wanted
    left_out = wanted - weights / np.diag(inverse)[:, None]
    sharpness = max(SHARPNESS, key=lambda sharp: _balanced_likelihood(sharp * left_out, own, counts))
    found = KernelClasses(scaling, scaled, weights.astype(np.float32), said, sharpness, np.ones(len(said)))
    return found._replace(frequencies=class_frequencies(found.shares(at_large, int(said[-1]) + 1)[:, said]))


def class_frequencies(shares: Float[np.ndarray, 'rows classes']) -> Float[np.ndarray, ' classes']:
    """How frequent classes are among rows, from what a classifier that knew nothing of that says of each.

    Expectation-maximisation from equal frequencies (Saerens, Latinne and Decaestecker 2002).

    >>> class_frequencies(np.array([[0.9, 0.1], [0.9, 0.1], [0.9, 0.1], [0.1, 0.9]])).round(2)
    array([0.81, 0.19])
    """
    frequencies = np.full(shares.shape[1], 1.0 / max(shares.shape[1], 1))
    if not len(shares):
        return frequencies
    for _ in range(STEPS):
        said = shares * frequencies
        frequencies = (said / said.sum(axis=1, keepdims=True)).mean(axis=0)
    return frequencies


def _kernel(
    rows: Float[np.ndarray, 'rows features'], others: Float[np.ndarray, 'others features']
) -> Float[np.ndarray, 'rows others']:
    squared = np.square(rows).sum(axis=1)[:, None] + np.square(others).sum(axis=1) - 2.0 * (rows @ others.T)
    return np.asarray(np.exp(np.maximum(squared, 0.0) / (-2.0 * LENGTH**2 * max(rows.shape[1], 1))))


def _softmax(values: Float[np.ndarray, 'rows classes']) -> Float[np.ndarray, 'rows classes']:
    powers = np.exp(values - values.max(axis=1, keepdims=True))
    return np.asarray(powers / powers.sum(axis=1, keepdims=True))


def _balanced_likelihood(
    values: Float[np.ndarray, 'rows classes'], own: Int[np.ndarray, ' rows'], counts: Int[np.ndarray, ' classes']
) -> float:
    said = _softmax(values)[np.arange(len(own)), own]
    return float((np.log(said + 1e-9) / counts[own]).sum())
