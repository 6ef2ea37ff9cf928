"""L_cls: which classes a scene holds (METHOD 7)."""

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from rm3d_plugin.models.losses.reduction import ReducedLoss
from rm3d_plugin.registry import MODELS


def scene_class_loss(
    logits: Float[Tensor, 'scenes classes'], present: Float[Tensor, 'scenes classes']
) -> Float[Tensor, '']:
    """Mean binary cross-entropy over scenes and classes; 0 for no scene. The paper's sign is a slip: this is positive.

    Args:
        logits: Log odds that a class is present.
        present: 1 where it is.
    """
    each = F.binary_cross_entropy_with_logits(logits, present, reduction='none')
    return each.sum() / max(each.numel(), 1)


@MODELS.register_module()
class SceneClassLoss(ReducedLoss):
    """Weighted :func:`scene_class_loss`.

    Args:
        loss_weight: Factor of the loss.
        reduction: 'mean', 'sum' or 'none' of scenes and classes.
    """

    def forward(
        self,
        logits: Float[Tensor, 'scenes classes'],
        present: Float[Tensor, 'scenes classes'],
        avg_factor: float | None = None,
    ) -> Float[Tensor, '...']:
        """Loss of the scenes of a batch; ``avg_factor`` as in mmdetection."""
        return self.weighted(F.binary_cross_entropy_with_logits(logits, present, reduction='none'), avg_factor)
