"""Cross-entropy over the points that have a (pseudo) label, and the weights of rare classes."""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int, Num
from torch import Tensor

from rm3d_plugin.models.losses.reduction import ReducedLoss, Reduction
from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import UNLABELLED

_EPS = 1e-6  # where no point counts, the mean is 0


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


class WeightedCrossEntropy(NamedTuple):
    """Of each point.

    Attributes:
        loss: (N,) cross-entropy times weight.
        weight: (N,) of the point in the mean.
    """

    loss: Float[Tensor, 'points *rest']
    weight: Float[Tensor, 'points *rest']


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
    each = weighted_cross_entropy(logits, labels, class_weights, unlabelled_weight, point_weights)
    return each.loss.sum() / each.weight.sum().clamp_min(_EPS)


def weighted_cross_entropy(
    logits: Float[Tensor, 'points classes *rest'],
    labels: Int[Tensor, 'points *rest'],
    class_weights: Float[Tensor, ' classes'] | None = None,
    unlabelled_weight: float = 0.0,
    point_weights: Float[Tensor, 'points *rest'] | None = None,
) -> WeightedCrossEntropy:
    """What :func:`point_cross_entropy` averages; see there."""
    unlabelled = labels < 0
    background = logits.shape[1] - 1
    target = labels.masked_fill(unlabelled, background)
    weight = torch.ones_like(logits[:, 0]) if class_weights is None else class_weights.to(logits)[target]
    weight = torch.where(unlabelled, unlabelled_weight * weight, weight)
    if point_weights is not None:
        weight = weight * point_weights.to(logits)
    each = F.cross_entropy(logits, target, reduction='none')
    return WeightedCrossEntropy(each * weight, weight)


@MODELS.register_module()
class PointCrossEntropyLoss(ReducedLoss):
    """Weighted :func:`point_cross_entropy`.

    Args:
        loss_weight: Factor of the loss.
        unlabelled_weight: Weight of a point without a label as background, until a model is told that the labels judged
            every place (``judged``); 0 ignores it.
        reduction: 'mean' over the weights, 'sum' or 'none' of the points.
        ignore_index: A further label that means unlabelled, besides -1: ``num_classes`` in mmdetection3d.
    """

    judged = False  # as LabelStatistics has it

    def __init__(
        self,
        loss_weight: float = 1.0,
        unlabelled_weight: float = 0.0,
        reduction: Reduction = 'mean',
        ignore_index: int | None = None,
    ) -> None:
        super().__init__(loss_weight, reduction)
        self.unlabelled_weight, self.ignore_index = unlabelled_weight, ignore_index

    def forward(
        self,
        logits: Float[Tensor, 'points classes *rest'],
        labels: Int[Tensor, 'points *rest'],
        class_weights: Float[Tensor, ' classes'] | None = None,
        point_weights: Float[Tensor, 'points *rest'] | None = None,
        avg_factor: float | None = None,
        ignore_index: int | None = None,
    ) -> Float[Tensor, '...']:
        """Loss over the points of a batch: (N, C) and (N,), or (B, C, N) and (B, N) as mmdetection3d's heads have them.

        Args:
            logits: Raw class scores.
            labels: Class numbers; -1 = unlabelled.
            class_weights: See :func:`point_cross_entropy`.
            point_weights: See :func:`point_cross_entropy`.
            avg_factor: What the sum is divided by; None: the sum of the weights.
            ignore_index: Instead of that of the loss.
        """
        ignored = self.ignore_index if ignore_index is None else ignore_index
        known = labels if ignored is None else labels.masked_fill(labels == ignored, UNLABELLED)
        unlabelled = 0.0 if self.judged else self.unlabelled_weight
        each = weighted_cross_entropy(logits, known, class_weights, unlabelled, point_weights)
        return self.weighted(each.loss, avg_factor, each.weight.sum().clamp_min(_EPS))
