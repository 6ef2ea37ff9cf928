"""A scene whose colours are hidden in places has the classes of the scene that is seen whole (CPCM, ICCV 2023)."""

from typing import Any

import torch
from torch import Tensor

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.losses import CONVENTIONS, LossTerm, divergence
from rm3d_plugin.models.outputs import PointOutput
from rm3d_plugin.registry import MODELS


@MODELS.register_module()
class MaskedConsistency(LossTerm):
    """``loss_masked``: the last view, masked, agrees with the first, and with the further view that is not masked.

    Where the plain and the masked view are no two, as in a batch without points, there is none.

    Args:
        weight: 5 or 10 in the released settings.
    """

    needs = ('logits',)

    def __init__(self, weight: float = 5.0) -> None:
        super().__init__()
        self.weight = weight

    def forward(self, batch: Batch, outputs: PointOutput, labels: Any) -> dict[str, Tensor]:
        """``loss_masked``; the gradient goes through the masked view alone."""
        if len(batch.views) < 2:
            return {}
        plain, masked = batch.views[0], batch.views[-1]
        hidden = masked.logits()  # of the points of the first view, in their order
        rows = torch.nonzero(plain.point_ids >= 0).flatten()
        same = divergence(hidden, outputs.logits.detach(), CONVENTIONS['cpcm'])
        other = divergence(hidden[plain.point_ids[rows]], plain.logits(rows).detach(), CONVENTIONS['cpcm'])
        return {'loss_masked': self.weight * (same.mean() + other.sum() / max(len(rows), 1))}
