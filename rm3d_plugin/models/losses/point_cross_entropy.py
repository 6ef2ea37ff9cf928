"""Cross-entropy over the points that have a (pseudo) label, and the weights of rare classes."""

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int, Num
from torch import Tensor, nn

from rm3d_plugin.registry import MODELS


def class_weights(counts: Num[Tensor, ' classes'], power: float) -> Float[Tensor, ' classes']:
    """Class weights count^-power, scaled so that their mean over the counted labels is 1; 1 for a class without any.

    Args:
        counts: Labels of each class.
        power: 0 weighs labels alike, 0.5 is the inverse square root, 1 gives every class the same total.

    >>> class_weights(torch.tensor([1.0, 4.0, 0.0]), 0.5).tolist()
    [1.6666666269302368, 0.8333333134651184, 1.0]
    """
    counts = counts.double()
    weights = torch.where(counts > 0, counts.clamp_min(1.0).pow(-power), 0.0)
    scaled = weights * (counts.sum() / (weights * counts).sum().clamp_min(1e-12))
    return torch.where(counts > 0, scaled, 1.0).float()


def point_cross_entropy(
    logits: Float[Tensor, 'points classes'],
    labels: Int[Tensor, ' points'],
    class_weights: Float[Tensor, ' classes'] | None = None,
    unlabelled_weight: float = 0.0,
    point_weights: Float[Tensor, ' points'] | None = None,
) -> Float[Tensor, '']:
    """Cross-entropy averaged (by weight) over the labelled points; 0 where no point counts.

    Args:
        logits: Raw class scores.
        labels: Class numbers; -1 = unlabelled.
        class_weights: Weight of each class; 1 when not given.
        unlabelled_weight: In [0, 1]. Above 0, a point without a label counts as background (the last class) with this
            weight; 0 ignores it.
        point_weights: Further factor of each point; 1 when not given.
    """
    unlabelled = labels < 0
    background = logits.shape[1] - 1
    target = labels.masked_fill(unlabelled, background)
    weight = torch.ones_like(logits[:, 0]) if class_weights is None else class_weights.to(logits)[target]
    weight = torch.where(unlabelled, unlabelled_weight * weight, weight)
    if point_weights is not None:
        weight = weight * point_weights.to(logits)
    each = F.cross_entropy(logits, target, reduction='none')
    return (each * weight).sum() / weight.sum().clamp_min(1e-6)


@MODELS.register_module()
class PointCrossEntropyLoss(nn.Module):
    """Weighted :func:`point_cross_entropy`.

    Args:
        loss_weight: Factor of the loss.
        unlabelled_weight: Weight of a point without a label as background; 0 ignores it.
    """

    def __init__(self, loss_weight: float = 1.0, unlabelled_weight: float = 0.0) -> None:
        super().__init__()
        self.loss_weight = loss_weight
        self.unlabelled_weight = unlabelled_weight

    def forward(
        self,
        logits: Float[Tensor, 'points classes'],
        labels: Int[Tensor, ' points'],
        class_weights: Float[Tensor, ' classes'] | None = None,
        point_weights: Float[Tensor, ' points'] | None = None,
    ) -> Float[Tensor, '']:
        """Loss over the points of a batch; weights as in :func:`point_cross_entropy`."""
        return self.loss_weight * point_cross_entropy(
            logits, labels, class_weights, self.unlabelled_weight, point_weights
        )
