"""What a network says of a scan, and whether labels that it was not taught let it speak.

The walk sees what lies beside a label, the network what looks alike anywhere. They err in different places, so that
both are heard as witnesses of their own: powers of their probabilities are multiplied (logarithmic opinion pool, Genest
and Zidek 1986). The powers are those by which labels that neither was told are likeliest.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import minimize
from scipy.special import log_softmax

from rm3d_plugin.pseudo_labels.common.kernel_classifier import normalised
from rm3d_plugin.pseudo_labels.propagation.estimate import USUAL, label_weights
from rm3d_plugin.pseudo_labels.propagation.labels import Labels, one_of_each
from rm3d_plugin.pseudo_labels.propagation.left_out import strength_of
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud
from rm3d_plugin.pseudo_labels.propagation.rules import DEFAULT, SILENT, NetworkSay, WalkerRules
from rm3d_plugin.pseudo_labels.propagation.solve import at_points, coarse_graphs, solve

LEAST = 1e-3  # share of a class that neither witness goes below: what one rules out the other may still name
PARTS = 5  # into which the labels that judge are divided: each part tries the powers that the others found
LEAST_POWER = 1.0  # of an answer without the network, however little it knows of the labels that judge
COVERED = 0.5  # of the points have a class that a label judges, or a network that names few classes would be heard
BLOCK = 1 << 18  # points that are worked on at once


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


class Walked(NamedTuple):
    """An answer without the network and without the labels that it was not taught.

    Attributes:
        shares: (J, present) of the labels that judge; rows of sum 1.
        found: (present,) points of each class.
    """

    shares: Float[np.ndarray, 'judges present']
    found: Float[np.ndarray, ' present']


def walk_without(trial: Trial, rules: WalkerRules) -> Walked:
    """Leave the labels out that the network was not taught, and ask the walk about those that judge."""
    told = trial.labels.select(~trial.hidden)
    graphs = coarse_graphs(trial.scene, trial.labels.points, rules.left_out_nodes)
    said = at_points(graphs, solve(trial.scene, graphs, told, strength_of(DEFAULT, told, rules), rules))
    found = np.bincount(said.argmax(axis=1), minlength=said.shape[1]).astype(np.float64)
    return Walked(said[trial.labels.points[trial.judges]].astype(np.float64), found)


def judge_network(trials: Sequence[Trial], rules: WalkerRules) -> NetworkSay:
    """Compare the walk with the network to the walk alone, at labels that neither was told.

    Args:
        trials: Of one scan or more, all with the same classes.
        rules: Of the walk.
    """
    if not trials:
        return SILENT
    walked = [walk_without(trial, rules) for trial in trials]
    return weigh_network(
        np.concatenate([each.shares for each in walked]),
        np.concatenate([trial.said for trial in trials]),
        np.concatenate([trial.classes for trial in trials]),
        np.sum([each.found for each in walked], axis=0),
        rules.network_errors_apart,
    )


def weigh_network(
    walked: Float[np.ndarray, 'judges present'],
    said: Float[np.ndarray, 'judges present'],
    classes: Int[np.ndarray, ' judges'],
    found: Float[np.ndarray, ' present'],
    errors_apart: float,
) -> NetworkSay:
    """The powers by which labels are likeliest; no say where they do not come out likelier than by the walk alone.

    Nor has it one where the labels are of one class, or of classes that hold less than half of the points: a network
    that names no others would be right on all of them. Each part of the labels tries the powers that the others found.

    Args:
        walked: What the walk says of labels that it was not told; rows of sum 1.
        said: What the network says of them.
        classes: True ones.
        found: Points of each class in the answers.
        errors_apart: Standard errors by which the mean log likelihood must gain. Larger: the network speaks less often.
    """
    if np.unique(classes).size < 2 or found[np.unique(classes)].sum() < COVERED * found.sum():
        return SILENT._replace(labels=len(classes))
    weight = label_weights(classes, found / found.sum())
    logs = np.stack([_logs(walked), _logs(said)])
    gains = _gains(logs, classes, weight)
    if not gains.sum() > errors_apart * np.sqrt(np.square(gains).sum()):
        return SILENT._replace(labels=len(classes))
    own, network = likeliest_powers(logs, classes, weight).tolist()
    if network <= 0:
        return SILENT._replace(labels=len(classes))
    (alone,) = likeliest_powers(logs[:1], classes, weight).tolist()
    alone = max(alone, LEAST_POWER)
    return NetworkSay(network / alone, own / alone, len(classes))


def _gains(
    logs: Float[np.ndarray, 'witnesses labels classes'],
    classes: Int[np.ndarray, ' labels'],
    weight: Float[np.ndarray, ' labels'],
) -> Float[np.ndarray, ' labels']:
    """How much likelier each label is by all witnesses than by the first alone, with powers that other labels found."""
    part = np.random.default_rng(0).permutation(len(classes)) % PARTS
    gains = np.zeros(len(classes))
    for number in np.unique(part):
        asked = part == number
        said = []
        for witnesses in (logs, logs[:1]):
            powers = likeliest_powers(witnesses[:, ~asked], classes[~asked], weight[~asked])
            said.append(_log_likelihoods(witnesses[:, asked], powers, classes[asked]))
        gains[asked] = weight[asked] * (said[0] - said[1])
    return gains


def likeliest_powers(
    logs: Float[np.ndarray, 'witnesses labels classes'],
    classes: Int[np.ndarray, ' labels'],
    weight: Float[np.ndarray, ' labels'],
) -> Float[np.ndarray, ' witnesses']:
    """Powers of what witnesses say, multiplied, by which the classes are likeliest; none is below 0.

    Beforehand the first has its usual power and the others 0; to be one away must gain as much as one label can tell.

    Args:
        logs: Of probabilities.
        classes: True ones.
        weight: Of the labels.
    """
    before = np.r_[USUAL, np.zeros(len(logs) - 1)]
    true = logs[:, np.arange(len(classes)), classes]

    def loss(powers: np.ndarray) -> tuple[float, np.ndarray]:
        pooled = log_softmax(np.tensordot(powers, logs, axes=1), axis=1)
        expected = (np.exp(pooled) * logs).sum(axis=2)
        likelihood = weight @ pooled[np.arange(len(classes)), classes]
        away = powers - before
        return float(away @ away - likelihood), 2 * away - (true - expected) @ weight

    return np.asarray(minimize(loss, before, jac=True, bounds=[(0, None)] * len(logs)).x)


def _log_likelihoods(logs: np.ndarray, powers: np.ndarray, classes: np.ndarray) -> Float[np.ndarray, ' labels']:
    pooled: np.ndarray = log_softmax(np.tensordot(powers, logs, axes=1), axis=1)
    return pooled[np.arange(len(classes)), classes]


def with_network(
    shares: Float[np.ndarray, 'points present'], network: Float[np.ndarray, 'points present'], say: NetworkSay
) -> Float[np.ndarray, 'points present']:
    """The walk and the network together, about as sure as the walk alone, which stands where the network saw nothing.

    Args:
        shares: Of the walk; rows of sum 1.
        network: Probabilities of the network; rows of NaN where it saw nothing.
        say: How the network enters.
    """
    out = shares.copy()
    for first in range(0, len(shares), BLOCK):
        rows = first + np.flatnonzero(np.isfinite(network[first : first + BLOCK]).all(axis=1))
        logs = say.own * _logs(shares[rows]) + say.weight * _logs(network[rows])
        out[rows] = normalised(np.exp(logs - logs.max(axis=1, keepdims=True)))
    return out


def _logs(shares: Float[np.ndarray, 'rows classes']) -> Float[np.ndarray, 'rows classes']:
    return np.log(normalised(np.maximum(shares, LEAST).astype(np.float64)))
