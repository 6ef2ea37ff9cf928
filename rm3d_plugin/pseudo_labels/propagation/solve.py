"""One answer from given labels on the coarse graph."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.common.kernel_classifier import Scaling, normalised, scaling_of
from rm3d_plugin.pseudo_labels.propagation.coarsening import Coarsening, coarsen, node_means
from rm3d_plugin.pseudo_labels.propagation.feature_prior import feature_prior
from rm3d_plugin.pseudo_labels.propagation.harmonic import HarmonicSystem
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud
from rm3d_plugin.pseudo_labels.propagation.prior_shift import prior_shift
from rm3d_plugin.pseudo_labels.propagation.rules import WalkerRules


class CoarseScene(NamedTuple):
    """Nodes that stand for points, what they look like, and how strong the edges of a point usually are.

    Attributes:
        coarse: Nodes and their edges.
        features: (M, F) means of the points.
        scaling: Of the features.
        usual_degree: Median sum of the weights of a point.
    """

    coarse: Coarsening
    features: Float[np.ndarray, 'nodes features']
    scaling: Scaling
    usual_degree: float


class Solution(NamedTuple):
    """An answer.

    Attributes:
        shares: (M, C) rows of sum 1; zeros where nothing is known.
        prior: (M, C) what the features say, with frequencies.
        strength: Pull of the prior at a point, in the unit of the weights.
    """

    shares: Float[np.ndarray, 'nodes classes']
    prior: Float[np.ndarray, 'nodes classes']
    strength: float


def coarse_scene(scene: PreparedCloud, labelled: Int[np.ndarray, ' labelled'], nodes: int) -> CoarseScene:
    """Coarsen a scan, its labelled points kept as nodes of their own."""
    coarse = coarsen(scene.graph, labelled, nodes)
    features = node_means(scene.features, coarse)
    return CoarseScene(coarse, features, scaling_of(features), float(np.median(scene.graph.degree)))


def solve(
    scene: CoarseScene,
    labelled: Int[np.ndarray, ' labelled'],
    classes: Int[np.ndarray, ' labelled'],
    count: int,
    strength: float,
    rules: WalkerRules,
) -> Solution:
    """Random walker with features as its prior, and frequencies read off its own answer.

    Args:
        scene: Coarse.
        labelled: Nodes with a label, at least one, each once.
        classes: Of each, from 0 to ``count`` - 1, each of them there.
        count: Number of classes.
        strength: Of the features, as a share of the usual degree of a point; 0: the random walker alone.
        rules: The rest.
    """
    sizes, pull = scene.coarse.sizes, strength * scene.usual_degree
    system = HarmonicSystem(scene.coarse.weights, labelled, pull * sizes)
    given = np.eye(count)[classes]
    if not strength > 0:
        even = np.full((len(sizes), count), 1.0 / count)
        return Solution(normalised(np.maximum(system.shares(given, even), 0.0)), even, 0.0)
    likely = feature_prior(scene.features, scene.scaling, labelled, classes, count, rules.examples)
    counts, prior = np.bincount(classes, minlength=count), likely
    shares = system.shares(given, prior)
    for _ in range(rules.prior_rounds if counts.max(initial=0) > 1 else 0):
        factors = prior_shift(shares.argmax(axis=1), sizes, np.maximum(counts, 1), rules.prior_half)
        prior = normalised(likely * factors)
        shares = system.shares(given, prior)
    return Solution(normalised(np.maximum(shares, 0.0)), prior, pull)
