"""From the loss of each row to what a caller asked for, by mmdetection's words: ``reduction`` and ``avg_factor``."""

from typing import Literal, get_args

from jaxtyping import Float
from torch import Tensor, nn

Reduction = Literal['mean', 'sum', 'none']


def reduce_loss(
    each: Float[Tensor, '*rows'],
    reduction: Reduction,
    avg_factor: float | Tensor | None = None,
    total: float | Tensor | None = None,
) -> Float[Tensor, '...']:
    """Sum, mean or the rows as they are.

    Args:
        each: Loss of each row.
        reduction: What is wanted.
        avg_factor: What the sum is divided by in a mean; with 'none' it is of no effect, as in mmdetection.
        total: The same where the caller names none; None: the number of rows. No rows: the mean is 0.

    Raises:
        ValueError: ``avg_factor`` with ``reduction='sum'``.

    >>> import torch
    >>> [reduce_loss(torch.tensor([1.0, 3.0]), 'mean', factor).item() for factor in (None, 8.0)]
    [2.0, 0.5]
    """
    if reduction == 'none':
        return each
    if avg_factor is not None and reduction == 'sum':
        raise ValueError("avg_factor: expected None with reduction='sum', as a sum is divided by nothing")
    if reduction == 'sum':
        return each.sum()
    rows = max(each.numel(), 1) if total is None else total
    return each.sum() / (rows if avg_factor is None else avg_factor)


class ReducedLoss(nn.Module):
    """Base of the losses that compare tensors.

    Args:
        loss_weight: Factor of the loss.
        reduction: 'mean', 'sum', or 'none': the loss of each row.

    Raises:
        ValueError: Another reduction.
    """

    def __init__(self, loss_weight: float = 1.0, reduction: Reduction = 'mean') -> None:
        super().__init__()
        if reduction not in get_args(Reduction):
            choices = ', '.join(get_args(Reduction))
            raise ValueError(f'{type(self).__name__}.reduction: expected one of {choices}, got {reduction!r}')
        self.loss_weight = loss_weight
        self.reduction: Reduction = reduction

    def weighted(
        self, each: Tensor, avg_factor: float | Tensor | None, total: float | Tensor | None = None
    ) -> Float[Tensor, '...']:
        """:func:`reduce_loss` times the weight."""
        return self.loss_weight * reduce_loss(each, self.reduction, avg_factor, total)
