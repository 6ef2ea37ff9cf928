"""Guided point contrast: pseudo labels say which points are no negatives (Jiang et al., ICCV 2021)."""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.consistency import BankRows, MemoryBank, View, common_rows
from rm3d_plugin.models.heads import PointLabels
from rm3d_plugin.models.losses import LossTerm, contrastive_loss
from rm3d_plugin.models.outputs import PointOutput
from rm3d_plugin.registry import MODELS


class Side(NamedTuple):
    """Points as one of two views has them.

    Attributes:
        features: (M, D) projected.
        classes: (M,) pseudo class; the label where there is one.
        confidence: (M,) of it; 1 where there is a label.
    """

    features: Float[Tensor, 'points channels']
    classes: Int[Tensor, ' points']
    confidence: Float[Tensor, ' points']


def side_of(
    features: Float[Tensor, 'points channels'], logits: Float[Tensor, 'points classes'], known: Int[Tensor, ' points']
) -> Side:
    """Pseudo classes of points, without gradients; labels take their place.

    Args:
        features: Projected.
        logits: Of the same points.
        known: Labels; -1 = none.
    """
    sure, said = logits.detach().softmax(dim=1).max(dim=1)
    return Side(features, torch.where(known >= 0, known, said), torch.where(known >= 0, 1.0, sure))


def balanced_rows(classes: Int[Tensor, ' points'], count: int) -> Int[Tensor, ' rows']:
    """At most so many different rows, each class being as likely; by torch's generator."""
    if len(classes) == 0:
        return classes
    often = torch.bincount(classes)[classes].float()
    return torch.multinomial(1.0 / often, min(count, len(classes)))


def guided_loss(
    anchors: Side, others: Side, negatives: BankRows, temperature: float, threshold: float
) -> Float[Tensor, '']:
    """Contrastive loss of one direction, over the points of whose class the other view is sure.

    Args:
        anchors: Points in the view that learns.
        others: The same points in the other view, which gets no gradient.
        negatives: Of earlier batches; those of the anchor's class are left out.
        temperature: T.
        threshold: Least confidence of the other view.
    """
    alike: Bool[Tensor, 'anchors negatives'] = anchors.classes[:, None] == negatives.classes
    each = contrastive_loss(anchors.features, others.features.detach(), negatives.features, temperature, alike)
    counts = others.confidence >= threshold
    return (each * counts).sum() / counts.sum().clamp_min(1)


@MODELS.register_module()
class GuidedContrast(LossTerm):
    """``loss_guided``: the sum of both directions, for each further view; its points go into the bank afterwards.

    Args:
        in_channels: Features of the backbone.
        num_classes: C, as the logits have them.
        channels: Of the projection that is compared.
        anchors: Points of each direction, drawn so that each pseudo class is as likely.
        negatives: Drawn from the bank for all anchors together.
        bank: Features of each class that are kept.
        put: Most features of a class that a view adds.
        temperature: Smaller: near negatives count more.
        threshold: Least confidence of the other view.
        weight: Factor of the loss.
    """

    needs = ('features', 'logits', 'semantic')

    def __init__(
        self,
        in_channels: int,
        num_classes: int,
        channels: int = 32,
        anchors: int = 1000,
        negatives: int = 10000,
        bank: int = 10000,
        put: int = 1000,
        temperature: float = 0.1,
        threshold: float = 0.75,
        weight: float = 0.1,
    ) -> None:
        super().__init__()
        self.project = nn.Linear(in_channels, channels)
        self.bank = MemoryBank(num_classes, channels, bank)
        self.anchors, self.negatives, self.put = anchors, negatives, put
        self.temperature, self.threshold, self.weight = temperature, threshold, weight

    def forward(self, batch: Batch, outputs: PointOutput, labels: PointLabels) -> dict[str, Tensor]:
        """The mean over the views; nothing where a batch has none."""
        terms = [self._compare(view, outputs, labels.semantic) for view in batch.views]
        return {'loss_guided': self.weight * torch.stack(terms).mean()} if terms else {}

    def _compare(self, view: View, outputs: PointOutput, semantic: Int[Tensor, ' points']) -> Tensor:
        rows = common_rows(view.point_ids, len(view.point_ids))
        points = view.point_ids[rows]
        known = semantic[points]
        first = side_of(self.project(outputs.features[points]), outputs.logits[points], known)
        second = side_of(self.project(view.features[rows]), view.logits(rows), known)
        negatives = self.bank.draw(self.negatives)
        loss = self._direction(first, second, negatives) + self._direction(second, first, negatives)
        for side in (first, second):
            self.bank.put(side.features, side.classes, self.put)
        return loss

    def _direction(self, learning: Side, other: Side, negatives: BankRows) -> Tensor:
        rows = balanced_rows(learning.classes, self.anchors)
        anchors, others = (Side(*(values[rows] for values in side)) for side in (learning, other))
        return guided_loss(anchors, others, negatives, self.temperature, self.threshold)
