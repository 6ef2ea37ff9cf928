"""Which points of an augmented view are compared with the scene."""

import zlib

import torch
from jaxtyping import Int
from torch import Tensor


def common_rows(aug_index: Int[Tensor, ' view'], count: int) -> Int[Tensor, ' rows']:
    """At most ``count`` different rows of the augmented view, drawn at random but the same for the same view.

    The generator is seeded by the view itself, so training draws nothing from the global generators and a resumed run
    continues bit for bit.

    Args:
        aug_index: The row of ``points`` of each augmented point.
        count: 1000 in METHOD 7.
    """
    seed = zlib.crc32(aug_index.cpu().contiguous().numpy().tobytes())
    order = torch.randperm(len(aug_index), generator=torch.Generator().manual_seed(seed))
    return order[:count].to(aug_index.device)
