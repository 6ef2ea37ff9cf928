"""The shape of a group of points in a few numbers, so that a small head need not discover second moments."""

import torch
from jaxtyping import Float, Int
from torch import Tensor

SHAPE_CHANNELS = 8
_EPS = 1e-4  # square metres over square radii: 1 cm spread at 1 m radius


def group_shape(
    local: Float[Tensor, 'groups members 3'], weights: Float[Tensor, 'groups members']
) -> Float[Tensor, 'groups shape']:
    """Weighted mean and spread of each group, seen from above; rotates with the group.

    Args:
        local: Points relative to the group's anchor, in units of the grouping radius.
        weights: How far each point belongs to the group, 0 where there is none.

    Returns:
        Mean (3); direction of the longest spread as the cosine and sine of twice its angle, scaled by how elongated
        the group is (0 round, 1 a line); longest and shortest spread in the plane, and the spread in height. Zeros for
        an empty group. Without gradient.
    """
    local, share = local.detach(), weights.detach() / weights.detach().sum(dim=1, keepdim=True).clamp_min(1e-6)
    mean = (local * share[..., None]).sum(dim=1)
    rest = local - mean[:, None]
    xx, yy, zz = (rest.square() * share[..., None]).sum(dim=1).unbind(dim=1)
    xy = (rest[..., 0] * rest[..., 1] * share).sum(dim=1)
    half, skew = 0.5 * (xx + yy), torch.hypot(0.5 * (xx - yy), xy)
    cosine, sine = 0.5 * (xx - yy) / (half + _EPS), xy / (half + _EPS)
    spreads = torch.stack([half + skew, half - skew, zz], dim=1).clamp_min(0.0).sqrt()
    return torch.cat([mean, torch.stack([cosine, sine], dim=1), spreads], dim=1)


def membership(
    votes: Float[Tensor, 'groups members 3'],
    foreground: Float[Tensor, 'groups members'],
    index: Int[Tensor, 'groups members'],
) -> Float[Tensor, 'groups members']:
    """How far points belong to the object of their group: foreground probability, less the further the vote.

    Args:
        votes: Relative to the anchor, in units of the grouping radius; a third of it is one standard deviation.
        foreground: Predicted probability.
        index: -1 where a group has no such member.
    """
    return foreground * torch.exp(-0.5 * (3.0 * votes).square().sum(dim=2)) * (index >= 0)
