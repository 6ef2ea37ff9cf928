"""Labels that are left out, of many scans: how sure the answers may be of themselves."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.propagation.beside import Beside
from rm3d_plugin.pseudo_labels.propagation.estimate import SHARPNESS, label_gains
from rm3d_plugin.pseudo_labels.propagation.folds import label_folds
from rm3d_plugin.pseudo_labels.propagation.left_out import strength_of
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud
from rm3d_plugin.pseudo_labels.propagation.propagate import labels_of
from rm3d_plugin.pseudo_labels.propagation.rules import DEFAULT, WalkerRules
from rm3d_plugin.pseudo_labels.propagation.solve import coarse_scene, solve


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
    coarse = coarse_scene(scene, labels.nodes, rules.left_out_nodes)
    node, folds = coarse.coarse.node, max(rules.folds, 2)
    xyz = scene.cloud.xyz[labels.nodes].astype(np.float64)
    part = label_folds(xyz, labels.classes, scene.spacing, folds, np.random.default_rng(rules.seed))
    alone = part < 0
    part[alone] = np.arange(np.count_nonzero(alone)) % folds
    shares, found = np.zeros((len(part), num_classes)), np.zeros(num_classes)
    for number in np.unique(part):
        asked = part == number
        told = labels.select(~asked)
        if not len(told.nodes) and not len(told.others):
            continue
        said = solve(coarse, told.at(node), strength_of(DEFAULT, told.classes, rules), rules).shares
        shares[np.ix_(asked, present)] = said[node[labels.nodes[asked]]]
        found[present] += np.bincount(said.argmax(axis=1), coarse.coarse.sizes, len(present))
    return CheckedLabels(shares, annotated[labels.nodes].astype(np.int64), found)


def sharpness_of(checked: list[CheckedLabels]) -> float:
    """Power of the answers' probabilities by which they are right as often as they say, from labels of all scans.

    Args:
        checked: Of :func:`check_labels`, at least one, with a label in all.
    """
    found = np.sum([each.found for each in checked], axis=0)
    shares = np.concatenate([each.shares for each in checked])
    classes = np.concatenate([each.classes for each in checked])
    gains = label_gains(shares, classes, found / max(float(found.sum()), 1.0))
    return SHARPNESS[int(gains.mean(axis=1).argmax())]
