"""Pseudo labels from prototypes that learn together with the network (ERDA, NeurIPS 2023)."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.consistency import PrototypeBank
from rm3d_plugin.models.heads import PointLabels
from rm3d_plugin.models.losses import LossTerm, soft_cross_entropy
from rm3d_plugin.models.outputs import PointOutput
from rm3d_plugin.registry import MODELS


def erda_loss(
    similarity: Float[Tensor, 'points classes'], logits: Float[Tensor, 'points classes']
) -> Float[Tensor, '']:
    """Cross-entropy of what the network says with the pseudo label q, the softmax of the similarities; 0 for no points.

    It is entropy(q) + KL(q || p): q becomes sure, and both become alike. The gradient goes through q and p; a detached
    q would leave plain self-training.

    Args:
        similarity: Cosines to the prototypes; -inf for a class without one.
        logits: Of the network.
    """
    return soft_cross_entropy(logits, similarity.softmax(dim=1)).sum() / max(len(logits), 1)


@MODELS.register_module()
class ERDALoss(LossTerm):
    """``loss_erda``, of the points without a label; none until a labelled point was seen.

    Args:
        num_classes: C.
        channels: Features of the backbone, and of their projection.
        weight: 0.01 in most released settings; 0.1 with full supervision.
        momentum: See :class:`PrototypeBank`.
    """

    needs = ('features', 'logits', 'semantic')

    def __init__(self, num_classes: int, channels: int, weight: float = 0.01, momentum: float = 0.999) -> None:
        super().__init__()
        self.project = nn.Sequential(nn.Linear(channels, channels), nn.ReLU(), nn.Linear(channels, channels))
        self.bank = PrototypeBank(num_classes, channels, momentum)
        self.weight = weight

    def forward(self, batch: Batch, outputs: PointOutput, labels: PointLabels) -> dict[str, Tensor]:
        """``loss_erda``; the labelled points move their prototypes first."""
        projected = self.project(outputs.features.float())
        self.bank.update(projected.detach(), labels.semantic)
        if not self.bank.present.any():
            return {}
        rest = torch.nonzero(labels.semantic < 0).flatten()
        value = erda_loss(self.bank.similarity(projected[rest]), outputs.logits[rest])
        return {'loss_erda': self.weight * value}
