"""How good labels are, from those that were left out: an estimate of the mean IoU with an interval.

As many labels of each class are given, often, which points at large are not: the share of left-out labels that come out
right is far from the mean IoU, where one floor point in fifty called pole is what ruins the poles. So the labels that
were left out only tell how sure the answer may be of itself (its probabilities are sharpened or flattened until they
are right as often as they say); the IoU is then what the probabilities of all points expect it to be. Two ways to tell
count alike: the power by which left-out labels are likeliest, and the power by which as many are right as are claimed.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.common.kernel_classifier import normalised

POWERS = tuple(2.0 ** (step / 4) for step in range(-8, 13))  # of the probabilities that are tried, 1/4 to 8
USUAL = 2.0  # of the answers of the chosen scans: they have all labels, those that are checked four of five
HELD = 20.0  # log likelihood, of all labels together, that a power e times the usual one must gain
LABELS_WORTH = 0.9  # observations of a class's IoU that a left-out label counts as; chosen so that intervals hold
LEAST_LABELS = 3  # of a class that can be left out, in half of the classes, or there is no estimate
INSIDE = (0.05, 0.95)  # quantiles of the draws that the interval spans
SAMPLE = 1 << 16  # points that stand for all
LEAST = 1e-6


class Estimate(NamedTuple):
    """Of the mean IoU of the classes that are labelled, on points without a label; percent.

    Attributes:
        miou: Expected.
        low: It is above this in nineteen of twenty draws.
        high: It is below this in nineteen of twenty draws.
        labels: That were left out.
        sharpness: Power of the probabilities by which left-out labels are likeliest.
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
    """Estimate the mean IoU of an answer, of one scan or of many together.

    Args:
        shares: Answer at the points without a label; rows of sum 1.
        left_shares: Answer at labels that were left out.
        left_classes: Of these.
        draws: Of the interval, at least one.
        generator: Of the draws.

    Returns:
        None where there is no point without a label, or where fewer than half of the classes have
        :data:`LEAST_LABELS` labels that were left out.
    """
    counts = np.bincount(left_classes, minlength=shares.shape[1])
    if not len(shares) or 2 * np.count_nonzero(counts >= LEAST_LABELS) < len(counts):
        return None
    some = shares[:: -(-len(shares) // SAMPLE)]
    found = np.bincount(some.argmax(axis=1), minlength=len(counts)) / len(some)
    expected = np.stack([expected_ious(some, power) for power in POWERS])
    gains, excess = label_gains(left_shares, left_classes, found), label_excess(left_shares, left_classes, found)
    drawn = miou_draws(expected, gains, excess, counts, draws, generator)
    low, high = np.quantile(drawn, INSIDE).tolist()
    sharpness = POWERS[int(gains.sum(axis=1).argmax())]
    return Estimate(100 * float(drawn.mean()), 100 * low, 100 * high, len(left_classes), sharpness)


def label_gains(
    left_shares: Float[np.ndarray, 'left classes'],
    left_classes: Int[np.ndarray, ' left'],
    found: Float[np.ndarray, ' classes'],
) -> Float[np.ndarray, 'powers left']:
    """What each left-out label says for each power of the shares; the power with the largest sum is the likeliest.

    Log likelihoods, less the label's part in what holds to the usual power. Labels of a class count together as the
    class is frequent in the answer, and as one of all classes, half and half.

    Args:
        left_shares: Rows of sum 1, or zeros.
        left_classes: True ones.
        found: Frequency of the classes in the answer.
    """
    weight = label_weights(left_classes, found)
    rows = np.array(POWERS)[:, None, None] * np.log(np.maximum(left_shares, LEAST))
    rows = rows - rows.max(axis=2, keepdims=True)
    rows -= np.log(np.exp(rows).sum(axis=2, keepdims=True))
    likelihood = weight * rows[:, np.arange(len(weight)), left_classes]
    away = np.square(np.log(np.array(POWERS) / USUAL))[:, None]
    return np.asarray(likelihood - HELD / max(len(weight), 1) * away)


def label_weights(
    left_classes: Int[np.ndarray, ' left'], found: Float[np.ndarray, ' classes']
) -> Float[np.ndarray, ' left']:
    """How much each label counts, 1 in the mean: see :func:`label_gains`."""
    counts = np.bincount(left_classes, minlength=len(found))
    weight = (found + 1.0 / len(found))[left_classes] / counts[left_classes]
    return np.asarray(weight * (len(weight) / weight.sum()))


def label_excess(
    left_shares: Float[np.ndarray, 'left classes'],
    left_classes: Int[np.ndarray, ' left'],
    found: Float[np.ndarray, ' classes'],
) -> Float[np.ndarray, 'powers left']:
    """How far more is claimed of each left-out label than is true; by the power with a sum of 0 as many come out right.

    The probability of the class that is named, less 1 where it is right. Labels of a class count together as the class
    is frequent in the answer.

    Args:
        left_shares: See :func:`label_gains`.
        left_classes: See :func:`label_gains`.
        found: Points of each class in the answer, or their shares.
    """
    right = left_shares.argmax(axis=1) == left_classes
    raised = np.maximum(left_shares, LEAST) ** np.array(POWERS)[:, None, None]
    claimed = raised.max(axis=2) / raised.sum(axis=2)
    weight = found[left_classes] / np.bincount(left_classes, minlength=len(found))[left_classes]
    return np.asarray(weight / max(float(weight.sum()), LEAST) * (claimed - right))


def power_as_claimed(
    left_shares: Float[np.ndarray, 'left classes'],
    left_classes: Int[np.ndarray, ' left'],
    found: Float[np.ndarray, ' classes'],
) -> float:
    """Power of the shares by which as many left-out labels come out right as are claimed.

    Args:
        left_shares: See :func:`label_excess`; where no labelled class is among the answers, the usual power holds.
        left_classes: See :func:`label_excess`.
        found: See :func:`label_excess`.
    """
    excess = label_excess(left_shares, left_classes, found).sum(axis=1)
    return float(POWERS[np.abs(excess).argmin()]) if excess.any() else USUAL


def expected_ious(shares: Float[np.ndarray, 'points classes'], power: float) -> Float[np.ndarray, ' classes']:
    """IoU of each class as the probabilities expect it, were they right as often as they say.

    >>> expected_ious(np.array([[0.9, 0.1], [0.9, 0.1], [0.2, 0.8]]), 1.0).round(2)
    array([0.82, 0.67])
    """
    raised = np.maximum(shares, LEAST) ** power
    raised /= raised.sum(axis=1, keepdims=True)
    named = shares.argmax(axis=1)
    hits = np.bincount(named, raised[np.arange(len(named)), named], shares.shape[1])
    union = raised.sum(axis=0, dtype=np.float64) + np.bincount(named, minlength=shares.shape[1]) - hits
    return np.asarray(hits / np.maximum(union, LEAST))


def miou_draws(
    expected: Float[np.ndarray, 'powers classes'],
    gains: Float[np.ndarray, 'powers left'],
    excess: Float[np.ndarray, 'powers left'],
    counts: Int[np.ndarray, ' classes'],
    draws: int,
    generator: np.random.Generator,
) -> Float[np.ndarray, ' draws']:
    """Mean IoUs that may be: another choice of labels (Bayesian bootstrap, Rubin 1981), and classes that differ.

    The IoU of each class is drawn from a Beta distribution about what is expected, as wide as if it had been seen in
    :data:`LABELS_WORTH` observations for each of its labels and one more.

    Args:
        expected: IoU of each class, by power.
        gains: Of :func:`label_gains`.
        excess: Of :func:`label_excess`.
        counts: Left-out labels of each class.
        draws: How many.
        generator: Of the draws.
    """
    weights = generator.exponential(size=(draws, gains.shape[1]))
    likeliest = (weights @ gains.T).argmax(axis=1)
    as_claimed = np.abs(weights @ excess.T).argmin(axis=1) if excess.any() else likeliest
    centre = ((expected[likeliest] + expected[as_claimed]) / 2).clip(0.01, 0.99)
    worth = LABELS_WORTH * (counts + 1)
    return np.asarray(generator.beta(centre * worth, (1.0 - centre) * worth).mean(axis=1))


def calibrated(shares: Float[np.ndarray, 'points classes'], power: float) -> Float[np.ndarray, 'points classes']:
    """Probabilities that are right as often as they say; the class of a point stays."""
    shares = np.maximum(shares, 0.0)
    most = shares.max(axis=1, keepdims=True, initial=0.0)
    return np.asarray(normalised((shares / np.where(most > 0, most, 1.0)) ** power), dtype=np.float32)
