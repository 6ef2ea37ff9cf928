"""From few labels to a label of every point of a scan.

Nearest points form a graph whose edges are as strong as their ends are alike. Labels spread over it as a random walker
would find them (Grady 2006), pulled towards what their features say; how frequent classes are is read off the answer.
Labels that are left out tell whether another candidate is better, and how good the answer is.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.common.kernel_classifier import normalised
from rm3d_plugin.pseudo_labels.propagation.choose import Choice, choose
from rm3d_plugin.pseudo_labels.propagation.estimate import Estimate, calibrated, estimate_miou
from rm3d_plugin.pseudo_labels.propagation.left_out import LeftOut, leave_labels_out, strength_of
from rm3d_plugin.pseudo_labels.propagation.nearest import nearest_label, nearest_label_in_place_and_colour
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud, prepare_cloud
from rm3d_plugin.pseudo_labels.propagation.relax import relax
from rm3d_plugin.pseudo_labels.propagation.rules import CANDIDATES, DEFAULT, Candidate, WalkerRules
from rm3d_plugin.pseudo_labels.propagation.solve import coarse_scene, solve
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
    """

    semantic: Int[np.ndarray, ' points']
    confidence: Float[np.ndarray, ' points']
    probabilities: Float[np.ndarray, 'points classes']
    choice: Choice
    estimate: Estimate | None
    remark: str


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
) -> Propagation:
    """:func:`propagate` on a scan whose graph and features are there already: when labels are added one by one."""
    _check(len(scene.cloud), annotated, num_classes)
    rules = rules or WalkerRules()
    labelled = np.flatnonzero(annotated >= 0)
    if not len(labelled):
        return _nothing(len(annotated), num_classes)
    present, classes = np.unique(annotated[labelled], return_inverse=True)
    left = leave_labels_out(scene, labelled, classes, len(present), _candidates(scene.cloud, len(present)), rules)
    choice = Choice(DEFAULT, {}) if left is None else choose(left.shares, classes[left.rows], rules.errors_apart)
    shares = _answer(scene, labelled, classes, len(present), choice.candidate, rules)
    estimate = None if left is None else _estimate(shares, annotated < 0, left, classes, choice.candidate, rules)
    if estimate is not None:
        shares = calibrated(shares, estimate.sharpness)
    return _named(shares, annotated, present, num_classes, choice, estimate)


def _check(points: int, annotated: np.ndarray, num_classes: int) -> None:
    if annotated.shape != (points,):
        raise ValueError(f'propagate: annotated: expected one class a point ({points},), got shape {annotated.shape}')
    if points and int(annotated.max()) >= num_classes:
        raise ValueError(f'propagate: annotated: expected classes below {num_classes}, got {int(annotated.max())}')


def _nothing(points: int, num_classes: int) -> Propagation:
    zeros = np.zeros((points, num_classes), dtype=np.float32)
    semantic = np.full(points, UNLABELLED, dtype=np.int64)
    return Propagation(semantic, zeros.sum(axis=1), zeros, Choice(DEFAULT, {}), None, 'no point is labelled')


def _candidates(cloud: PointCloud, count: int) -> list[Candidate]:
    """All that apply: one class needs no choice, and without colours two are the same."""
    if count < 2:
        return [DEFAULT]
    return [name for name in CANDIDATES if name != 'nearest in place and colour' or cloud.colors is not None]


def _answer(
    scene: PreparedCloud,
    labelled: Int[np.ndarray, ' labelled'],
    classes: Int[np.ndarray, ' labelled'],
    count: int,
    candidate: Candidate,
    rules: WalkerRules,
) -> Float[np.ndarray, 'points present']:
    """Shares of the classes that are there at every point; rows of sum 1, as given at labelled points."""
    near = (
        nearest_label_in_place_and_colour(scene.cloud, labelled, classes)
        if candidate == 'nearest in place and colour'
        else nearest_label(scene.cloud.xyz, labelled, classes)
    )
    shares = np.eye(count, dtype=np.float32)[near]
    if candidate.startswith('nearest'):
        shares[labelled] = np.eye(count, dtype=np.float32)[classes]
        return shares
    coarse = coarse_scene(scene, labelled, rules.nodes)
    node = coarse.coarse.node
    strength = strength_of(candidate, classes, rules)
    solution = solve(coarse, node[labelled], classes, count, strength, rules)
    fixed = np.zeros(len(node), dtype=np.bool_)
    fixed[labelled] = True
    walked = relax(scene.graph, solution.shares[node], solution.prior[node], solution.strength, fixed, rules.sweeps)
    reached = walked.sum(axis=1) > 1e-6  # what no labelled point is joined to takes the nearest
    shares[reached] = normalised(walked[reached])
    return shares


def _estimate(
    shares: Float[np.ndarray, 'points present'],
    hidden: np.ndarray,
    left: LeftOut,
    classes: Int[np.ndarray, ' labelled'],
    candidate: Candidate,
    rules: WalkerRules,
) -> Estimate | None:
    generator = np.random.default_rng(rules.seed + 1)
    return estimate_miou(shares[hidden], left.shares[candidate], classes[left.rows], rules.draws, generator)


def _named(
    shares: Float[np.ndarray, 'points present'],
    annotated: Int[np.ndarray, ' points'],
    present: Int[np.ndarray, ' present'],
    num_classes: int,
    choice: Choice,
    estimate: Estimate | None,
) -> Propagation:
    probabilities = np.zeros((len(annotated), num_classes), dtype=np.float32)
    probabilities[:, present] = shares
    known = annotated >= 0
    probabilities[known] = np.eye(num_classes, dtype=np.float32)[annotated[known]]
    semantic = present[shares.argmax(axis=1)].astype(np.int64)
    semantic[known] = annotated[known]
    remark = _remark(choice, estimate, int(known.sum()))
    return Propagation(semantic, probabilities.max(axis=1), probabilities, choice, estimate, remark)


def _remark(choice: Choice, estimate: Estimate | None, labels: int) -> str:
    if estimate is None:
        return f'{choice.candidate} (the default): {labels} labels are too few to leave some out, no estimate'
    return f'{choice.candidate}: {estimate.text()}, from {labels} labels'
