"""Features of a class lie close to its prototype: the relations that labels travel along (OTOC, CVPR 2021)."""

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.consistency import PrototypeBank
from rm3d_plugin.models.heads import PointLabels
from rm3d_plugin.models.losses import LossTerm
from rm3d_plugin.models.outputs import PointOutput
from rm3d_plugin.registry import MODELS

TEMPERATURE = 0.07


def prototype_contrast(
    similarity: Float[Tensor, 'points classes'], classes: Int[Tensor, ' points'], temperature: float = TEMPERATURE
) -> Float[Tensor, '']:
    """Cross-entropy of the softmax over cosines to prototypes, the mean over points; 0 for none.

    Args:
        similarity: Cosines; -inf for a class without a prototype.
        classes: From 0; each has a prototype.
        temperature: Smaller: features of a class draw closer together.
    """
    return F.cross_entropy(similarity / temperature, classes, reduction='sum') / max(len(classes), 1)


@MODELS.register_module()
class PrototypeRelation(LossTerm):
    """``loss_relation``, of the points with a label, which move their prototypes first.

    Args:
        num_classes: C.
        channels: Features of the backbone.
        momentum: See :class:`PrototypeBank`.
        temperature: See :func:`prototype_contrast`.
    """

    needs = ('features', 'semantic')

    def __init__(
        self, num_classes: int, channels: int, momentum: float = 0.9, temperature: float = TEMPERATURE
    ) -> None:
        super().__init__()
        self.bank = PrototypeBank(num_classes, channels, momentum)
        self.temperature = temperature

    def forward(self, batch: Batch, outputs: PointOutput, labels: PointLabels) -> dict[str, Tensor]:
        """``loss_relation``."""
        rows = torch.nonzero(labels.semantic >= 0).flatten()
        features, classes = outputs.features[rows], labels.semantic[rows]
        self.bank.update(F.normalize(features.detach().float(), dim=1), classes)
        return {'loss_relation': prototype_contrast(self.bank.similarity(features), classes, self.temperature)}
