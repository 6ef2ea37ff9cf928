"""DGNet's losses as parts of a model's list."""

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor

from rm3d_plugin.baselines.dgnet.losses import KAPPA, STEPS, fit_mixture, mixture_losses, truncated
from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.consistency import PrototypeBank, group_means, training_progress
from rm3d_plugin.models.heads import PointLabels
from rm3d_plugin.models.losses import LossTerm, ReducedLoss, Reduction
from rm3d_plugin.models.losses.point_cross_entropy import weighted_cross_entropy
from rm3d_plugin.models.outputs import PointOutput
from rm3d_plugin.registry import MODELS


@MODELS.register_module()
class TruncatedCrossEntropyLoss(ReducedLoss):
    """Cross-entropy, :func:`truncated` from ``start`` on; called as ``PointCrossEntropyLoss`` is.

    Args:
        limit: Probability of the right class above which a point teaches nothing.
        start: Share of training after which that holds: 50 of 100 epochs.
        loss_weight: Factor of the loss.
        reduction: 'mean' over the weights, 'sum' or 'none' of the points.
    """

    def __init__(
        self, limit: float = 0.8, start: float = 0.5, loss_weight: float = 1.0, reduction: Reduction = 'mean'
    ) -> None:
        super().__init__(loss_weight, reduction)
        self.limit, self.start = limit, start

    def forward(
        self,
        logits: Float[Tensor, 'points classes'],
        labels: Int[Tensor, ' points'],
        class_weights: Float[Tensor, ' classes'] | None = None,
        point_weights: Float[Tensor, ' points'] | None = None,
    ) -> Float[Tensor, '...']:
        """Loss over the labelled points; 0 where there are none.

        Args:
            logits: Raw class scores.
            labels: Class numbers; -1 = unlabelled.
            class_weights: Weight of each class; 1 when not given.
            point_weights: Further factor of each point; 1 when not given.
        """
        plain = weighted_cross_entropy(logits, labels).loss
        weight = weighted_cross_entropy(logits, labels, class_weights, point_weights=point_weights).weight
        each = plain if training_progress() < self.start else truncated(plain, self.limit)
        return self.weighted(weight * each, None, weight.sum().clamp_min(1e-6))


@MODELS.register_module()
class DGNetLoss(LossTerm):
    """``loss_vmf``, ``loss_agreement`` and ``loss_means``.

    The mixture is fitted to the features of each batch, from the means of its labelled points; for a class that has
    none there, from the mean over the batches before.

    Args:
        num_classes: C.
        channels: Features of the backbone.
        kappa: See :func:`fit_mixture`.
        steps: See :func:`fit_mixture`.
        momentum: Of the means over the batches.
    """

    needs = ('features', 'logits', 'semantic')

    def __init__(
        self,
        num_classes: int,
        channels: int,
        kappa: float = KAPPA,
        steps: int = STEPS,
        momentum: float = 0.9,
    ) -> None:
        super().__init__()
        self.bank = PrototypeBank(num_classes, channels, momentum)
        self.kappa, self.steps = kappa, steps

    def forward(self, batch: Batch, outputs: PointOutput, labels: PointLabels) -> dict[str, Tensor]:
        """The three losses; none where a batch is empty, or while no class was seen."""
        unit = F.normalize(outputs.features.float(), dim=1)
        self.bank.update(unit.detach(), labels.semantic)
        present = self.bank.present[:, 0]
        if len(unit) == 0 or not present.any():
            return {}
        fitted = fit_mixture(unit.detach(), self._start(unit, labels.semantic), present, self.kappa, self.steps)
        found = mixture_losses(unit, outputs.logits, fitted, self.kappa)
        names = ('loss_vmf', 'loss_agreement', 'loss_means')
        return dict(zip(names, found, strict=True))

    def _start(self, unit: Tensor, classes: Tensor) -> Tensor:
        """Unit vectors of the classes: of this batch, else of those before."""
        kept = self.bank.values[:, 0]
        here = group_means(unit.detach(), classes, len(kept))
        return F.normalize(torch.where(here.present[:, None], here.means, kept), dim=1)
