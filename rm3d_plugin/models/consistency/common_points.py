"""Which points of a view are compared with the scene."""

import zlib

import torch
from jaxtyping import Int
from torch import Tensor


def common_rows(point_ids: Int[Tensor, ' view'], count: int) -> Int[Tensor, ' rows']:
    """At most ``count`` different rows of a view that the first view shows, too.

    The generator is seeded by the view itself, so training draws nothing from the global generators and a resumed run
    continues bit for bit. Points of which the first view has no copy are left out.

    Args:
        point_ids: The row of the first view's points that each point of the view is, or -1.
        count: 1000 in METHOD 7.
    """
    seed = zlib.crc32(point_ids.cpu().contiguous().numpy().tobytes())
    order = torch.randperm(len(point_ids), generator=torch.Generator().manual_seed(seed)).to(point_ids.device)
    return order[point_ids[order] >= 0][:count]
