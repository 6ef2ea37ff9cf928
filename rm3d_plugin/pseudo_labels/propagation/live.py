"""Labels that spread anew with every click: what can be computed before the first click is.

The answer of a random walker with a prior is linear in the labels. With K the inverse of the graph's screened
Laplacian, and x0 = K G u what the prior alone gives, labels y at the nodes m change it to
x0 + K[:, m] K[m, m]^-1 (y - x0[m]). So a click costs one column of K.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from jaxtyping import Float, Int
from scipy.linalg import cho_factor, cho_solve

from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.pseudo_labels.common.kernel_classifier import evenly_chosen, normalised
from rm3d_plugin.pseudo_labels.propagation.class_shares import class_shares
from rm3d_plugin.pseudo_labels.propagation.labels import Labels, places_of
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud
from rm3d_plugin.pseudo_labels.propagation.prior_shift import prior_shift
from rm3d_plugin.pseudo_labels.propagation.rules import WalkerRules
from rm3d_plugin.pseudo_labels.propagation.solve import CoarseGraph, coarse_graphs

NODES = 6000  # of each graph: a click is answered at once
STRENGTH = 0.001  # pull of the features, as a share of the usual degree; the same however many clicks there are
PINNED = 100  # labelled points of a class that are solved for, at most; the others have their label alone
KEPT = 1024  # columns of each graph that are kept for later clicks, at most, beside those of now: 50 MB
COLUMNS = 256  # of the inverse that are solved for at once
JITTER = 1e-9  # of the largest variance, so that two clicks side by side are no trouble


class LiveAnswer(NamedTuple):
    """What is said of each point.

    Attributes:
        shares: (N, C) float32 rows of sum 1; zeros before the first label.
        apart: (N,) float32 in [0, 1], how far the two graphs' answers are apart (total variation).
    """

    shares: Float[np.ndarray, 'points classes']
    apart: Float[np.ndarray, ' points']


class LivePropagation:
    """Spreads labels over a scan again and again, each time with few more or fewer.

    What it says is near to, not the same as :func:`~rm3d_plugin.pseudo_labels.propagation.propagate_prepared`.

    Args:
        scene: The scan.
        rules: None: the defaults.
    """

    def __init__(self, scene: PreparedCloud, rules: WalkerRules | None = None) -> None:
        self.scene, self._rules = scene, rules or WalkerRules()
        self._coarse_scales = scene._replace(scales=scene.scales[1:] or scene.scales)
        self._tree = Octree(scene.cloud.xyz)
        self._graphs = [_Graph(graph) for graph in coarse_graphs(scene, np.zeros(0, np.int64), NODES)]

    def answer(
        self, points: Int[np.ndarray, ' labelled'], classes: Int[np.ndarray, ' labelled'], num_classes: int
    ) -> LiveAnswer:
        """Spread labels.

        Args:
            points: Labelled ones, each once.
            classes: Of these, below ``num_classes``.
            num_classes: Classes without a label are not named.
        """
        count = len(self.scene.cloud)
        if not len(points):
            return LiveAnswer(np.zeros((count, num_classes), np.float32), np.zeros(count, np.float32))
        present, own = np.unique(classes, return_inverse=True)
        labels = Labels.of(self.scene, points, own, len(present), tree=self._tree)
        likely = class_shares(self._coarse_scales, labels, self._rules.examples)
        few = evenly_chosen(own, PINNED)
        said = [graph.spread(likely, points[few], own[few], labels, self._rules) for graph in self._graphs]
        shares = np.zeros((count, num_classes), np.float32)
        shares[:, present] = sum(said) / len(said)
        shares[points] = np.eye(num_classes, dtype=np.float32)[classes]
        return LiveAnswer(shares, np.abs(said[0] - said[1]).sum(axis=1) / 2)

    def places(
        self, points: Int[np.ndarray, ' labelled'], classes: Int[np.ndarray, ' labelled']
    ) -> Int[np.ndarray, ' labelled']:
        """Of the labels, see :func:`~rm3d_plugin.pseudo_labels.propagation.labels.places_of`."""
        return places_of(self.scene.cloud.xyz, points, classes, self._tree)

    def alike(self, points: Int[np.ndarray, ' asked']) -> Float[np.ndarray, 'asked asked']:
        """How much a label of one point tells of another over the graphs: correlations in [0, 1], mean of both graphs.

        Args:
            points: In thousands at most, one solve each.
        """
        return np.asarray(sum(graph.correlation(points) for graph in self._graphs) / len(self._graphs))


class _Graph:
    """A graph whose screened Laplacian is factored, and the columns of its inverse at labels so far."""

    def __init__(self, graph: CoarseGraph) -> None:
        self._graph, self._node = graph, graph.coarse.node
        self._pull = STRENGTH * graph.usual_degree * graph.coarse.sizes
        degree = np.asarray(graph.coarse.weights.sum(axis=1), dtype=np.float64).ravel()
        least = 1e-12 * max(float(degree.max(initial=0.0)), 1e-12)
        matrix = scipy.sparse.diags_array(degree + self._pull + least) - graph.coarse.weights
        options = {'SymmetricMode': True}
        self._solve = scipy.sparse.linalg.splu(
            matrix.tocsc(), permc_spec='MMD_AT_PLUS_A', diag_pivot_thresh=0.0, options=options
        ).solve
        self._columns: dict[int, Float[np.ndarray, ' nodes']] = {}

    def spread(
        self,
        likely: Float[np.ndarray, 'points classes'],
        points: Int[np.ndarray, ' labelled'],
        classes: Int[np.ndarray, ' labelled'],
        labels: Labels,
        rules: WalkerRules,
    ) -> Float[np.ndarray, 'points classes']:
        """Rows of sum 1; float32."""
        sizes, count = self._graph.coarse.sizes, likely.shape[1]
        given = np.zeros((len(sizes), count))
        np.add.at(given, (self._node[points], classes), 1.0)
        pinned = np.flatnonzero(given.sum(axis=1))
        target, prior = normalised(given[pinned]), normalised(self._graph.mean(likely))
        columns = self._columns_of(pinned)
        nearby = columns[pinned]
        factor = cho_factor(nearby + JITTER * nearby.max() * np.eye(len(pinned)))
        shares = self._pinned(prior, target, pinned, columns, factor)
        places = labels.place_counts
        if places.max() > 1:
            factors = prior_shift(shares.argmax(axis=1), sizes, places, rules.prior_half, labels.counts)
            shares = self._pinned(normalised(prior * factors), target, pinned, columns, factor)
        return normalised(np.maximum(shares, 0.0)).astype(np.float32)[self._node]

    def correlation(self, points: Int[np.ndarray, ' asked']) -> Float[np.ndarray, 'asked asked']:
        """Of the answers at points, before any label is known."""
        nodes = self._node[points]
        parts = np.array_split(np.arange(len(nodes)), max(-(-len(nodes) // COLUMNS), 1))
        own = np.concatenate([self._solve(_columns(len(self._pull), nodes[part]))[nodes].T for part in parts])
        scale = 1.0 / np.sqrt(np.maximum(np.diag(own), 1e-300))
        return np.asarray((own + own.T) / 2 * scale[:, None] * scale)

    def _pinned(
        self,
        prior: Float[np.ndarray, 'nodes classes'],
        target: Float[np.ndarray, 'pinned classes'],
        pinned: Int[np.ndarray, ' pinned'],
        columns: Float[np.ndarray, 'nodes pinned'],
        factor: tuple[np.ndarray, bool],
    ) -> Float[np.ndarray, 'nodes classes']:
        free = self._solve(self._pull[:, None] * prior)
        return np.asarray(free + columns @ cho_solve(factor, target - free[pinned]))

    def _columns_of(self, nodes: Int[np.ndarray, ' asked']) -> Float[np.ndarray, 'nodes asked']:
        if len(self._columns) > KEPT:
            self._columns = {node: self._columns[node] for node in nodes.tolist() if node in self._columns}
        fresh = np.array([node for node in nodes.tolist() if node not in self._columns], dtype=np.int64)
        if len(fresh):
            solved = self._solve(_columns(len(self._pull), fresh))
            self._columns |= {node: column.copy() for node, column in zip(fresh.tolist(), solved.T, strict=True)}
        return np.stack([self._columns[node] for node in nodes.tolist()], axis=1)


def _columns(nodes: int, asked: Int[np.ndarray, ' asked']) -> Float[np.ndarray, 'nodes asked']:
    """Columns of the identity."""
    out = np.zeros((nodes, len(asked)))
    out[asked, np.arange(len(asked))] = 1.0
    return out
