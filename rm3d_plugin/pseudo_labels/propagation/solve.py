"""One answer from given labels: a random walker over each coarse graph, drawn to what features say."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.ops._parallel import map_blocks
from rm3d_plugin.pseudo_labels.common.kernel_classifier import normalised
from rm3d_plugin.pseudo_labels.propagation.class_shares import class_shares, teaching_counts
from rm3d_plugin.pseudo_labels.propagation.coarsening import Coarsening, coarsen
from rm3d_plugin.pseudo_labels.propagation.harmonic import HarmonicSystem
from rm3d_plugin.pseudo_labels.propagation.labels import Labels
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud
from rm3d_plugin.pseudo_labels.propagation.prior_shift import label_trust, prior_shift
from rm3d_plugin.pseudo_labels.propagation.region_scales import region_means
from rm3d_plugin.pseudo_labels.propagation.rules import WalkerRules

LEAST_TAUGHT = 0.2  # weight of what an answer teaches below which it is not asked


class CoarseGraph(NamedTuple):
    """Nodes that stand for points, and how strong the edges of a point usually are.

    Attributes:
        coarse: Nodes and their edges.
        usual_degree: Median sum of the weights of a point.
    """

    coarse: Coarsening
    usual_degree: float

    def mean(self, values: Float[np.ndarray, 'points columns']) -> Float[np.ndarray, 'nodes columns']:
        """Means of the points of each node."""
        return region_means(values, self.coarse.node, self.coarse.sizes)


class Pull(NamedTuple):
    """What nodes are drawn to beside their neighbours.

    Attributes:
        strength: (M,) at a point of each node, in the unit of the weights.
        prior: (M, C) rows of sum 1.
    """

    strength: Float[np.ndarray, ' nodes']
    prior: Float[np.ndarray, 'nodes classes']


class Solution(NamedTuple):
    """An answer on one graph.

    Attributes:
        shares: (M, C) rows of sum 1; zeros where nothing is known.
        pull: That was part of it.
    """

    shares: Float[np.ndarray, 'nodes classes']
    pull: Pull


def coarse_graphs(scene: PreparedCloud, points: Int[np.ndarray, ' labelled'], nodes: int) -> list[CoarseGraph]:
    """Coarsen the graphs of a scan, some points kept as nodes of their own."""

    def work(first: int, _: int) -> CoarseGraph:
        graph = scene.graphs[first]
        usual = float(np.median(graph.degree)) if len(graph.degree) else 0.0
        return CoarseGraph(coarsen(graph, points, nodes), usual)

    return map_blocks(work, len(scene.graphs), 1)


def solve(
    scene: PreparedCloud,
    graphs: list[CoarseGraph],
    labels: Labels,
    strength: float,
    rules: WalkerRules,
) -> list[Solution]:
    """Walk over each graph, drawn to what features say; few labels let the answer teach what classes look like.

    Args:
        scene: The scan.
        graphs: Of :func:`coarse_graphs`, with the labelled points as nodes of their own.
        labels: At least one, or examples.
        strength: Of the features, as a share of the usual degree of a point; 0: walkers alone.
        rules: The rest.
    """
    likely = _features_say(scene, graphs, labels, strength, rules)
    return _walks(graphs, labels, likely, strength, rules)


def _features_say(
    scene: PreparedCloud,
    graphs: list[CoarseGraph],
    labels: Labels,
    strength: float,
    rules: WalkerRules,
) -> Float[np.ndarray, 'points classes']:
    """What features say of each point, of which a first answer is a teacher where labels are few; see :func:`solve`."""
    if not strength > 0:
        return np.full((len(scene.cloud), labels.num_classes), 1.0 / labels.num_classes, dtype=np.float32)
    likely = class_shares(scene, labels, rules.examples)
    taught = 1.0 - trust_of(labels, rules)
    if taught < LEAST_TAUGHT:
        return likely
    found = _walks(graphs, labels, likely, strength, rules)
    learnt = class_shares(scene, labels, rules.examples, at_points(graphs, found))
    return np.asarray((1.0 - taught) * likely + taught * learnt)


def at_points(graphs: list[CoarseGraph], found: list[Solution]) -> Float[np.ndarray, 'points classes']:
    """Mean of the answers on all graphs, at each point; float32."""
    total = sum(each.shares.astype(np.float32)[graph.coarse.node] for graph, each in zip(graphs, found, strict=True))
    return np.asarray(total / np.float32(len(graphs)))


def trust_of(labels: Labels, rules: WalkerRules) -> float:
    """How far those that teach the features are to be trusted: labelled regions of the scan, and examples of others."""
    counts = teaching_counts(labels)
    return label_trust(counts[counts > 0], rules.prior_half)


def _walks(
    graphs: list[CoarseGraph],
    labels: Labels,
    likely: Float[np.ndarray, 'points classes'],
    strength: float,
    rules: WalkerRules,
) -> list[Solution]:
    """A walk over each graph, drawn to what features say of each point; see :func:`solve`."""

    def work(first: int, _: int) -> Solution:
        graph = graphs[first]
        return _walk(graph, labels, normalised(graph.mean(likely)), strength, rules)

    return map_blocks(work, len(graphs), 1)


def _walk(
    graph: CoarseGraph,
    labels: Labels,
    likely: Float[np.ndarray, 'nodes classes'],
    strength: float,
    rules: WalkerRules,
) -> Solution:
    """One walker; frequencies of the classes are read off its own answer."""
    sizes, nodes, count = graph.coarse.sizes, graph.coarse.node[labels.points], labels.num_classes
    pull = Pull(np.full(len(sizes), strength * graph.usual_degree), likely)
    system = HarmonicSystem(graph.coarse.weights, nodes, pull.strength * sizes)
    given, places, counts = np.eye(count)[labels.classes], labels.place_counts, labels.counts
    shares = system.shares(given, pull.prior)
    for _ in range(rules.prior_rounds if strength > 0 and places.max(initial=0) > 1 else 0):
        factors = prior_shift(
            shares.argmax(axis=1), sizes, np.maximum(places, 1), rules.prior_half, np.maximum(counts, 1)
        )
        pull = pull._replace(prior=normalised(likely * factors))
        shares = system.shares(given, pull.prior)
    return Solution(normalised(np.maximum(shares, 0.0)), pull)
