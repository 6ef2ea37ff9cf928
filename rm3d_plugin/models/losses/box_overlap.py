"""How well a box fits, learned from boxes whose overlap is known."""

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.heads.batch_labels import BatchLabels
from rm3d_plugin.models.losses.loss_term import LossTerm
from rm3d_plugin.models.outputs import DetectorOutput
from rm3d_plugin.registry import MODELS


def overlap_loss(logits: Float[Tensor, ' pairs'], ious: Float[Tensor, ' pairs']) -> Float[Tensor, '']:
    """Mean cross-entropy of expected and true overlap (its least value is their entropy, not 0); 0 for no pair."""
    each = F.binary_cross_entropy_with_logits(logits, ious, reduction='none')
    return each.sum() / max(each.numel(), 1)


@MODELS.register_module()
class BoxOverlap(LossTerm):
    """``loss_box_overlap`` of a detector with a :class:`~rm3d_plugin.models.heads.BoxIoUHead`.

    Args:
        loss_weight: Factor.
    """

    needs = ('fit_pairs',)

    def __init__(self, loss_weight: float = 1.0) -> None:
        super().__init__()
        self.loss_weight = loss_weight

    def forward(self, batch: Batch, outputs: DetectorOutput, labels: BatchLabels) -> dict[str, Tensor]:
        """``loss_box_overlap``."""
        assert labels.fit_pairs is not None
        return {'loss_box_overlap': self.loss_weight * overlap_loss(*labels.fit_pairs)}
