"""L_WSL: classes of points, learned from annotated and pseudo labels (METHOD 7)."""

from typing import Any, Literal, get_args

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.losses.loss_term import LossTerm
from rm3d_plugin.models.losses.point_cross_entropy import class_weights
from rm3d_plugin.models.outputs import PointOutput
from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import UNLABELLED

Balance = Literal['none', 'frequency', 'batch']


@MODELS.register_module()
class WeakSupervision(LossTerm):
    """``loss_wsl``: cross-entropy over the labelled points; 0, with a gradient of 0, where a batch has none.

    Args:
        loss: Config of a loss, called as ``PointCrossEntropyLoss`` is.
        balance: Rare classes count more: 'none'; 'frequency': by the annotated labels of the whole training set
            (:class:`LabelStatistics`); 'batch': by the labels of each batch.
        power: How much more: weight of a class = count^-power. 0.5: inverse square root; larger: rarer classes gain.
        pseudo_weight: Weight of a label that the budget did not show, against 1 of an annotated one; smaller: trusts
            pseudo labels less.
        confidence_power: Weight of a label = its confidence ^ this; 0: all labels alike; larger: unsure ones teach
            less.
        annotated_share: In (0, 1): share of L_WSL that the mean over annotated labels has, however few they are; that
            over pseudo labels has the rest. Larger: trusts pseudo labels less. None: all labels are averaged together.
    """

    def __init__(
        self,
        loss: dict[str, Any] | None = None,
        balance: Balance = 'none',
        power: float = 0.5,
        pseudo_weight: float = 1.0,
        annotated_share: float | None = None,
        confidence_power: float = 0.0,
    ) -> None:
        super().__init__()
        if balance not in get_args(Balance):
            raise ValueError(f'WeakSupervision.balance: expected one of {get_args(Balance)}, got {balance!r}')
        if pseudo_weight < 0:
            raise ValueError(f'WeakSupervision.pseudo_weight: expected 0 or more, got {pseudo_weight}')
        if annotated_share is not None and not 0 < annotated_share < 1:
            raise ValueError(
                f'WeakSupervision.annotated_share: expected a share between 0 and 1, or None, got {annotated_share}'
            )
        self.loss = MODELS.build({'type': 'PointCrossEntropyLoss', **(loss or {})})
        self.balance, self.power, self.pseudo_weight, self.annotated_share = (
            balance, power, pseudo_weight, annotated_share,
        )  # fmt: skip
        told = ('class_counts',) if balance == 'frequency' else ()
        parts = () if pseudo_weight == 1 and annotated_share is None else ('is_annotated',)
        unsure = () if confidence_power == 0 else ('confidence',)
        self.confidence_power = confidence_power
        self.needs = ('logits', 'semantic', *told, *parts, *unsure)

    def forward(self, batch: Batch, outputs: PointOutput, labels: Any) -> dict[str, Tensor]:
        """``loss_wsl``."""
        if self.annotated_share is not None:
            return {'loss_wsl': self._shared(outputs.logits, labels, self.annotated_share)}
        weights = None if self.pseudo_weight == 1 else torch.where(labels.is_annotated, 1.0, self.pseudo_weight)
        return {'loss_wsl': self._mean(outputs.logits, labels.semantic, labels, weights)}

    def _shared(self, logits: Tensor, labels: Any, share: float) -> Tensor:
        """Annotated and pseudo labels averaged apart; where a batch has one kind only, that has all."""
        pseudo: Bool[Tensor, ' points'] = ~labels.is_annotated & (labels.semantic >= 0)
        kinds = [(part, kind) for part, kind in ((share, labels.is_annotated), (1 - share, pseudo)) if kind.any()]
        if not kinds:
            return 0.0 * logits.sum()
        terms = [
            part * self._mean(logits, labels.semantic.masked_fill(~kind, UNLABELLED), labels) for part, kind in kinds
        ]
        return torch.stack(terms).sum() / sum(part for part, _ in kinds)

    def _mean(
        self,
        logits: Float[Tensor, 'points classes'],
        classes: Int[Tensor, ' points'],
        labels: Any,
        points: Float[Tensor, ' points'] | None = None,
    ) -> Tensor:
        """Weighted mean over the points that have a class."""
        weights = None
        if self.balance == 'batch':
            counts = torch.bincount(classes[classes >= 0], minlength=logits.shape[1])
            weights = class_weights(counts, self.power)
        elif self.balance == 'frequency':
            weights = class_weights(labels.class_counts, self.power)
        if self.confidence_power and labels.confidence is not None:
            sure = labels.confidence.pow(self.confidence_power)
            points = sure if points is None else sure * points
        mean: Tensor = self.loss(logits, classes, weights, points)
        return mean
