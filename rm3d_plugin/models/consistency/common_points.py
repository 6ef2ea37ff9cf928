"""Which points of a view are compared with the scene."""

import zlib

import torch
from jaxtyping import Int
from torch import Tensor


def common_rows(point_ids: Int[Tensor, ' view'], count: int) -> Int[Tensor, ' rows']:
    """At most ``count`` different rows of a view that the first view shows, too.

    They are drawn at random, but the same for the same view: its ids seed the generator. So training draws nothing from
    the global generators, and a resumed run continues bit for bit.

    Args:
        point_ids: The row of the first view's points that each point of the view is; -1: none.
        count: 1000 in METHOD 7.
    """
    seed = zlib.crc32(point_ids.cpu().contiguous().numpy().tobytes())
    shared = (point_ids >= 0).nonzero()[:, 0]
    order = torch.randperm(len(shared), generator=torch.Generator().manual_seed(seed))
    return shared[order[:count].to(shared.device)]
