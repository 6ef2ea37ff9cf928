"""Which object each point belongs to, from labelled points of some objects."""

import numpy as np
import scipy.sparse
from jaxtyping import Int
from scipy.sparse.csgraph import connected_components

from rm3d_plugin.pseudo_labels.propagation.beside import Beside
from rm3d_plugin.pseudo_labels.propagation.point_graph import PointGraph
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud
from rm3d_plugin.pseudo_labels.propagation.propagate import propagate_prepared
from rm3d_plugin.pseudo_labels.propagation.rules import WalkerRules

NO_FEATURES = WalkerRules(features_strength=0.0, taught_strength=0.0, folds=0)  # chairs look alike: the walk decides


def spread_instances(
    scene: PreparedCloud,
    semantic: Int[np.ndarray, ' points'],
    annotated: Int[np.ndarray, ' points'],
) -> Int[np.ndarray, ' points']:
    """The instance of points that hang together with a labelled point of it by points of its class.

    Where several instances are labelled in such a piece, a random walk from all of them says whose a point is; a piece
    without a labelled point is of an unknown instance.

    Args:
        scene: The scan.
        semantic: Class of each point, -1 = unknown; labelled points have theirs.
        annotated: Instance of each labelled point, -1 = none.

    Returns:
        (N,) int64 instance, -1 = unknown.
    """
    out = np.full(len(semantic), -1, dtype=np.int64)
    labelled = np.flatnonzero((annotated >= 0) & (semantic >= 0))
    if not len(labelled):
        return out
    instances, number = np.unique(annotated[labelled], return_inverse=True)
    own = np.full(len(semantic), -1, dtype=np.int64)
    own[labelled] = number
    piece = pieces(scene.graphs[0], semantic)
    shares = propagate_prepared(scene, own, len(instances), NO_FEATURES, Beside(sharpness=1.0)).probabilities
    for each in np.unique(piece[labelled]):
        rows, there = np.flatnonzero(piece == each), np.unique(number[piece[labelled] == each])
        out[rows] = instances[there[shares[np.ix_(rows, there)].argmax(axis=1)]]
    out[labelled] = annotated[labelled]
    return out


def pieces(graph: PointGraph, semantic: Int[np.ndarray, ' points']) -> Int[np.ndarray, ' points']:
    """Points of one class that neighbours join; each point of unknown class is a piece of its own.

    Args:
        graph: Between neighbours.
        semantic: Class of each point, -1 = unknown.
    """
    edges = graph.weights.tocoo()
    start, end = edges.coords
    same = (semantic[start] == semantic[end]) & (semantic[start] >= 0)
    joined = scipy.sparse.coo_array((np.ones(np.count_nonzero(same)), (start[same], end[same])), shape=edges.shape)
    return np.asarray(connected_components(joined, directed=False)[1], dtype=np.int64)
