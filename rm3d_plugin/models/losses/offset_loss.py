"""L_o: offsets from points to the centre of their instance (METHOD 7)."""

from typing import NamedTuple

from jaxtyping import Bool, Float
from torch import Tensor

from rm3d_plugin.models.losses.reduction import ReducedLoss
from rm3d_plugin.registry import MODELS

_SHORTEST = 1e-3  # m; METHOD 7: an offset shorter than this has no direction


def offset_loss(offsets: Float[Tensor, 'points 3'], targets: Float[Tensor, 'points 3']) -> Float[Tensor, '']:
    """Mean of |o - o*|_1 minus the mean cosine between o and o*.

    The cosine is averaged over the points whose true offset has a direction (1 mm or longer), so that a perfect
    prediction is worth -1. No points: 0.

    Args:
        offsets: Predicted, metres.
        targets: True, metres.

    >>> import torch
    >>> offset_loss(torch.tensor([[3.0, 0.0, 4.0]]), torch.tensor([[3.0, 0.0, 4.0]])).item()
    -1.0
    """
    parts = offset_parts(offsets, targets)
    directed = parts.directed.sum().clamp_min(1)
    return parts.distance.sum() / max(len(offsets), 1) - parts.cosine.sum() / directed


class OffsetParts(NamedTuple):
    """Both terms of each point.

    Attributes:
        distance: (N,) |o - o*|_1 in metres.
        cosine: (N,) between o and o*; 0 where the true offset has no direction.
        directed: (N,) whether it has one.
    """

    distance: Float[Tensor, ' points']
    cosine: Float[Tensor, ' points']
    directed: Bool[Tensor, ' points']


def offset_parts(offsets: Float[Tensor, 'points 3'], targets: Float[Tensor, 'points 3']) -> OffsetParts:
    """What :func:`offset_loss` averages; metres."""
    length = targets.norm(dim=1)
    directed = length >= _SHORTEST
    scale = offsets.norm(dim=1).clamp_min(_SHORTEST) * length.clamp_min(_SHORTEST)
    cosine = (offsets * targets).sum(dim=1) / scale
    return OffsetParts((offsets - targets).abs().sum(dim=1), cosine * directed, directed)


@MODELS.register_module()
class OffsetLoss(ReducedLoss):
    """Weighted :func:`offset_loss`.

    Args:
        loss_weight: Factor of the loss.
        reduction: 'mean': as :func:`offset_loss`; 'none': distance minus cosine of each point, 'sum': their sum.
    """

    def forward(
        self,
        offsets: Float[Tensor, 'points 3'],
        targets: Float[Tensor, 'points 3'],
        avg_factor: float | None = None,
    ) -> Float[Tensor, '...']:
        """Loss over the points of instances; ``avg_factor`` divides the sum over the points."""
        if self.reduction == 'mean' and avg_factor is None:
            return self.loss_weight * offset_loss(offsets, targets)
        parts = offset_parts(offsets, targets)
        return self.weighted(parts.distance - parts.cosine, avg_factor)
