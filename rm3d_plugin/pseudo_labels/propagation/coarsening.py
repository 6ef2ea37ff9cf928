"""A small graph that stands for a large one: points joined by heavy edges become one node (Notay 2010)."""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: ANN001, ANN202
from typing import NamedTuple

import numpy as np
import scipy.sparse
from jaxtyping import Bool, Int
from numba import njit

from rm3d_plugin.pseudo_labels.propagation.given_up import still_wanted
from rm3d_plugin.pseudo_labels.propagation.point_graph import PointGraph

STALLED = 0.9  # share of the nodes that is left where a round of pairing is no use


class Coarsening(NamedTuple):
    """Nodes that stand for points.

    Attributes:
        node: (N,) node of each point; numbered by their first point.
        weights: (M, M) CSR, sums of the weights between two nodes, no diagonal.
        sizes: (M,) points of each node.
    """

    node: Int[np.ndarray, ' points']
    weights: scipy.sparse.csr_array
    sizes: Int[np.ndarray, ' nodes']


def coarsen(graph: PointGraph, alone: Int[np.ndarray, ' kept'], most: int) -> Coarsening:
    """Pair nodes along their heaviest edges until few are left.

    Args:
        graph: Of the points.
        alone: Points that stay nodes of their own: the labelled ones.
        most: Other nodes that are wanted, at most; where edges run out there are more.
    """
    weights = graph.weights
    node = np.arange(weights.shape[0])
    kept = np.zeros(len(node), dtype=np.bool_)
    kept[alone] = True
    while weights.shape[0] - len(alone) > most:
        still_wanted()
        pair, count = _pair(weights.indptr, weights.indices, weights.data, kept)
        if count > STALLED * weights.shape[0]:
            break
        weights, node, kept = _joined(weights, pair, count), pair[node], _any(kept, pair, count)
    return Coarsening(node, weights, np.bincount(node, minlength=weights.shape[0]))


def _joined(weights: scipy.sparse.csr_array, pair: Int[np.ndarray, ' nodes'], count: int) -> scipy.sparse.csr_array:
    edges = weights.tocoo()
    start, end = pair[edges.coords[0]], pair[edges.coords[1]]
    between = start != end
    out = scipy.sparse.coo_array((edges.data[between], (start[between], end[between])), shape=(count, count)).tocsr()
    out.sort_indices()
    return out


def _any(flags: Bool[np.ndarray, ' nodes'], pair: Int[np.ndarray, ' nodes'], count: int) -> Bool[np.ndarray, ' pairs']:
    out = np.zeros(count, dtype=np.bool_)
    out[pair[flags]] = True
    return out


@njit(cache=True, nogil=True)
def _pair(indptr, indices, data, alone):
    """Each node in turn takes the free neighbour of its heaviest edge; ties go to the lower number."""
    count = len(indptr) - 1
    out = np.full(count, -1, np.int64)
    pairs = 0
    for node in range(count):
        if out[node] >= 0:
            continue
        out[node] = pairs
        best, heaviest = -1, 0.0
        if not alone[node]:
            for at in range(indptr[node], indptr[node + 1]):
                other = indices[at]
                if out[other] < 0 and not alone[other] and data[at] > heaviest:
                    best, heaviest = other, data[at]
        if best >= 0:
            out[best] = pairs
        pairs += 1
    return out, pairs
