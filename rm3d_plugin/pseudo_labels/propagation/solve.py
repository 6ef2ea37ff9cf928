"""One answer from given labels on the coarse graph."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.common.kernel_classifier import Scaling, normalised, scaling_of
from rm3d_plugin.pseudo_labels.propagation.coarsening import Coarsening, coarsen, node_means
from rm3d_plugin.pseudo_labels.propagation.feature_prior import feature_prior
from rm3d_plugin.pseudo_labels.propagation.harmonic import HarmonicSystem
from rm3d_plugin.pseudo_labels.propagation.labels import Labels
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


class Pull(NamedTuple):
    """What nodes are drawn to beside their neighbours.

    Attributes:
        strength: (M,) at a point of each node, in the unit of the weights.
        prior: (M, C) rows of sum 1.
    """

    strength: Float[np.ndarray, ' nodes']
    prior: Float[np.ndarray, 'nodes classes']

    def __add__(self, other: 'Pull') -> 'Pull':  # type: ignore[override]
        """Both at once."""
        strength = self.strength + other.strength
        both = self.strength[:, None] * self.prior + other.strength[:, None] * other.prior
        return Pull(strength, np.where(strength[:, None] > 0, normalised(both), self.prior))


class Solution(NamedTuple):
    """An answer.

    Attributes:
        shares: (M, C) rows of sum 1; zeros where nothing is known.
        pull: That was part of it.
    """

    shares: Float[np.ndarray, 'nodes classes']
    pull: Pull


def coarse_scene(scene: PreparedCloud, labelled: Int[np.ndarray, ' labelled'], nodes: int) -> CoarseScene:
    """Coarsen a scan, its labelled points kept as nodes of their own."""
    coarse = coarsen(scene.graph, labelled, nodes)
    features = node_means(scene.features, coarse)
    return CoarseScene(coarse, features, scaling_of(features), float(np.median(scene.graph.degree)))


def solve(
    scene: CoarseScene, labels: Labels, strength: float, rules: WalkerRules, network: Pull | None = None
) -> Solution:
    """Random walker with features as its prior, and frequencies read off its own answer.

    Args:
        scene: Coarse.
        labels: At least one.
        strength: Of the features, as a share of the usual degree of a point; 0: the random walker alone.
        rules: The rest.
        network: A further pull, or None.
    """
    sizes, count = scene.coarse.sizes, labels.num_classes
    even = np.full((len(sizes), count), 1.0 / count)
    own = Pull(np.full(len(sizes), strength * scene.usual_degree), even)
    pull = own if network is None else own + network
    system = HarmonicSystem(scene.coarse.weights, labels.nodes, pull.strength * sizes)
    given = np.eye(count)[labels.classes]
    if not strength > 0:
        return Solution(normalised(np.maximum(system.shares(given, pull.prior), 0.0)), pull)
    likely = feature_prior(scene.features, scene.scaling, labels, rules.examples)
    counts, factors = np.bincount(labels.classes, minlength=count), np.ones(count)
    for _ in range(1 + (rules.prior_rounds if counts.max(initial=0) > 1 else 0)):
        now = own._replace(prior=normalised(likely * factors))
        pull = now if network is None else now + network
        shares = system.shares(given, pull.prior)
        factors = prior_shift(shares.argmax(axis=1), sizes, np.maximum(counts, 1), rules.prior_half)
    return Solution(normalised(np.maximum(shares, 0.0)), pull)
