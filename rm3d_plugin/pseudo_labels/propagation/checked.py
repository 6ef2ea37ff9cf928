"""Labels that are left out, of many scans: how sure the answers may be of themselves."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.propagation.beside import Beside
from rm3d_plugin.pseudo_labels.propagation.estimate import (
    INSIDE,
    LABELS_WORTH,
    LEAST,
    LEAST_LABELS,
    SAMPLE,
    Estimate,
    expected_ious,
)
from rm3d_plugin.pseudo_labels.propagation.folds import label_folds
from rm3d_plugin.pseudo_labels.propagation.left_out import strength_of
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud
from rm3d_plugin.pseudo_labels.propagation.propagate import labels_of
from rm3d_plugin.pseudo_labels.propagation.rules import DEFAULT, WalkerRules
from rm3d_plugin.pseudo_labels.propagation.solve import at_points, coarse_graphs, solve

POWERS = tuple(2.0 ** (step / 4) for step in range(-8, 13))  # of the probabilities that are tried, 1/4 to 8


class CheckedLabels(NamedTuple):
    """What was said of labels that were left out.

    Attributes:
        shares: (L, C) rows of sum 1.
        classes: (L,) true ones.
        found: (C,) points of each class in the answers.
    """

    shares: Float[np.ndarray, 'left classes']
    classes: Int[np.ndarray, ' left']
    found: Float[np.ndarray, ' classes']


def check_labels(
    scene: PreparedCloud,
    annotated: Int[np.ndarray, ' points'],
    num_classes: int,
    rules: WalkerRules,
    beside: Beside,
) -> CheckedLabels:
    """Leave the labels of a scan out part by part; a class without another label here is known from other scans.

    Args:
        scene: The scan.
        annotated: Class of each point, -1 = unknown.
        num_classes: Number of classes.
        rules: How many parts, and on how coarse a graph.
        beside: Examples of other scans, and the classes that may be here.
    """
    present, labels = labels_of(scene, annotated, num_classes, beside)
    graphs, folds = coarse_graphs(scene, labels.points, rules.left_out_nodes), max(rules.folds, 2)
    part = label_folds(labels, folds, np.random.default_rng(rules.seed))
    alone = part < 0
    part[alone] = np.arange(np.count_nonzero(alone)) % folds
    shares, found = np.zeros((len(part), num_classes)), np.zeros(num_classes)
    for number in np.unique(part):
        asked = part == number
        told = labels.select(~asked)
        if not len(told.points) and not len(told.others):
            continue
        said = at_points(graphs, solve(scene, graphs, told, strength_of(DEFAULT, told, rules), rules))
        shares[np.ix_(asked, present)] = said[labels.points[asked]]
        found[present] += np.bincount(said.argmax(axis=1), minlength=len(present))
    return CheckedLabels(shares, annotated[labels.points].astype(np.int64), found)


def joined(checked: Sequence[CheckedLabels]) -> CheckedLabels:
    """Of several scans, at least one."""
    shares, classes, found = zip(*checked, strict=True)
    return CheckedLabels(np.concatenate(shares), np.concatenate(classes), np.sum(found, axis=0))


def sharpness_of(checked: CheckedLabels) -> float:
    """Power of the answers' probabilities by which they are right as often as they say.

    Among labels that are left out, each as often as its class is in the answers, the mean probability of the class
    that is named is the share of those that come out right.

    Args:
        checked: With a label at least.
    """
    return float(POWERS[np.abs(_claimed_too_much(checked) @ _as_found(checked)).argmin()])


def estimate_across(
    shares: Float[np.ndarray, 'points classes'], checked: CheckedLabels, draws: int, generator: np.random.Generator
) -> Estimate | None:
    """:func:`~rm3d_plugin.pseudo_labels.propagation.estimate.estimate_miou` of answers over many scans.

    The power of the probabilities is that of :func:`sharpness_of`, in each draw with another choice of labels.

    Args:
        shares: Answers at points without a label, as sharp as those of ``checked``.
        checked: Labels that were left out.
        draws: Of the interval, at least one.
        generator: Of the draws.

    Returns:
        None where there is no point, or where fewer than half of the classes have enough labels that were left out.
    """
    there = np.flatnonzero(checked.found > 0)
    counts = np.bincount(checked.classes, minlength=len(checked.found))[there]
    if not len(shares) or 2 * np.count_nonzero(counts >= LEAST_LABELS) < len(counts):
        return None
    few = shares[:: -(-len(shares) // SAMPLE)][:, there]
    expected = np.stack([expected_ious(few, power) for power in POWERS])
    labels = len(checked.classes)
    weights = np.concatenate([np.ones((1, labels)), generator.exponential(size=(draws, labels))])
    chosen = np.abs((weights * _as_found(checked)) @ _claimed_too_much(checked).T).argmin(axis=1)
    worth, centre = LABELS_WORTH * (counts + 1), expected[chosen[1:]].clip(0.01, 0.99)
    drawn = generator.beta(centre * worth, (1.0 - centre) * worth).mean(axis=1)
    middle, (low, high) = float(expected[chosen[0]].mean()), np.quantile(drawn, INSIDE).tolist()
    sharpness = float(POWERS[chosen[0]])
    return Estimate(100 * middle, 100 * min(low, middle), 100 * max(high, middle), labels, sharpness)


def _claimed_too_much(checked: CheckedLabels) -> Float[np.ndarray, 'powers left']:
    """By how much the probability of the class that is named is above 1 where it is right, and above 0 where not."""
    right = checked.shares.argmax(axis=1) == checked.classes
    raised = np.maximum(checked.shares, LEAST) ** np.array(POWERS)[:, None, None]
    return np.asarray(raised.max(axis=2) / raised.sum(axis=2) - right)


def _as_found(checked: CheckedLabels) -> Float[np.ndarray, ' left']:
    """Weight of each label: those of a class together as frequent as the class is in the answers."""
    weight = checked.found[checked.classes] / np.bincount(checked.classes)[checked.classes]
    return np.asarray(weight / max(float(weight.sum()), LEAST))
