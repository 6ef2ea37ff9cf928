"""What each candidate says of labels that it was not told."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.pseudo_labels.propagation.folds import label_folds
from rm3d_plugin.pseudo_labels.propagation.given_up import still_wanted
from rm3d_plugin.pseudo_labels.propagation.labels import Labels, one_of_each
from rm3d_plugin.pseudo_labels.propagation.nearest import nearest_label, nearest_label_in_place_and_colour
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud
from rm3d_plugin.pseudo_labels.propagation.rules import DEFAULT, Candidate, WalkerRules
from rm3d_plugin.pseudo_labels.propagation.solve import CoarseGraph, at_points, coarse_graphs, solve, trust_of


class LeftOut(NamedTuple):
    """Answers at labels that were left out.

    Attributes:
        rows: Which of the labels could be left out, one of each place: others beside it tell the same.
        shares: Candidate -> (L, C) what it says of these; trivial answers are sure.
    """

    rows: Int[np.ndarray, ' left']
    shares: dict[Candidate, Float[np.ndarray, 'left classes']]


def leave_labels_out(
    scene: PreparedCloud, labels: Labels, candidates: Sequence[Candidate], rules: WalkerRules
) -> LeftOut | None:
    """Leave the labels out part by part, and ask every candidate about them.

    Args:
        scene: The scan.
        labels: Of its points.
        candidates: That are asked.
        rules: How many parts, and on how coarse graphs.

    Returns:
        None where labels of too few places can be left out (:attr:`WalkerRules.least_left_out`).
    """
    part = label_folds(labels, max(rules.folds, 2), np.random.default_rng(rules.seed))
    rows = np.flatnonzero(part >= 0)
    rows = rows[one_of_each(labels.places[rows], rules.seed)]
    if rules.folds < 2 or len(rows) < rules.least_left_out:
        return None
    graphs = coarse_graphs(scene, labels.points, rules.left_out_nodes)
    shares: dict[Candidate, np.ndarray] = {name: np.zeros((len(part), labels.num_classes)) for name in candidates}
    for number in np.unique(part[rows]):
        asked = part == number
        for name in candidates:
            still_wanted()
            shares[name][asked] = _asked(name, scene, graphs, labels, asked, rules)
    return LeftOut(rows, {name: each[rows] for name, each in shares.items()})


def _asked(
    name: Candidate,
    scene: PreparedCloud,
    graphs: list[CoarseGraph],
    labels: Labels,
    asked: Bool[np.ndarray, ' labelled'],
    rules: WalkerRules,
) -> Float[np.ndarray, 'asked classes']:
    told, points = labels.select(~asked), labels.points[asked]
    if name in ('nearest', 'nearest in place and colour'):
        few = scene.cloud.select(np.concatenate([told.points, points]))
        known = np.arange(len(told.points))
        said = (
            nearest_label(few.xyz, known, told.classes)
            if name == 'nearest'
            else nearest_label_in_place_and_colour(few, known, told.classes)
        )
        return np.asarray(np.eye(labels.num_classes)[said[len(known) :]])
    found = solve(scene, graphs, told, strength_of(name, told, rules), rules)
    return at_points(graphs, found)[points].astype(np.float64)


def strength_of(name: Candidate, labels: Labels, rules: WalkerRules) -> float:
    """Of the features, by candidate and by how many labels of each class teach them."""
    if name != DEFAULT:
        return 0.0
    return rules.features_strength + trust_of(labels, rules) * (rules.taught_strength - rules.features_strength)
