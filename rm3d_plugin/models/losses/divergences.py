"""How far two predictions of the same points lie apart, by the conventions of different publications.

Repositories differ in factors, in whether classes are summed or averaged, and in what they add to a probability before
its logarithm: a frequent reason why a method cannot be reproduced. Here a convention is a row of a table. Everything
is computed in log space, in float32.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from rm3d_plugin.models.losses.reduction import ReducedLoss, Reduction
from rm3d_plugin.registry import MODELS

Kind = Literal['js', 'kl', 'generalised_kl', 'l2']
Logs = Float[Tensor, 'points classes']


@dataclass(frozen=True)
class Convention:
    """How a repository writes a divergence.

    Attributes:
        kind: 'js': sum of p log(p / m) + q log(q / m), m the mean of both; 'kl': p log(p / q); 'generalised_kl':
            p log(p / q) - p + q; 'l2': squared differences. p is the first prediction, q the other.
        classes: Whether terms are summed over the classes or averaged.
        eps: Added to a probability before its logarithm; with 'generalised_kl' to the probability itself.
        factor: Of the whole.
    """

    kind: Kind
    classes: Literal['sum', 'mean'] = 'sum'
    eps: float = 0.0
    factor: float = 1.0


CONVENTIONS: dict[str, Convention] = {
    'rm3d': Convention('js', factor=0.5),  # METHOD 7
    'psd': Convention('js', 'mean', eps=1e-4),  # Zhang et al., ICCV 2021
    'cpcm': Convention('js', eps=1e-4),  # Liu et al., ICCV 2023
    'rac_net': Convention('kl'),  # Wu et al., IJCV 2024
    'lidal': Convention('generalised_kl', eps=1e-5),  # Hu et al., ECCV 2022
    'xu_lee': Convention('l2'),  # Xu and Lee, CVPR 2020; its weight, 10, is a loss_weight
}


def divergence(
    logits: Float[Tensor, 'points classes'], other: Float[Tensor, 'points classes'], convention: Convention
) -> Float[Tensor, ' points']:
    """Of the softmax of two rows of logits, for each point.

    Raises:
        ValueError: They are no two tables of one shape, (B, C, N) say.

    >>> half = torch.zeros(1, 2)
    >>> divergence(half, torch.tensor([[0.0, 30.0]]), CONVENTIONS['xu_lee']).item()
    0.5
    """
    check_rows(logits, other)
    terms = _TERMS[convention.kind](logits.float().log_softmax(1), other.float().log_softmax(1), convention.eps)
    over_classes = terms.sum(dim=1) if convention.classes == 'sum' else terms.mean(dim=1)
    return convention.factor * over_classes


def soft_cross_entropy(
    logits: Float[Tensor, 'points classes'], target: Float[Tensor, 'points classes']
) -> Float[Tensor, ' points']:
    """``-sum target log p``, for each point; gradients flow to both."""
    check_rows(logits, target)
    return -(target.float() * logits.float().log_softmax(dim=1)).sum(dim=1)


def check_rows(logits: Tensor, other: Tensor) -> None:
    """Raise a ValueError unless both are one row a point and one column a class."""
    if logits.ndim != 2 or logits.shape != other.shape:
        raise ValueError(
            f'logits of two views: expected (points, classes) twice, got {tuple(logits.shape)} and '
            f'{tuple(other.shape)}; rows are points: logits.transpose(1, 2).flatten(0, 1) makes them of (B, C, N)'
        )


def _raised(logs: Logs, eps: float) -> Logs:
    """``log(p + eps)``."""
    return logs if eps == 0 else torch.logaddexp(logs, logs.new_tensor(math.log(eps)))


def _js(log_p: Logs, log_q: Logs, eps: float) -> Logs:
    log_m = _raised(torch.logaddexp(log_p, log_q) - math.log(2.0), eps)
    return log_p.exp() * (_raised(log_p, eps) - log_m) + log_q.exp() * (_raised(log_q, eps) - log_m)


def _kl(log_p: Logs, log_q: Logs, eps: float) -> Logs:
    return log_p.exp() * (_raised(log_p, eps) - _raised(log_q, eps))


def _generalised_kl(log_p: Logs, log_q: Logs, eps: float) -> Logs:
    log_p, log_q = _raised(log_p, eps), _raised(log_q, eps)
    return log_p.exp() * (log_p - log_q) - log_p.exp() + log_q.exp()


def _l2(log_p: Logs, log_q: Logs, eps: float) -> Logs:
    return (log_p.exp() - log_q.exp()).square()


_TERMS: dict[Kind, Callable[[Logs, Logs, float], Logs]] = {
    'js': _js,
    'kl': _kl,
    'generalised_kl': _generalised_kl,
    'l2': _l2,
}


@MODELS.register_module()
class DivergenceLoss(ReducedLoss):
    """Weighted :func:`divergence`, for ``ViewConsistency(loss=dict(type='DivergenceLoss', convention='psd'))``.

    Args:
        convention: Key of :data:`CONVENTIONS`.
        loss_weight: Factor of the loss; larger: views agree more closely.
        reduction: 'mean', 'sum' or 'none' of the points.

    Raises:
        ValueError: There is no such convention.
    """

    def __init__(self, convention: str, loss_weight: float = 1.0, reduction: Reduction = 'mean') -> None:
        super().__init__(loss_weight, reduction)
        if convention not in CONVENTIONS:
            raise ValueError(f'DivergenceLoss.convention: expected one of {", ".join(CONVENTIONS)}, got {convention!r}')
        self.convention = CONVENTIONS[convention]

    def forward(
        self,
        logits: Float[Tensor, 'points classes'],
        logits_aug: Float[Tensor, 'points classes'],
        avg_factor: float | None = None,
    ) -> Float[Tensor, '...']:
        """Loss between rows of the same points; ``avg_factor`` as in mmdetection."""
        return self.weighted(divergence(logits, logits_aug, self.convention), avg_factor)
