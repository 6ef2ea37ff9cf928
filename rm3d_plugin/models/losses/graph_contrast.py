"""Graph-structured contrastive loss (Landrieu and Boussaha, CVPR 2019; METHOD 3, S-SPG)."""

from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.losses.loss_term import LossTerm
from rm3d_plugin.ops.nearest_within import neighbor_pairs
from rm3d_plugin.registry import MODELS

_TINY = 1e-12  # under a root, whose slope would be infinite at 0


def border_weights(
    objects: Int[Tensor, ' points'], edges: Int[Tensor, 'edges 2'], strength: float
) -> Float[Tensor, ' edges']:
    """1 + strength min(|C1|, |C2|) / (edges between C1 and C2) for an edge between two objects, 0 within one.

    A single edge over which a small object would leak into a large one weighs as much as the small object is worth.

    Args:
        objects: From 0; of each point.
        edges: Pairs of points.
        strength: mu. Larger: borders count more.
    """
    sizes = torch.bincount(objects)
    ends = objects[edges].sort(dim=1).values
    across = ends[:, 0] != ends[:, 1]
    keys = ends[:, 0] * len(sizes) + ends[:, 1]
    _, pair, shared = torch.unique(keys, return_inverse=True, return_counts=True)
    smaller = sizes[ends].amin(dim=1)
    return torch.where(across, 1 + strength * smaller / shared[pair], 0.0)


def graph_contrast_loss(
    embeddings: Float[Tensor, 'points channels'],
    objects: Int[Tensor, ' points'],
    edges: Int[Tensor, 'edges 2'],
    delta: float = 0.2,
    strength: float = 50.0,
) -> Float[Tensor, '']:
    """Mean over the edges of delta (sqrt(1 + d^2 / delta^2) - 1) within objects, and of w max(0, 1 - d) between them.

    The pseudo-Huber function is taken of the squared distance d^2.

    Args:
        embeddings: Unit vectors.
        objects: From 0; -1 = unknown: edges that touch such a point do not count.
        edges: Pairs of adjacent points.
        delta: Distance from which the pull no longer grows.
        strength: mu of :func:`border_weights`; 5 * 2 * k for a graph of k nearest points.

    Returns:
        0 where no edge counts.

    >>> rows = torch.tensor([[1.0, 0.0], [1.0, 0.0], [0.6, 0.8]])
    >>> edges = torch.tensor([[0, 1], [1, 2]])
    >>> round(graph_contrast_loss(rows, torch.tensor([0, 0, 1]), edges, strength=4.0).item(), 4)
    0.2639
    """
    edges = edges[(objects[edges] >= 0).all(dim=1)]
    if not len(edges):
        return embeddings.sum() * 0.0
    squared = (embeddings[edges[:, 0]] - embeddings[edges[:, 1]]).square().sum(dim=1)
    weights = border_weights(objects.clamp_min(0), edges, strength)
    pull = delta * ((1 + squared / delta**2).sqrt() - 1)
    push = weights * (1 - squared.clamp_min(_TINY).sqrt()).clamp_min(0.0)
    return torch.where(weights > 0, push, pull).mean()


@MODELS.register_module()
class GraphContrast(LossTerm):
    """``loss_graph``: neighbours of one object are alike, neighbours of two are not.

    Args:
        neighbors: k_adj, nearest sites that each is joined to.
        delta: See :func:`graph_contrast_loss`.
        border_strength: mu; None: 5 * 2 * neighbors (METHOD 3).
        loss_weight: Factor of the loss.
    """

    needs = ('features', 'objects')

    def __init__(
        self, neighbors: int = 5, delta: float = 0.2, border_strength: float | None = None, loss_weight: float = 1.0
    ) -> None:
        super().__init__()
        self.neighbors, self.delta, self.loss_weight = neighbors, delta, loss_weight
        self.border_strength = 10.0 * neighbors if border_strength is None else border_strength

    def forward(self, batch: Batch, outputs: Any, labels: Any) -> dict[str, Tensor]:
        """The mean over all edges of a batch; scenes are not joined."""
        edges = neighbor_pairs(batch.xyz, batch.batch_offsets, self.neighbors)
        loss = graph_contrast_loss(outputs.features, labels.objects, edges, self.delta, self.border_strength)
        return {'loss_graph': self.loss_weight * loss}
