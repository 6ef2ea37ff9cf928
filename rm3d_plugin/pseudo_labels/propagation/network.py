"""What a network says of a scan, and whether labels that it was not taught let it speak."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.pseudo_labels.common.kernel_classifier import normalised
from rm3d_plugin.pseudo_labels.propagation.estimate import HELD, power_as_claimed
from rm3d_plugin.pseudo_labels.propagation.labels import Labels, one_of_each
from rm3d_plugin.pseudo_labels.propagation.left_out import strength_of
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud
from rm3d_plugin.pseudo_labels.propagation.rules import DEFAULT, SILENT, NetworkSay, WalkerRules
from rm3d_plugin.pseudo_labels.propagation.solve import CoarseGraph, Pull, at_points, coarse_graphs, features_say, walks

POWERS = (0.2, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0)  # inverse temperatures that are tried
PULLS = (0.0, 0.01, 0.05, 0.25)  # that are tried, as shares of the usual degree of a point; without the network first
MOST_SHARPER = 4.0  # power that an answer with the network gets beside that of one without
LEAST = 1e-6


class Trial(NamedTuple):
    """A scan with labels that its network was not taught.

    Attributes:
        scene: The scan.
        labels: Of its points.
        network: (N, present) probabilities of the classes that are asked for; rows of NaN where it saw nothing.
        hidden: (L,) which of the labels it was not taught.
        judges: (L,) those of them that it is asked about: one of each place of which it was taught nothing, at a point
            that it saw.
    """

    scene: PreparedCloud
    labels: Labels
    network: Float[np.ndarray, 'points present']
    hidden: Bool[np.ndarray, ' labelled']
    judges: Bool[np.ndarray, ' labelled']

    @property
    def classes(self) -> Int[np.ndarray, ' judges']:
        """Of the labels that judge."""
        return self.labels.classes[self.judges]

    @property
    def said(self) -> Float[np.ndarray, 'judges present']:
        """What the network says of them."""
        return self.network[self.labels.points[self.judges]]


def trial_of(
    scene: PreparedCloud,
    labels: Labels,
    network: Float[np.ndarray, 'points present'],
    unseen: Bool[np.ndarray, ' points'],
) -> Trial | None:
    """A trial of a network; None where no label can judge it, or none is left to compare with.

    Args:
        scene: The scan.
        labels: Of its points.
        network: See :class:`Trial`.
        unseen: Points that it was not taught.
    """
    hidden = unseen[labels.points]
    asked = np.isfinite(network[labels.points]).all(axis=1)
    rows = np.flatnonzero(asked & ~np.isin(labels.places, labels.places[~hidden]))
    judges = np.zeros_like(hidden)
    judges[rows[one_of_each(labels.places[rows], seed=0)]] = True
    left = len(labels.others) or not hidden.all()
    return Trial(scene, labels, network, hidden, judges) if len(rows) and left else None


def judge_network(trials: Sequence[Trial], rules: WalkerRules) -> NetworkSay:
    """Leave the labels out that the network was not taught, and compare the answer with it to the one without.

    Args:
        trials: Of one scan or more, all with the same classes.
        rules: Of the walk.
    """
    if not trials:
        return SILENT
    classes = np.concatenate([trial.classes for trial in trials])
    power = network_power(np.concatenate([trial.said for trial in trials]), classes)
    tried = [try_network(trial, power, rules) for trial in trials]
    shares = np.concatenate([each.shares for each in tried], axis=1)
    found = np.sum([each.found for each in tried], axis=0)
    best = best_strength(shares.argmax(axis=2) == classes, classes, rules.network_errors_apart)
    return NetworkSay(PULLS[best], power, len(classes), _sharper(shares[[0, best]], classes, found[[0, best]]))


def _sharper(
    shares: Float[np.ndarray, 'two judges present'],
    classes: Int[np.ndarray, ' judges'],
    found: Float[np.ndarray, 'two present'],
) -> float:
    """See :attr:`NetworkSay.sharper`; few labels that judge change little, and four times is the most."""
    before, after = (power_as_claimed(each, classes, points) for each, points in zip(shares, found, strict=True))
    trust = len(classes) / (len(classes) + HELD)
    return float(np.clip((after / before) ** trust, 1 / MOST_SHARPER, MOST_SHARPER))


def network_power(said: Float[np.ndarray, 'judges classes'], classes: Int[np.ndarray, ' judges']) -> float:
    """The inverse temperature by which a network is right as often as it says, all classes counting alike.

    Args:
        said: Its probabilities at labels that it was not taught, at least one.
        classes: Of these.
    """
    weight = _alike(classes)
    return max(POWERS, key=lambda each: _likelihood(_raised(said, each), classes, weight))


class Tried(NamedTuple):
    """Answers without the network and with each pull of :data:`PULLS`.

    Attributes:
        shares: (S, J, present) of labels that were left out; rows of sum 1.
        found: (S, present) points of each class.
    """

    shares: Float[np.ndarray, 'pulls judges present']
    found: Float[np.ndarray, 'pulls present']


def try_network(trial: Trial, power: float, rules: WalkerRules) -> Tried:
    """Leave the labels out that judge, and answer with each of :data:`PULLS`.

    Args:
        trial: Of a scan.
        power: Of :func:`network_power`.
        rules: Of the walk.
    """
    scene, labels, network, hidden, judges = trial
    told, points = labels.select(~hidden), labels.points[judges]
    graphs = coarse_graphs(scene, labels.points, rules.left_out_nodes)
    own, shares, found = strength_of(DEFAULT, told, rules), [], []
    likely = features_say(scene, graphs, told, own, rules)
    for strength in PULLS:
        pulls = network_pulls(graphs, network, NetworkSay(strength, power, 0))
        said = at_points(graphs, walks(graphs, told, likely, own, rules, pulls))
        shares.append(said[points].astype(np.float64))
        found.append(np.bincount(said.argmax(axis=1), minlength=said.shape[1]).astype(np.float64))
    return Tried(np.stack(shares), np.stack(found))


def best_strength(
    right: Bool[np.ndarray, 'pulls judges'], classes: Int[np.ndarray, ' judges'], errors_apart: float
) -> int:
    """Number of the pull with the most labels right where it is ahead of none by so many standard errors, else 0.

    Args:
        right: Whether labels that were left out came out right, with each of :data:`PULLS`.
        classes: Of the labels; all classes count alike.
        errors_apart: Larger: the network speaks less often.
    """
    weight, gained = _alike(classes), right.astype(np.float64) - right[0]
    ahead = gained @ weight
    sure = ahead > errors_apart * np.sqrt(np.square(weight * gained).sum(axis=1))
    return int(np.where(sure, ahead, 0.0).argmax())


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


def _alike(classes: Int[np.ndarray, ' labels']) -> Float[np.ndarray, ' labels']:
    weight = 1.0 / np.bincount(classes)[classes]
    return np.asarray(weight / weight.sum())


def _likelihood(shares: np.ndarray, classes: np.ndarray, weight: np.ndarray) -> float:
    return float(weight @ np.log(shares[np.arange(len(classes)), classes]))
