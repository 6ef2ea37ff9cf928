"""Contrastive losses between rows of features: which pairs are alike, which rows are negatives, which are left out."""

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor


def contrastive_loss(
    anchors: Float[Tensor, 'anchors channels'],
    positives: Float[Tensor, 'anchors channels'],
    negatives: Float[Tensor, 'negatives channels'],
    temperature: float,
    excluded: Bool[Tensor, 'anchors negatives'] | None = None,
) -> Float[Tensor, ' anchors']:
    """``-log exp(a.p / T) / (exp(a.p / T) + sum_j exp(a.n_j / T))`` for each anchor, over the negatives that count.

    With the positives of all other anchors as negatives (``negatives=positives``, the diagonal excluded) it is
    PointInfoNCE; CSC excludes pairs by their place, GPC those of one class.

    Args:
        anchors: Features; made unit vectors here, as the next two.
        positives: Of each anchor.
        negatives: Of the batch, or of a bank; there may be none.
        temperature: T; smaller: near negatives count more.
        excluded: Pairs that are no negatives; None: all are.

    >>> rows, own = torch.eye(2), torch.eye(2, dtype=torch.bool)
    >>> contrastive_loss(rows, rows, rows, temperature=1.0, excluded=own).round(decimals=4)
    tensor([0.3133, 0.3133])
    """
    anchors, positives, negatives = (
        F.normalize(rows.to(torch.promote_types(rows.dtype, torch.float32)), dim=1)
        for rows in (anchors, positives, negatives)
    )
    alike = (anchors * positives).sum(dim=1, keepdim=True)
    apart = anchors @ negatives.T
    if excluded is not None:
        apart = apart.masked_fill(excluded, -torch.inf)
    scores = torch.cat([alike, apart], dim=1) / temperature
    return torch.logsumexp(scores, dim=1) - scores[:, 0]
