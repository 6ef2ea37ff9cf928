"""How good labels are, from those that were left out: an estimate of the mean IoU with an interval.

Labels that were left out tell how often points of each class are named what (their confusion), but not how frequent
classes are: often as many of each class were given. The answer's own frequencies, which are known exactly, tell that.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.kernel_classes import normalised

SHARPNESS = (0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8)  # powers that are tried for probabilities to be right as often as said
BELIEF = 2.0  # labels that the answer's own probabilities count as, in each class
STEPS = 100  # of the estimate of frequencies
INSIDE = (0.05, 0.95)  # quantiles of the draws that the interval spans
LEAST = 1e-6


class Estimate(NamedTuple):
    """Of the mean IoU of the classes that are there, on points without a label; percent.

    Attributes:
        miou: Expected.
        low: It is above this in nineteen of twenty draws.
        high: It is below this in nineteen of twenty draws.
        labels: That were left out.
        sharpness: Power of the probabilities by which they are right as often as they say.
    """

    miou: float
    low: float
    high: float
    labels: int
    sharpness: float

    def text(self) -> str:
        """As a person reads it."""
        return f'about {self.miou:.0f} ({self.low:.0f} to {self.high:.0f}) mIoU'


def estimate_miou(
    shares: Float[np.ndarray, 'points classes'],
    left_shares: Float[np.ndarray, 'left classes'],
    left_classes: Int[np.ndarray, ' left'],
    draws: int,
    generator: np.random.Generator,
) -> Estimate | None:
    """Estimate the mean IoU of an answer.

    The confusion of each class is drawn from a Dirichlet distribution: left-out labels of the class, and
    :data:`BELIEF` more spread as the answer's own probabilities say (what twenty labels do not show, such as one floor
    point in a hundred called pole, those do). Given a confusion, the frequencies of the classes are those by which the
    answer's frequencies come about.

    Args:
        shares: Answer at the points without a label; rows of sum 1.
        left_shares: Answer at labels that were left out.
        left_classes: Of these.
        draws: Of the interval.
        generator: Of the draws.

    Returns:
        None where there is no point without a label.
    """
    if not len(shares) or not len(left_shares):
        return None
    named = shares.argmax(axis=1)
    count = shares.shape[1]
    found = np.bincount(named, minlength=count) / len(named)
    power = best_sharpness(left_shares, left_classes, found)
    counts = np.zeros((count, count))
    np.add.at(counts, (left_classes, left_shares.argmax(axis=1)), 1.0)
    weights = counts + BELIEF * believed_confusion(shares, named, power) + LEAST
    means = [100.0 * float(mean_iou(_drawn(weights, generator), found)) for _ in range(draws)]
    expected = float(np.mean(means)) if means else 100.0 * float(mean_iou(normalised(weights), found))
    low, high = np.quantile(means, INSIDE).tolist() if means else (0.0, 100.0)
    return Estimate(expected, low, high, len(left_classes), power)


def best_sharpness(
    left_shares: Float[np.ndarray, 'left classes'],
    left_classes: Int[np.ndarray, ' left'],
    found: Float[np.ndarray, ' classes'],
) -> float:
    """The power of the shares by which the left-out labels are likeliest, each class counting as often as it is found.

    Args:
        left_shares: Rows of sum 1, or zeros.
        left_classes: True ones.
        found: Frequency of the classes in the answer.
    """
    counts = np.bincount(left_classes, minlength=len(found))
    weight = (found + 1.0 / len(found))[left_classes] / counts[left_classes]
    logs = np.log(np.maximum(left_shares, LEAST))

    def likelihood(power: float) -> float:
        rows = power * logs
        top = rows.max(axis=1)
        total = top + np.log(np.exp(rows - top[:, None]).sum(axis=1))
        return float(weight @ (rows[np.arange(len(rows)), left_classes] - total))

    return max(SHARPNESS, key=likelihood)


def believed_confusion(
    shares: Float[np.ndarray, 'points classes'], named: Int[np.ndarray, ' points'], power: float
) -> Float[np.ndarray, 'classes named']:
    """Of the points that the probabilities believe to be of a class, the share with each name; rows of sum 1."""
    count = shares.shape[1]
    sums = np.zeros((count, count))
    for own in range(count):
        sums[:, own] = normalised(np.maximum(shares[named == own], LEAST) ** power).sum(axis=0, dtype=np.float64)
    return normalised(np.maximum(sums, LEAST))


def mean_iou(confusion: Float[np.ndarray, 'classes named'], found: Float[np.ndarray, ' classes']) -> float:
    """Mean IoU of a confusion with rows of sum 1, where names are found so frequently.

    The frequencies of the true classes are the likeliest ones (expectation maximisation; Saerens, Latinne and
    Decaestecker 2002).

    >>> round(mean_iou(np.eye(2), np.array([0.9, 0.1])), 3)
    1.0
    """
    true = np.full(len(found), 1.0 / len(found))
    for _ in range(STEPS):
        joint = true[:, None] * confusion
        true = (joint / np.maximum(joint.sum(axis=0), 1e-12) * found).sum(axis=1)
    hits = true * np.diag(confusion)
    union = true + confusion.T @ true - hits
    return float(np.mean(hits / np.maximum(union, 1e-12)))


def _drawn(
    weights: Float[np.ndarray, 'classes named'], generator: np.random.Generator
) -> Float[np.ndarray, 'classes named']:
    """A confusion from its Dirichlet distribution, row by row."""
    return normalised(np.maximum(generator.gamma(weights), 1e-12))
