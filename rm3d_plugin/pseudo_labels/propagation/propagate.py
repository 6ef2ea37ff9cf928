"""From few labels to a label of every point of a scan.

Nearest points form a graph whose edges are as strong as their ends are alike. Labels spread over it as a random walker
would find them (Grady 2006), pulled towards what their features say; how frequent classes are is read off the answer.
Two graphs, whose edges are weighed in two ways, give the mean of their answers. Where labels are few, what the
answer is sure of teaches what classes look like.
Labels that are left out tell whether another candidate is better, and how good the answer is.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.common.kernel_classifier import normalised
from rm3d_plugin.pseudo_labels.propagation.beside import Beside
from rm3d_plugin.pseudo_labels.propagation.choose import Choice, choose
from rm3d_plugin.pseudo_labels.propagation.estimate import Estimate, calibrated, estimate_miou
from rm3d_plugin.pseudo_labels.propagation.labels import Labels
from rm3d_plugin.pseudo_labels.propagation.left_out import LeftOut, leave_labels_out, strength_of
from rm3d_plugin.pseudo_labels.propagation.nearest import nearest_label, nearest_label_in_place_and_colour
from rm3d_plugin.pseudo_labels.propagation.network import judge_network, trial_of, with_network
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud, prepare_cloud
from rm3d_plugin.pseudo_labels.propagation.relax import relax
from rm3d_plugin.pseudo_labels.propagation.rules import CANDIDATES, DEFAULT, SILENT, Candidate, NetworkSay, WalkerRules
from rm3d_plugin.pseudo_labels.propagation.solve import CoarseGraph, Pull, Solution, coarse_graphs, solve
from rm3d_plugin.structures import UNLABELLED, PointCloud


class Propagation(NamedTuple):
    """Labels of a scan.

    Attributes:
        semantic: (N,) int64 class; -1 everywhere where nothing was labelled.
        confidence: (N,) float32 share of that class, by labels that were left out where there are enough; labelled
            points have 1.
        probabilities: (N, C) float32 rows of sum 1; zeros where nothing was labelled.
        choice: Which candidate was taken, and how each did on labels that were left out.
        estimate: Of the mean IoU on the points without a label, or None where too few labels can be left out.
        remark: A line for the log: what was taken and why.
        network_weight: Power of the network that was given; 0: no say.
    """

    semantic: Int[np.ndarray, ' points']
    confidence: Float[np.ndarray, ' points']
    probabilities: Float[np.ndarray, 'points classes']
    choice: Choice
    estimate: Estimate | None
    remark: str
    network_weight: float = 0.0


def propagate(
    cloud: PointCloud,
    annotated: Int[np.ndarray, ' points'],
    num_classes: int,
    rules: WalkerRules | None = None,
) -> Propagation:
    """Label every point of a scan from the few that are labelled.

    Classes without a labelled point are not named. A labelled point keeps its label.

    Args:
        cloud: N points, metres, z up.
        annotated: Class of each, -1 = unknown.
        num_classes: Number of classes.
        rules: None: the defaults.

    Raises:
        ValueError: ``annotated`` has another length, or a class that there is not.
    """
    _check(len(cloud), annotated, num_classes)
    return propagate_prepared(prepare_cloud(cloud), annotated, num_classes, rules)


def propagate_prepared(
    scene: PreparedCloud,
    annotated: Int[np.ndarray, ' points'],
    num_classes: int,
    rules: WalkerRules | None = None,
    beside: Beside | None = None,
) -> Propagation:
    """:func:`propagate` on a scan whose graph and features are there already, with what is known beside its labels.

    Args:
        scene: The scan.
        annotated: Class of each point, -1 = unknown.
        num_classes: Number of classes.
        rules: None: the defaults.
        beside: None: nothing.

    Raises:
        ValueError: ``annotated`` or ``beside`` does not fit the scan.
    """
    _check(len(scene.cloud), annotated, num_classes)
    rules, beside = rules or WalkerRules(), beside or Beside()
    beside.check(scene, num_classes)
    present, labels = labels_of(scene, annotated, num_classes, beside)
    if not len(labels.points) and not len(labels.others):
        return _nothing(len(annotated), num_classes)
    candidates = _candidates(scene.cloud, labels)
    left = leave_labels_out(scene, labels, candidates, rules) if beside.sharpness is None else None
    choice = Choice(DEFAULT, {}) if left is None else choose(left.shares, labels.classes[left.rows], rules.errors_apart)
    network = None if beside.network is None else beside.network[:, present]
    say = SILENT if network is None or beside.say is None else beside.say
    if network is not None and beside.say is None and beside.unseen is not None:
        trial = trial_of(scene, labels, network, beside.unseen)
        say = SILENT if trial is None else judge_network([trial], rules)
    if say.weight:
        choice = choice._replace(candidate=DEFAULT)
    shares = _answer(scene, labels, choice.candidate, rules)
    if network is not None and say.weight:
        shares = with_network(shares, network, say)
    estimate = None if left is None else _estimate(shares, annotated < 0, left, labels, choice.candidate, rules)
    sharpness = beside.sharpness if estimate is None else estimate.sharpness
    if sharpness is not None:
        shares = calibrated(shares, sharpness)
    return _named(shares, annotated, present, num_classes, choice, estimate, say)


def labels_of(
    scene: PreparedCloud, annotated: Int[np.ndarray, ' points'], num_classes: int, beside: Beside
) -> tuple[Int[np.ndarray, ' present'], Labels]:
    """Classes that are labelled or possible, and the labels in terms of these."""
    nodes, there = np.flatnonzero(annotated >= 0), np.zeros(num_classes, dtype=np.bool_)
    there[annotated[nodes]] = True
    if beside.possible is not None:
        there |= beside.possible
    others = scene.features[:0] if beside.features is None else beside.features
    other_classes = np.zeros(0, np.int64) if beside.classes is None else beside.classes
    kept = there[other_classes]
    number, count = np.cumsum(there) - 1, int(there.sum())
    own = number[other_classes[kept]]
    return np.flatnonzero(there), Labels.of(scene, nodes, number[annotated[nodes]], count, others[kept], own)


def _check(points: int, annotated: np.ndarray, num_classes: int) -> None:
    if annotated.shape != (points,):
        raise ValueError(f'propagate: annotated: expected one class a point ({points},), got shape {annotated.shape}')
    if points and int(annotated.max()) >= num_classes:
        raise ValueError(f'propagate: annotated: expected classes below {num_classes}, got {int(annotated.max())}')


def _nothing(points: int, num_classes: int) -> Propagation:
    zeros = np.zeros((points, num_classes), dtype=np.float32)
    semantic = np.full(points, UNLABELLED, dtype=np.int64)
    return Propagation(semantic, zeros.sum(axis=1), zeros, Choice(DEFAULT, {}), None, 'no point is labelled')


def _candidates(cloud: PointCloud, labels: Labels) -> list[Candidate]:
    """All that apply: one class needs no choice, and without colours two are the same."""
    if labels.num_classes < 2 or not len(labels.points):
        return [DEFAULT]
    return [name for name in CANDIDATES if name != 'nearest in place and colour' or cloud.colors is not None]


def _answer(
    scene: PreparedCloud,
    labels: Labels,
    candidate: Candidate,
    rules: WalkerRules,
) -> Float[np.ndarray, 'points present']:
    """Shares of the classes that are there at every point; rows of sum 1, as given at labelled points."""
    shares, given = (
        np.full((len(scene.cloud), labels.num_classes), 1.0 / labels.num_classes, np.float32),
        np.eye(labels.num_classes),
    )
    if len(labels.points):
        near = (
            nearest_label_in_place_and_colour(scene.cloud, labels.points, labels.classes)
            if candidate == 'nearest in place and colour'
            else nearest_label(scene.cloud.xyz, labels.points, labels.classes)
        )
        shares = given[near].astype(np.float32)
    if candidate.startswith('nearest'):
        shares[labels.points] = given[labels.classes]
        return shares
    graphs = coarse_graphs(scene, labels.points, rules.nodes)
    found = solve(scene, graphs, labels, strength_of(candidate, labels, rules), rules)
    walked = _refined(scene, graphs, found, labels, rules)
    reached = walked.sum(axis=1) > 1e-6  # what no labelled point is joined to takes the nearest
    shares[reached] = normalised(walked[reached])
    return shares


def _refined(
    scene: PreparedCloud, graphs: list[CoarseGraph], found: list[Solution], labels: Labels, rules: WalkerRules
) -> Float[np.ndarray, 'points present']:
    """Mean of the answers on all graphs, each relaxed at the points; float32."""
    fixed = np.zeros(len(scene.cloud), dtype=np.bool_)
    fixed[labels.points] = True
    total = np.zeros((len(fixed), labels.num_classes), dtype=np.float32)
    for points, graph, each in zip(scene.graphs, graphs, found, strict=True):
        node = graph.coarse.node
        pull = Pull(each.pull.strength[node], each.pull.prior.astype(np.float32)[node])
        total += relax(points, each.shares.astype(np.float32)[node], pull.prior, pull.strength, fixed, rules.steps)
    return total / np.float32(len(graphs))


def _estimate(
    shares: Float[np.ndarray, 'points present'],
    hidden: np.ndarray,
    left: LeftOut,
    labels: Labels,
    candidate: Candidate,
    rules: WalkerRules,
) -> Estimate | None:
    generator = np.random.default_rng(rules.seed + 1)
    return estimate_miou(shares[hidden], left.shares[candidate], labels.classes[left.rows], rules.draws, generator)


def _named(
    shares: Float[np.ndarray, 'points present'],
    annotated: Int[np.ndarray, ' points'],
    present: Int[np.ndarray, ' present'],
    num_classes: int,
    choice: Choice,
    estimate: Estimate | None,
    say: NetworkSay,
) -> Propagation:
    probabilities = np.zeros((len(annotated), num_classes), dtype=np.float32)
    probabilities[:, present] = shares
    known = annotated >= 0
    probabilities[known] = np.eye(num_classes, dtype=np.float32)[annotated[known]]
    semantic = present[shares.argmax(axis=1)].astype(np.int64)
    semantic[known] = annotated[known]
    remark = _remark(choice, estimate, int(known.sum()), say)
    return Propagation(semantic, probabilities.max(axis=1), probabilities, choice, estimate, remark, say.weight)


def _remark(choice: Choice, estimate: Estimate | None, labels: int, say: NetworkSay) -> str:
    heard = (
        '' if not say.labels else f'; network: weight {say.weight:.2g}, by {say.labels} labels that it was not taught'
    )
    if estimate is None:
        few = f'{labels} labels are in too few places to leave some out'
        return f'{choice.candidate} (the default): {few}, no estimate{heard}'
    return f'{choice.candidate}: {estimate.text()}, from {labels} labels{heard}'
