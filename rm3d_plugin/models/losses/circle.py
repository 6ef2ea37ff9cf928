"""Circle loss between descriptors, and balanced cross entropy of scores (METHOD 3, Predator)."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits, softplus


def circle_loss(
    gaps: Float[Tensor, 'first second'],
    positive: Bool[Tensor, 'first second'],
    negative: Bool[Tensor, 'first second'],
    scale: float = 24.0,  # METHOD 3
    positive_margin: float = 0.1,
    negative_margin: float = 1.4,
) -> Float[Tensor, '']:
    """Circle loss (Sun et al., CVPR 2020) over the rows and over the columns, as Predator has it.

    A row costs ``softplus(lse(s w_p (d - m_p)) + lse(s w_n (m_n - d))) / s`` over its positives and its negatives. The
    weights ``w_p = max(d - m_p, 0)`` and ``w_n = max(m_n - d, 0)`` have no gradient: what is far from its margin pulls
    harder. The mean is over the rows (columns) with a positive and a negative; then of both.

    Args:
        gaps: Distances of descriptors.
        positive: Which pairs show the same place.
        negative: Which show places apart; pairs that are neither do not count.
        scale: Larger: the hardest pairs alone count.
        positive_margin: Distance up to which a positive costs nothing.
        negative_margin: Distance from which a negative costs nothing.
    """
    pull = scale * (gaps - positive_margin).detach().clamp_min(0.0) * (gaps - positive_margin)
    push = scale * (negative_margin - gaps).detach().clamp_min(0.0) * (negative_margin - gaps)
    sides = [_side(pull, push, positive, negative), _side(pull.T, push.T, positive.T, negative.T)]
    return torch.stack(sides).mean() / scale


def _side(pull: Tensor, push: Tensor, positive: Tensor, negative: Tensor) -> Float[Tensor, '']:
    rows = positive.any(1) & negative.any(1)
    terms = [
        part[rows].masked_fill(~mask[rows], -torch.inf).logsumexp(1)
        for part, mask in ((pull, positive), (push, negative))
    ]
    return softplus(terms[0] + terms[1]).sum() / rows.sum().clamp_min(1)


def balanced_bce(logits: Float[Tensor, ' rows'], target: Bool[Tensor, ' rows']) -> Float[Tensor, '']:
    """Binary cross entropy in which the rarer answer weighs as much as the other: each by the other's share.

    >>> import torch
    >>> round(balanced_bce(torch.zeros(4), torch.tensor([True, False, False, False])).item(), 4)
    0.2599
    """
    share = target.float().mean() if len(target) else torch.zeros((), device=logits.device)
    weight = torch.where(target, 1 - share, share)
    each = binary_cross_entropy_with_logits(logits, target.to(logits.dtype), weight=weight, reduction='sum')
    return each / max(len(target), 1)
