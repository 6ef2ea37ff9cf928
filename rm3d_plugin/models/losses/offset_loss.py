"""L_o: offsets from points to the centre of their instance (METHOD 7)."""

from jaxtyping import Float
from torch import Tensor, nn

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
    length = targets.norm(dim=1)
    directed = length >= _SHORTEST
    distance = (offsets - targets).abs().sum(dim=1).sum() / max(len(offsets), 1)
    scale = offsets.norm(dim=1).clamp_min(_SHORTEST) * length.clamp_min(_SHORTEST)
    cosine = (offsets * targets).sum(dim=1) / scale
    return distance - (cosine * directed).sum() / directed.sum().clamp_min(1)


@MODELS.register_module()
class OffsetLoss(nn.Module):
    """Weighted :func:`offset_loss`.

    Args:
        loss_weight: Factor of the loss.
    """

    def __init__(self, loss_weight: float = 1.0) -> None:
        super().__init__()
        self.loss_weight = loss_weight

    def forward(self, offsets: Float[Tensor, 'points 3'], targets: Float[Tensor, 'points 3']) -> Float[Tensor, '']:
        """Loss over the points of instances."""
        return self.loss_weight * offset_loss(offsets, targets)
