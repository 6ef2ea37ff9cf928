"""L_Aug: predictions of a scene and of its augmented view agree (METHOD 7)."""

import math
from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from rm3d_plugin.models.losses.divergences import check_rows
from rm3d_plugin.models.losses.reduction import ReducedLoss
from rm3d_plugin.registry import MODELS


def js_divergence(
    logits: Float[Tensor, 'points classes'], other: Float[Tensor, 'points classes']
) -> Float[Tensor, ' points']:
    """Jensen-Shannon divergence between the softmax of two rows of logits.

    Natural logarithm: in [0, ln 2], symmetric, 0 only for equal distributions. Stays in log space, so that logits of
    a one-hot distribution have a finite gradient.

    Raises:
        ValueError: They are no two tables of one shape, (B, C, N) say.

    >>> import torch
    >>> js_divergence(torch.tensor([[0.0, 0.0]]), torch.tensor([[5.0, 5.0]])).item()
    0.0
    """
    check_rows(logits, other)
    log_p, log_q = logits.log_softmax(dim=1), other.log_softmax(dim=1)
    log_m = torch.logaddexp(log_p, log_q) - math.log(2.0)
    terms = log_p.exp() * (log_p - log_m) + log_q.exp() * (log_q - log_m)
    return (0.5 * terms.sum(dim=1)).clamp(0.0, math.log(2.0))


def js_aug_loss(logits: Float[Tensor, 'points classes'], other: Float[Tensor, 'points classes']) -> Float[Tensor, '']:
    """Mean Jensen-Shannon divergence; 0 for no points. The minus sign printed in the paper is a slip."""
    return js_divergence(logits, other).sum() / max(len(logits), 1)


def mse_aug_loss(logits: Float[Tensor, 'points classes'], other: Float[Tensor, 'points classes']) -> Float[Tensor, '']:
    """Mean squared difference of the class probabilities (the paper's ablation); 0 for no points."""
    return squared_differences(logits, other).sum() / max(logits.numel(), 1)


def squared_differences(
    logits: Float[Tensor, 'points classes'], other: Float[Tensor, 'points classes']
) -> Float[Tensor, 'points classes']:
    """Of the softmax of two rows of logits; raises as :func:`js_divergence` does."""
    check_rows(logits, other)
    return (logits.softmax(dim=1) - other.softmax(dim=1)).square()


class _AugLoss(ReducedLoss):
    """A weighted loss between two views of the same points.

    Args:
        loss_weight: Factor of the loss; larger: views agree more closely.
        reduction: 'mean', 'sum' or 'none'.
    """

    compare: Callable[[Tensor, Tensor], Tensor]

    def forward(
        self,
        logits: Float[Tensor, 'points classes'],
        logits_aug: Float[Tensor, 'points classes'],
        avg_factor: float | None = None,
    ) -> Float[Tensor, '...']:
        """Loss between rows of the same points; ``avg_factor`` as in mmdetection."""
        return self.weighted(self.compare(logits, logits_aug), avg_factor)


@MODELS.register_module()
class JSAugLoss(_AugLoss):
    """Weighted :func:`js_aug_loss`."""

    compare = staticmethod(js_divergence)


@MODELS.register_module()
class MSEAugLoss(_AugLoss):
    """Weighted :func:`mse_aug_loss`."""

    compare = staticmethod(squared_differences)
