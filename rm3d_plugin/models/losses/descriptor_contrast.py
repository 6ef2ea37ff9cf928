"""Contrast between descriptors: the same place is near, places apart are far (METHOD 3, Contrastive)."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from rm3d_plugin.models.losses.contrastive import contrastive_loss

_TINY = 1e-12  # under a root, whose slope would be infinite at 0


def distances(
    first: Float[Tensor, 'first channels'], second: Float[Tensor, 'second channels']
) -> Float[Tensor, 'first second']:
    """Euclidean distances between the rows of two tables."""
    square = first.square().sum(1)[:, None] + second.square().sum(1)[None] - 2 * first @ second.T
    return square.clamp_min(_TINY).sqrt()


def place_distances(
    first: Float[Tensor, 'first 3'], second: Float[Tensor, 'second 3']
) -> Float[Tensor, 'first second']:
    """As :func:`distances`, without its cancellation where coordinates are large; no gradient is asked of it."""
    return torch.cdist(first, second, compute_mode='donot_use_mm_for_euclid_dist')


def row_distances(
    first: Float[Tensor, 'pairs channels'], second: Float[Tensor, 'pairs channels']
) -> Float[Tensor, ' pairs']:
    """Euclidean distance of each pair of rows."""
    return (first - second).square().sum(1).clamp_min(_TINY).sqrt()


def nearest_apart(gaps: Float[Tensor, 'first second'], apart: Bool[Tensor, 'first second']) -> Float[Tensor, ' first']:
    """The least distance of each row to one that is apart; infinite where there is none."""
    if not gaps.numel():
        return gaps.new_full((len(gaps),), torch.inf)
    return gaps.masked_fill(~apart, torch.inf).amin(1)


def triplet_loss(
    anchors: Float[Tensor, 'pairs channels'],
    positives: Float[Tensor, 'pairs channels'],
    apart: Bool[Tensor, 'pairs pairs'],
    margin: float = 0.5,  # METHOD 3: rho of L_TriC
) -> Float[Tensor, '']:
    """L_TriC: mean of max(|a - p| - |a - n| + margin, 0) over the positives of all pairs that lie apart as n.

    The paper leaves open which negatives are drawn. The nearest alone let all descriptors become one; here every
    negative counts, and the mean is over those that cost something, as most soon cost nothing (Hermans et al. 2017).

    Args:
        anchors: Descriptors of places.
        positives: Of the same places in the other crop.
        apart: Which places are far enough to be told apart.
        margin: Larger: pushes further apart.

    Returns:
        0 where nothing lies apart.

    >>> import torch
    >>> a = torch.tensor([[0.0, 0.0], [1.0, 0.0]])
    >>> round(triplet_loss(a, a + torch.tensor([0.0, 0.3]), ~torch.eye(2, dtype=torch.bool), 1.0).item(), 3)
    0.256
    """
    gaps = distances(anchors, positives)
    costs = (row_distances(anchors, positives)[:, None] - gaps + margin).clamp_min(0.0) * apart
    return costs.sum() / (costs > 0).sum().clamp_min(1)


def pair_loss(
    anchors: Float[Tensor, 'pairs channels'],
    positives: Float[Tensor, 'pairs channels'],
    apart: Bool[Tensor, 'pairs pairs'],
    tau: float = 1.0,  # METHOD 3
) -> Float[Tensor, '']:
    """L_C: mean over positive and negative pairs of d^2, and of max(tau - d, 0)^2; a negative for each positive.

    Args:
        anchors: As for :func:`triplet_loss`, as the others.
        positives: See there.
        apart: See there.
        tau: Distance from which a negative pair costs nothing.
    """
    negative = nearest_apart(distances(anchors, positives), apart)
    found = negative.isfinite()
    pull = row_distances(anchors, positives).square()
    push = torch.where(found, (tau - negative).clamp_min(0.0), 0.0).square()
    return (pull.sum() + push.sum()) / (len(pull) + found.sum()).clamp_min(1)


def hardest_contrastive_loss(
    anchors: Float[Tensor, 'pairs channels'],
    positives: Float[Tensor, 'pairs channels'],
    apart: Bool[Tensor, 'pairs pairs'],
    positive_margin: float = 0.1,
    negative_margin: float = 1.4,
) -> Float[Tensor, '']:
    """Hardest contrastive loss (Choy et al., Fully Convolutional Geometric Features, ICCV 2019).

    mean relu(d_p^2 - positive_margin) + mean relu(negative_margin - d_n)^2, d_n to the nearest negative, the mean of
    both directions. The first term is not squared once more, the second is.

    Args:
        anchors: As for :func:`triplet_loss`, as the next two.
        positives: See there.
        apart: See there; symmetric.
        positive_margin: Squared distance up to which a positive pair costs nothing.
        negative_margin: Distance from which a negative one costs nothing.
    """
    gaps = distances(anchors, positives)
    pull = (row_distances(anchors, positives).square() - positive_margin).clamp_min(0.0)
    pushes = []
    for nearest in (nearest_apart(gaps, apart), nearest_apart(gaps.T, apart.T)):
        pushes.append(_mean_where((negative_margin - nearest).clamp_min(0.0).square(), nearest.isfinite()))
    return pull.sum() / max(len(pull), 1) + torch.stack(pushes).mean()


def info_nce_loss(
    anchors: Float[Tensor, 'pairs channels'],
    positives: Float[Tensor, 'pairs channels'],
    apart: Bool[Tensor, 'pairs pairs'],
    temperature: float = 0.1,
) -> Float[Tensor, '']:
    """PointInfoNCE (Xie et al., PointContrast, ECCV 2020); negatives lie apart; the mean of both directions.

    Args:
        anchors: As for :func:`triplet_loss`, as the next two.
        positives: See there.
        apart: See there; symmetric.
        temperature: Smaller: near negatives count more.
    """
    there = contrastive_loss(anchors, positives, positives, temperature, ~apart)
    back = contrastive_loss(positives, anchors, anchors, temperature, ~apart.T)
    return (there.sum() + back.sum()) / max(2 * len(anchors), 1)


def _mean_where(values: Float[Tensor, ' rows'], known: Bool[Tensor, ' rows']) -> Float[Tensor, '']:
    return torch.where(known, values, 0.0).sum() / known.sum().clamp_min(1)
