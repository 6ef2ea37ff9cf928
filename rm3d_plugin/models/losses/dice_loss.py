"""L_Dice: a soft mask against the membership of an instance (METHOD 7)."""

import torch
from jaxtyping import Float
from torch import Tensor

from rm3d_plugin.models.losses.reduction import ReducedLoss
from rm3d_plugin.registry import MODELS


def dice_loss(
    mask: Float[Tensor, '*masks points'],
    member: Float[Tensor, '*masks points'],
    known: Float[Tensor, '*masks points'] | None = None,
) -> Float[Tensor, '*masks']:
    """1 - (2 sum p g + 1) / (sum p + sum g + 1) over the last axis.

    Args:
        mask: p, in [0, 1].
        member: g, 1 for the points of the instance.
        known: Factor of each point; 0 leaves out a point whose membership is unknown.

    >>> import torch
    >>> dice_loss(torch.tensor([1.0, 1.0, 0.0]), torch.tensor([1.0, 0.0, 0.0])).item()
    0.25
    """
    if known is not None:
        mask, member = mask * known, member * known
    return 1.0 - (2.0 * (mask * member).sum(dim=-1) + 1.0) / (mask.sum(dim=-1) + member.sum(dim=-1) + 1.0)


@MODELS.register_module()
class DiceLoss(ReducedLoss):
    """Weighted mean of :func:`dice_loss` over masks; 0 for no mask.

    Args:
        loss_weight: Factor of the loss; larger: tighter instances.
        reduction: 'mean', 'sum' or 'none' of the masks.
    """

    def forward(
        self,
        mask: Float[Tensor, '*masks points'],
        member: Float[Tensor, '*masks points'],
        known: Float[Tensor, '*masks points'] | None = None,
        avg_factor: float | None = None,
    ) -> Float[Tensor, '...']:
        """Loss of the masks; ``avg_factor`` as in mmdetection."""
        return self.weighted(torch.atleast_1d(dice_loss(mask, member, known)), avg_factor)
