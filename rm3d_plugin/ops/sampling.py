"""Furthest point sampling."""

import numpy as np
import torch
from jaxtyping import Float, Int
from numba import njit
from torch import Tensor


@njit(cache=True)
def _furthest(xyz, count):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    n = len(xyz)
    chosen = np.empty(count, np.int64)
    gap = np.full(n, np.inf)
    current = 0
    for i in range(count):
        chosen[i] = current
        gap[current] = -1.0  # never again, even among duplicates
        best, following = -1.0, 0
        for j in range(n):
            if gap[j] < 0.0:
                continue
            dx = xyz[j, 0] - xyz[current, 0]
            dy = xyz[j, 1] - xyz[current, 1]
            dz = xyz[j, 2] - xyz[current, 2]
            gap[j] = min(gap[j], dx * dx + dy * dy + dz * dz)
            if gap[j] > best:
                best, following = gap[j], j
        current = following
    return chosen


def _furthest_torch(xyz: Tensor, count: int) -> Tensor:
    chosen = torch.empty(count, dtype=torch.int64, device=xyz.device)
    gap = torch.full((len(xyz),), float('inf'), dtype=torch.float64, device=xyz.device)
    current = torch.zeros((), dtype=torch.int64, device=xyz.device)
    for i in range(count):
        chosen[i] = current
        gap = torch.minimum(gap, (xyz - xyz[current]).square().sum(1)).index_fill(0, current.reshape(1), -1.0)
        current = (gap == gap.max()).to(torch.uint8).argmax()  # the first of equals
    return chosen


def furthest_point_sample(xyz: Float[Tensor, 'points 3'], count: int) -> Int[Tensor, ' chosen']:
    """Choose points one by one, each the furthest from those chosen before; the first is point 0.

    Args:
        xyz: Coordinates in metres.
        count: How many to choose; all points where there are fewer.

    Returns:
        min(count, N) different point numbers in the order of choice; ties go to the lowest number.

    Raises:
        ValueError: ``count`` is negative or a coordinate is not finite.
    """
    if count < 0:
        raise ValueError(f'furthest_point_sample: count must not be negative, got {count}')
    xyz = xyz.detach().double()
    if not bool(torch.isfinite(xyz).all()):
        raise ValueError('furthest_point_sample: a coordinate is NaN or infinite; drop such points first')
    count = min(count, len(xyz))
    if xyz.device.type != 'cpu':
        return _furthest_torch(xyz, count)
    return torch.from_numpy(_furthest(np.ascontiguousarray(xyz.numpy()), count))


def furthest_point_sample_batch(
    xyz: Float[Tensor, 'points 3'], batch_offsets: Int[Tensor, ' scenes_and_one'], count: int
) -> tuple[Int[Tensor, ' chosen'], Int[Tensor, ' scenes_and_one']]:
    """Furthest point sampling of every scene of a batch by itself.

    Returns:
        Row numbers of the whole batch, and the offsets of each scene among them.
    """
    bounds = [int(v) for v in batch_offsets.tolist()]
    rows = [furthest_point_sample(xyz[a:b], count) + a for a, b in zip(bounds[:-1], bounds[1:], strict=True)]
    lengths = torch.tensor([0] + [len(r) for r in rows], device=xyz.device)
    empty = torch.zeros(0, dtype=torch.int64, device=xyz.device)
    return torch.cat(rows) if rows else empty, lengths.cumsum(0)
