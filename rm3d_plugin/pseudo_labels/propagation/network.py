"""What a network says of a scan, and whether labels that it was not taught let it speak."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from rm3d_plugin.pseudo_labels.common.kernel_classifier import normalised
from rm3d_plugin.pseudo_labels.propagation.labels import Labels
from rm3d_plugin.pseudo_labels.propagation.left_out import strength_of
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud
from rm3d_plugin.pseudo_labels.propagation.rules import DEFAULT, WalkerRules
from rm3d_plugin.pseudo_labels.propagation.solve import CoarseGraph, Pull, at_points, coarse_graphs, solve

POWERS = (0.2, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0)  # inverse temperatures that are tried
STRENGTHS = (0.003, 0.01, 0.03, 0.1, 0.3)  # pulls that are tried, as shares of the usual degree of a point
LEAST = 1e-6


class NetworkSay(NamedTuple):
    """How a network enters an answer.

    Attributes:
        weight: Pull, as a share of the usual degree of a point; 0: no say.
        power: Inverse temperature by which its probabilities are right as often as they say.
        labels: That judged it.
    """

    weight: float
    power: float
    labels: int


SILENT = NetworkSay(0.0, 1.0, 0)


def judge_network(
    scene: PreparedCloud,
    labels: Labels,
    network: Float[np.ndarray, 'points present'],
    unseen: Bool[np.ndarray, ' points'],
    rules: WalkerRules,
) -> NetworkSay:
    """Leave all labels out that the network was not taught, and compare the answer with it to the one without.

    Args:
        scene: The scan.
        labels: Of its points.
        network: Probabilities of the classes that are asked for; rows of NaN where it saw nothing.
        unseen: Points that it was not taught.
        rules: The rest.
    """
    asked = unseen[labels.points] & np.isfinite(network[labels.points]).all(axis=1)
    if not asked.any():
        return SILENT
    points, classes, told = labels.points[asked], labels.classes[asked], labels.select(~asked)
    if not len(told.points) and not len(told.others):
        return SILENT
    weight = 1.0 / np.bincount(classes)[classes]
    weight /= weight.sum()
    power = max(POWERS, key=lambda each: _likelihood(_raised(network[points], each), classes, weight))
    graphs = coarse_graphs(scene, labels.points, rules.left_out_nodes)
    own, right = strength_of(DEFAULT, told, rules), {}
    for strength in (0.0, *STRENGTHS):
        pulls = network_pulls(graphs, network, NetworkSay(strength, power, 0))
        said = at_points(graphs, solve(scene, graphs, told, own, rules, pulls))[points]
        right[strength] = (said.argmax(axis=1) == classes).astype(np.float64)
    return NetworkSay(_clearly_ahead(right, weight, rules.network_errors_apart), power, len(points))


def network_pulls(
    graphs: list[CoarseGraph], network: Float[np.ndarray, 'points present'], say: NetworkSay
) -> list[Pull] | None:
    """The pull towards the network at the nodes of each graph; None where it has no say."""
    if not say.weight > 0:
        return None
    seen = np.isfinite(network).all(axis=1)
    raised = _raised(np.where(seen[:, None], network, 1.0), say.power) * seen[:, None]
    means = [graph.mean(raised) for graph in graphs]
    return [
        Pull(say.weight * graph.usual_degree * mean.sum(axis=1), normalised(mean))
        for graph, mean in zip(graphs, means, strict=True)
    ]


def _raised(shares: Float[np.ndarray, 'rows classes'], power: float) -> Float[np.ndarray, 'rows classes']:
    return normalised(np.maximum(shares, LEAST).astype(np.float64) ** power)


def _likelihood(shares: np.ndarray, classes: np.ndarray, weight: np.ndarray) -> float:
    return float(weight @ np.log(shares[np.arange(len(classes)), classes]))


def _clearly_ahead(right: dict[float, np.ndarray], weight: np.ndarray, errors_apart: float) -> float:
    """The strength with the most right, if it is ahead of none by so many standard errors, else 0."""
    best, lead = 0.0, 0.0
    for strength, each in right.items():
        ahead = float(weight @ (each - right[0.0]))
        error = float(np.sqrt(np.square(weight * (each - right[0.0])).sum()))
        if ahead > max(lead, errors_apart * error):
            best, lead = strength, ahead
    return best
