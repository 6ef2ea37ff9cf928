"""Class scores of points, and the loss that learns them from (pseudo) labels (METHOD 7, L_WSL)."""

from collections.abc import Sequence
from typing import Any, Literal, get_args

import torch
from jaxtyping import Float, Num
from torch import Tensor, nn

from rm3d_plugin.models.heads.point_labels import PointLabels
from rm3d_plugin.models.losses.point_cross_entropy import class_balance
from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import UNLABELLED

Balance = Literal['none', 'frequency', 'batch']


def frequency_weights(counts: Float[Tensor, ' classes'], power: float) -> Float[Tensor, ' classes']:
    """Class weights count^-power, scaled so that their mean over the counted labels is 1; 1 for a class without any.

    Args:
        counts: Annotated labels of each class.
        power: 0 weighs labels alike, 0.5 is the inverse square root, 1 gives every class the same total.

    >>> frequency_weights(torch.tensor([1.0, 4.0, 0.0]), 0.5).tolist()
    [1.6666666269302368, 0.8333333134651184, 1.0]
    """
    known = counts > 0
    weights = torch.where(known, counts.double().clamp_min(1.0).pow(-power), 0.0)
    total = (weights * counts).sum()
    scaled = weights * (counts.sum() / total.clamp_min(1e-12))
    return torch.where(known, scaled, 1.0).float()


@MODELS.register_module()
class SemanticHead(nn.Module):
    """A linear layer on the features of points, with L_WSL.

    Args:
        in_channels: Columns of the features.
        num_classes: C.
        loss: L_WSL, called as ``PointCrossEntropyLoss`` is.
        balance: Rare classes count more: 'none'; 'frequency': by the annotated labels of the whole training set (see
            :meth:`set_class_counts`); 'batch': by the labels of each batch.
        power: How much more: weight of a class = count^-power. 0.5: inverse square root; larger: rarer classes gain.
        pseudo_weight: Weight of a label that the budget did not show, against 1 of an annotated one; smaller: trusts
            pseudo labels less.
        annotated_share: In (0, 1): share of L_WSL that the mean over annotated labels has, however few they are; that
            over pseudo labels has the rest. Larger: trusts pseudo labels less. None: all labels are averaged together.
        class_counts: Annotated labels of each class, where they are known beforehand.
    """

    class_counts: Tensor

    def __init__(
        self,
        in_channels: int,
        num_classes: int,
        loss: dict[str, Any] | None = None,
        balance: Balance = 'none',
        power: float = 0.5,
        pseudo_weight: float = 1.0,
        annotated_share: float | None = None,
        class_counts: Sequence[int] | None = None,
    ) -> None:
        super().__init__()
        if balance not in get_args(Balance):
            raise ValueError(f'SemanticHead.balance: expected one of {get_args(Balance)}, got {balance!r}')
        if pseudo_weight < 0:
            raise ValueError(f'SemanticHead.pseudo_weight: expected 0 or more, got {pseudo_weight}')
        if annotated_share is not None and not 0 < annotated_share < 1:
            raise ValueError(
                f'SemanticHead.annotated_share: expected a share between 0 and 1, or None, got {annotated_share}'
            )
        self.annotated_share = annotated_share
        self.num_classes, self.balance, self.power, self.pseudo_weight = num_classes, balance, power, pseudo_weight
        self.linear = nn.Linear(in_channels, num_classes)
        self.loss_part = MODELS.build({'type': 'PointCrossEntropyLoss', **(loss or {})})
        self.register_buffer('class_counts', torch.zeros(num_classes))
        if class_counts is not None:
            self.set_class_counts(torch.tensor(list(class_counts)))

    def set_class_counts(self, counts: Num[Tensor, ' classes']) -> None:
        """Tell how many labels of each class are annotated, for ``balance='frequency'``; kept in checkpoints.

        Raises:
            ValueError: There is not one count a class.
        """
        if counts.shape != (self.num_classes,):
            raise ValueError(f'SemanticHead: expected {self.num_classes} class counts, got shape {tuple(counts.shape)}')
        self.class_counts.copy_(counts)

    def forward(self, features: Float[Tensor, 'points channels']) -> Float[Tensor, 'points classes']:
        """Logits, float32."""
        logits: Tensor = self.linear(features)
        return logits.float()

    def loss(self, logits: Float[Tensor, 'points classes'], labels: PointLabels) -> dict[str, Tensor]:
        """``loss_wsl``; 0, with a gradient of 0, where no point is labelled."""
        if self.annotated_share is None:
            weights = None if self.pseudo_weight == 1 else torch.where(labels.is_annotated, 1.0, self.pseudo_weight)
            return {'loss_wsl': self._mean(logits, labels.semantic, weights)}
        pseudo = ~labels.is_annotated & (labels.semantic >= 0)
        parts = [
            (share, part)
            for share, part in ((self.annotated_share, labels.is_annotated), (1 - self.annotated_share, pseudo))
            if part.any()
        ]
        if not parts:
            return {'loss_wsl': 0.0 * logits.sum()}
        terms = [share * self._mean(logits, labels.semantic.masked_fill(~part, UNLABELLED)) for share, part in parts]
        return {'loss_wsl': torch.stack(terms).sum() / sum(share for share, _ in parts)}

    def _mean(self, logits: Tensor, classes: Tensor, points: Tensor | None = None) -> Tensor:
        """Weighted mean over the points that have a class."""
        weights = None
        if self.balance == 'batch':
            weights = class_balance(classes, self.num_classes, self.power)
        elif self.balance == 'frequency':
            weights = frequency_weights(self.class_counts, self.power)
        mean: Tensor = self.loss_part(logits, classes, weights, points)
        return mean
