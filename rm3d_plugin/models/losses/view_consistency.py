"""L_Aug: what the network says of a point does not depend on the view (METHOD 7)."""

from typing import Any

import torch
from torch import Tensor

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.consistency import common_rows
from rm3d_plugin.models.losses.loss_term import LossTerm
from rm3d_plugin.models.outputs import PointOutput
from rm3d_plugin.registry import MODELS


@MODELS.register_module()
class ViewConsistency(LossTerm):
    """``loss_aug``: classes of common points in the first and in each further view; absent where a batch has no view.

    Args:
        loss: Config of a loss of two rows of logits: ``JSAugLoss`` or ``MSEAugLoss``.
        num_points: Common points of each view that are compared.
    """

    needs = ('logits',)

    def __init__(self, loss: dict[str, Any] | None = None, num_points: int = 1000) -> None:  # METHOD 7: 1000
        super().__init__()
        self.loss = MODELS.build({'type': 'JSAugLoss', **(loss or {})})
        self.num_points = num_points

    def forward(self, batch: Batch, outputs: PointOutput, labels: Any) -> dict[str, Tensor]:
        """``loss_aug``, the mean over the views."""
        terms = []
        for view in batch.views:
            rows = common_rows(view.point_ids, self.num_points)
            terms.append(self.loss(outputs.logits[view.point_ids[rows]], view.logits(rows)))
        return {'loss_aug': torch.stack(terms).mean()} if terms else {}
