"""Which scene comes when; told so that an item knows its epoch."""

import math
from collections.abc import Iterator, Sized

import numpy as np
from jaxtyping import Int
from mmengine.dist import get_dist_info
from torch.utils.data import Sampler

from rm3d_plugin.registry import DATA_SAMPLERS


def epoch_order(
    length: int, seed: int, epoch: int, shuffle: bool = True, rank: int = 0, world_size: int = 1, round_up: bool = True
) -> Int[np.ndarray, ' items']:
    """Indices that one process visits in one epoch.

    Args:
        length: Scenes of the data set.
        seed: The same in all processes.
        epoch: Another epoch, another order.
        shuffle: False: ascending.
        rank: Of this process.
        world_size: Number of processes.
        round_up: Repeat the first scenes until every process has equally many.

    Returns:
        int64 indices; over all ranks each scene comes once, but for those repeated by ``round_up``.
    """
    order = np.random.default_rng([seed, epoch]).permutation(length) if shuffle else np.arange(length)
    if round_up and length:
        order = np.resize(order, math.ceil(length / world_size) * world_size)
    return order[rank::world_size]


@DATA_SAMPLERS.register_module()
class EpochSampler(Sampler[int]):
    """Yields ``epoch * len(dataset) + index`` in an order that seed and epoch alone decide.

    Nothing has to be saved to resume: mmengine's DistSamplerSeedHook calls ``set_epoch``.

    Args:
        dataset: Decodes the numbers, see :class:`SceneDataset`.
        seed: Of the order; None (mmengine passes it where ranks shall differ) counts as 0, since ranks must agree here.
        shuffle: False: ascending.
        round_up: Repeat the first scenes until every process has equally many.
    """

    def __init__(self, dataset: Sized, seed: int | None = 0, shuffle: bool = True, round_up: bool = True) -> None:
        self.dataset = dataset
        self.seed = seed or 0
        self.shuffle = shuffle
        self.round_up = round_up
        self.rank, self.world_size = get_dist_info()
        self.epoch = 0

    def __iter__(self) -> Iterator[int]:
        length = len(self.dataset)
        order = epoch_order(
            length, self.seed, self.epoch, self.shuffle, self.rank, self.world_size, round_up=self.round_up
        )
        return iter((self.epoch * length + order).tolist())

    def __len__(self) -> int:
        shorter, left = divmod(len(self.dataset), self.world_size)
        return shorter + (left > 0 if self.round_up else self.rank < left)

    def set_epoch(self, epoch: int) -> None:
        """Choose the epoch that the next iteration goes through."""
        self.epoch = epoch
