"""What the network says, carried on over the graph of place and colour, at test time (Xu and Lee, CVPR 2020)."""

import numpy as np
import scipy.sparse
import torch
from jaxtyping import Float
from scipy.sparse.linalg import cg
from torch import Tensor

from rm3d_plugin.baselines.xu_lee.graph import ColourGraph, colour_graph
from rm3d_plugin.registry import MODELS

_RIDGE = 1e-5


def confidence(probs: Float[np.ndarray, 'points classes']) -> Float[np.ndarray, ' points']:
    """1 less the entropy over the largest there is, in [0, 1].

    >>> confidence(np.array([[0.5, 0.5], [1.0, 0.0]])).round(2).tolist()
    [0.0, 1.0]
    """
    logs = np.log(np.maximum(probs, 1e-12))
    return np.clip(1.0 + (probs * logs).sum(axis=1) / np.log(probs.shape[1]), 0.0, 1.0)


def laplacian(graph: ColourGraph, count: int) -> scipy.sparse.csr_matrix:
    """D - W of the graph, an edge in either direction being one of both."""
    one_way = scipy.sparse.csr_matrix((graph.weight, (graph.source, graph.target)), shape=(count, count))
    weights = one_way.maximum(one_way.T)
    return (scipy.sparse.diags(np.asarray(weights.sum(axis=1)).ravel()) - weights).tocsr()


def propagated(
    probs: Float[np.ndarray, 'points classes'], graph: ColourGraph, alpha: float = 1.0, beta: float = 1.0
) -> Float[np.ndarray, 'points classes']:
    """Y = beta (alpha L + beta diag(w) + 1e-5 I)^-1 diag(w) G, rows made to add up to 1.

    Args:
        probs: G, the network's; w is their :func:`confidence`.
        graph: Of which L is the Laplacian.
        alpha: Of the neighbours; larger: smoother.
        beta: Of the network; larger: closer to it.
    """
    trust = confidence(probs)
    system = alpha * laplacian(graph, len(probs)) + scipy.sparse.diags(beta * trust + _RIDGE)
    scale = scipy.sparse.diags(1.0 / system.diagonal())  # Jacobi: points differ by their number of neighbours
    solved = [cg(system, column, x0=start, rtol=1e-6, M=scale)[0] for column, start in _columns(beta, trust, probs)]
    found = np.maximum(np.stack(solved, axis=1), 0.0)
    total = found.sum(axis=1, keepdims=True)
    return np.where(total > 0, found / np.where(total > 0, total, 1.0), probs)


def _columns(beta: float, trust: np.ndarray, probs: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of each class the right-hand side and where the search starts."""
    return [(beta * trust * column, column) for column in probs.T]


@MODELS.register_module()
class XuLeePropagation:
    """A model's ``refine``: :func:`propagated` over the points of a scene.

    Args:
        channels: Columns behind x, y, z that neighbours agree in.
        alpha: See :func:`propagated`.
        beta: See :func:`propagated`.
    """

    def __init__(self, channels: int = 3, alpha: float = 1.0, beta: float = 1.0) -> None:
        self.channels, self.alpha, self.beta = channels, alpha, beta

    def __call__(
        self, points: Float[Tensor, 'points columns'], probs: Float[Tensor, 'points classes']
    ) -> Float[Tensor, 'points classes']:
        """Class probabilities of the points of one scene, on the CPU."""
        if len(points) == 0:
            return probs
        graph = colour_graph(points[:, : 3 + self.channels].double().cpu().numpy())
        found = propagated(probs.double().cpu().numpy(), graph, self.alpha, self.beta)
        return torch.from_numpy(found).to(probs)
