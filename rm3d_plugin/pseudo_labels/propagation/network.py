"""What a network says of a scan, and whether labels that it was not taught let it speak."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.pseudo_labels.common.kernel_classifier import normalised
from rm3d_plugin.pseudo_labels.propagation.coarsening import Coarsening
from rm3d_plugin.pseudo_labels.propagation.labels import Labels
from rm3d_plugin.pseudo_labels.propagation.left_out import strength_of
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud
from rm3d_plugin.pseudo_labels.propagation.rules import DEFAULT, WalkerRules
from rm3d_plugin.pseudo_labels.propagation.solve import CoarseScene, Pull, coarse_scene, solve

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
    asked = judges(labels, network, unseen)
    if not asked.any():
        return SILENT
    classes = labels.classes[asked]
    power = network_power(network[labels.nodes[asked]], classes)
    right = try_network(scene, labels, network, asked, power, rules)
    return NetworkSay(network_weight(right, classes, rules.network_errors_apart), power, len(classes))


def judges(
    labels: Labels, network: Float[np.ndarray, 'points present'], unseen: Bool[np.ndarray, ' points']
) -> Bool[np.ndarray, ' labelled']:
    """The labels that judge a network: it was not taught them, it saw their points, and others are left."""
    asked = unseen[labels.nodes] & np.isfinite(network[labels.nodes]).all(axis=1)
    return asked if len(labels.others) or not asked.all() else np.zeros_like(asked)


def network_power(said: Float[np.ndarray, 'judges classes'], classes: Int[np.ndarray, ' judges']) -> float:
    """The inverse temperature by which a network is right as often as it says, all classes counting alike.

    Args:
        said: Its probabilities at labels that it was not taught, at least one.
        classes: Of these.
    """
    weight = _alike(classes)
    return max(POWERS, key=lambda each: _likelihood(_raised(said, each), classes, weight))


def try_network(
    scene: PreparedCloud,
    labels: Labels,
    network: Float[np.ndarray, 'points present'],
    asked: Bool[np.ndarray, ' labelled'],
    power: float,
    rules: WalkerRules,
) -> Bool[np.ndarray, 'strengths judges']:
    """Whether labels that are left out come out right, without the network and with each of :data:`STRENGTHS`.

    Args:
        scene: The scan.
        labels: Of its points.
        network: Probabilities of the classes that are asked for; rows of NaN where it saw nothing.
        asked: Of :func:`judges`, at least one.
        power: Of :func:`network_power`.
        rules: The rest.
    """
    told, points, classes = labels.select(~asked), labels.nodes[asked], labels.classes[asked]
    coarse = coarse_scene(scene, labels.nodes, rules.left_out_nodes)
    node, own = coarse.coarse.node, strength_of(DEFAULT, told.classes, rules)
    right = []
    for strength in (0.0, *STRENGTHS):
        pull = network_pull(coarse, network, NetworkSay(strength, power, 0))
        said = solve(coarse, told.at(node), own, rules, pull).shares[node[points]]
        right.append(said.argmax(axis=1) == classes)
    return np.stack(right)


def network_weight(
    right: Bool[np.ndarray, 'strengths judges'], classes: Int[np.ndarray, ' judges'], errors_apart: float
) -> float:
    """The strength with the most labels right where it is ahead of none by so many standard errors, else 0.

    Args:
        right: Of :func:`try_network`, of one scan or joined over scans.
        classes: Of the labels; all classes count alike.
        errors_apart: Larger: the network speaks less often.
    """
    weight, gained = _alike(classes), right.astype(np.float64) - right[0]
    ahead = gained @ weight
    sure = ahead > errors_apart * np.sqrt(np.square(weight * gained).sum(axis=1))
    return float((0.0, *STRENGTHS)[int(np.where(sure, ahead, 0.0).argmax())])


def network_pull(coarse: CoarseScene, network: Float[np.ndarray, 'points present'], say: NetworkSay) -> Pull | None:
    """The pull towards the network at each node; None where it has no say."""
    if not say.weight > 0:
        return None
    seen = np.isfinite(network).all(axis=1)
    raised = _raised(np.where(seen[:, None], network, 1.0), say.power) * seen[:, None]
    mean = _sums(raised, coarse.coarse) / coarse.coarse.sizes[:, None]
    return Pull(say.weight * coarse.usual_degree * mean.sum(axis=1), normalised(mean))


def _sums(values: Float[np.ndarray, 'points columns'], coarse: Coarsening) -> Float[np.ndarray, 'nodes columns']:
    return np.stack([np.bincount(coarse.node, column, len(coarse.sizes)) for column in values.T], axis=1)


def _raised(shares: Float[np.ndarray, 'rows classes'], power: float) -> Float[np.ndarray, 'rows classes']:
    return normalised(np.maximum(shares, LEAST).astype(np.float64) ** power)


def _alike(classes: Int[np.ndarray, ' labels']) -> Float[np.ndarray, ' labels']:
    weight = 1.0 / np.bincount(classes)[classes]
    return np.asarray(weight / weight.sum())


def _likelihood(shares: np.ndarray, classes: np.ndarray, weight: np.ndarray) -> float:
    return float(weight @ np.log(shares[np.arange(len(classes)), classes]))
