"""Which points vote for proposals."""

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rm3d_plugin.ops.sampling import furthest_point_sample

_CANDIDATES = 16  # times the number of seeds: bounds the cost of furthest point sampling near the sensor


def choose_seeds(
    xyz: Float[Tensor, 'points 3'],
    foreground: Float[Tensor, ' points'],
    batch_offsets: Int[Tensor, ' scenes_and_one'],
    count: int,
    threshold: float,
) -> tuple[Int[Tensor, ' seeds'], Int[Tensor, ' scenes_and_one']]:
    """Points that are likely foreground and spread in space.

    Of each scene, the points of at least ``threshold`` foreground probability compete (the likeliest ``count`` where
    those are fewer, the likeliest 16 ``count`` where they are more), and furthest point sampling picks ``count`` of
    them: a near car of thousands of returns does not crowd out a far one of twenty.

    Args:
        xyz: Metres.
        foreground: In [0, 1].
        batch_offsets: Rows of the scenes.
        count: Seeds a scene; all points of a scene that has fewer.
        threshold: In [0, 1].

    Returns:
        Point rows of the batch, and the rows of the scenes among them. Equal probabilities: the lowest row first.
    """
    foreground = foreground.detach()
    chosen, lengths = [torch.zeros(0, dtype=torch.int64, device=xyz.device)], [0]
    bounds = [int(v) for v in batch_offsets.tolist()]
    for a, b in zip(bounds[:-1], bounds[1:], strict=True):
        score = foreground[a:b]
        likely = int((score >= threshold).sum())
        order = score.sort(descending=True, stable=True).indices[: min(max(likely, count), _CANDIDATES * count)]
        picked = order[furthest_point_sample(xyz[a:b][order], count)]
        chosen.append(picked + a)
        lengths.append(len(picked))
    return torch.cat(chosen), torch.tensor(lengths, device=xyz.device).cumsum(0)
