"""Labels that are left out, of many scans: how sure the answers may be of themselves."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.propagation.beside import Beside
from rm3d_plugin.pseudo_labels.propagation.estimate import power_as_claimed
from rm3d_plugin.pseudo_labels.propagation.folds import label_folds
from rm3d_plugin.pseudo_labels.propagation.labels import one_of_each
from rm3d_plugin.pseudo_labels.propagation.left_out import strength_of
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud
from rm3d_plugin.pseudo_labels.propagation.propagate import labels_of
from rm3d_plugin.pseudo_labels.propagation.rules import DEFAULT, WalkerRules
from rm3d_plugin.pseudo_labels.propagation.solve import at_points, coarse_graphs, solve


class CheckedLabels(NamedTuple):
    """What was said of labels that were left out, one of each place.

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
    part[alone] = np.unique(labels.places[alone], return_inverse=True)[1] % folds
    shares, found = np.zeros((len(part), num_classes)), np.zeros(num_classes)
    for number in np.unique(part):
        asked = part == number
        told = labels.select(~asked)
        if not len(told.points) and not len(told.others):
            continue
        said = at_points(graphs, solve(scene, graphs, told, strength_of(DEFAULT, told, rules), rules))
        shares[np.ix_(asked, present)] = said[labels.points[asked]]
        found[present] += np.bincount(said.argmax(axis=1), minlength=len(present))
    rows = one_of_each(labels.places, rules.seed)
    rows = rows[shares[rows].sum(axis=1) > 0]  # of those for which others were left to ask
    return CheckedLabels(shares[rows], annotated[labels.points[rows]].astype(np.int64), found)


def joined(checked: Sequence[CheckedLabels]) -> CheckedLabels:
    """Of several scans, at least one."""
    shares, classes, found = zip(*checked, strict=True)
    return CheckedLabels(np.concatenate(shares), np.concatenate(classes), np.sum(found, axis=0))


def sharpness_of(checked: CheckedLabels) -> float:
    """Power of the answers' probabilities by which they are right as often as they say.

    Among labels that are left out, each as often as its class is in the answers, the mean probability of the class
    that is named is the share of those that come out right.

    Args:
        checked: With a label at least; where no labelled class is among the answers, the usual power holds.
    """
    return power_as_claimed(*checked)
