"""Classes of regions, propagated over a graph of all regions of a scene (One Thing One Click, CVPR 2021)."""

import numpy as np
from jaxtyping import Float, Int
from scipy.special import softmax

STEPS = 5  # of mean field
_BLOCK = 1 << 10  # rows of the kernel that are held at once


def mean_field(
    unary: Float[np.ndarray, 'regions classes'],
    features: Float[np.ndarray, 'regions columns'],
    known: Int[np.ndarray, ' regions'],
    steps: int = STEPS,
) -> Float[np.ndarray, 'regions classes']:
    """Class probabilities of regions where those that are alike share a class.

    A step takes q_i to softmax(log p_i + sum_j k_ij q_j) over all other regions, with the kernel
    k_ij = exp(-|f_i - f_j|^2 / 2).

    Args:
        unary: p, of the network.
        features: f, in units in which a difference of 1 is a large one.
        known: Class of the regions that are labelled, which keep it; -1 elsewhere.
        steps: Larger: classes travel farther.
    """
    fixed = np.flatnonzero(known >= 0)
    certain = np.eye(unary.shape[1])[known[fixed]]
    logs, said = np.log(np.maximum(unary, 1e-12)), unary.astype(np.float64)
    said[fixed] = certain
    for _ in range(steps):
        said = softmax(logs + _heard(said, features), axis=1)
        said[fixed] = certain
    return said


def _heard(said: np.ndarray, features: np.ndarray) -> Float[np.ndarray, 'regions classes']:
    """Sum over the other regions, block by block: the kernel of a large scene is larger than memory."""
    squares = np.square(features).sum(axis=1)
    out = np.empty_like(said)
    for first in range(0, len(said), _BLOCK):
        rows = slice(first, first + _BLOCK)
        apart = squares[rows, None] + squares - 2.0 * features[rows] @ features.T
        out[rows] = np.exp(-0.5 * np.maximum(apart, 0.0)) @ said
    return out - said  # a region does not hear itself
