"""Kernel maps of batches that come again: scenes that are not augmented, or of which only the features change."""

import math
from hashlib import blake2b
from typing import Any

from cachetools import LRUCache
from jaxtyping import Int64
from torch import Tensor

from rm3d_plugin.ops.kernel_map import VoxelLevel

REMEMBERED = 4096  # coordinates seen once: kept as 16 bytes each


class LevelCache:
    """Levels by their coordinates, with every map that was made from them, up to a size in memory.

    Coordinates are kept from the second time on, so that those of an augmented scene, which never come again, push
    nothing out; the ones that were not asked for the longest go first.

    Args:
        megabytes: Most memory of the levels and their maps; 0 keeps none.
    """

    def __init__(self, megabytes: int) -> None:
        if megabytes < 0:
            raise ValueError(f'map_cache must be a size in megabytes, 0 for none, got {megabytes}')
        self.limit = megabytes * 2**20
        self._kept: LRUCache[bytes, VoxelLevel] = LRUCache(math.inf)  # levels grow while they are kept
        self._seen: LRUCache[bytes, None] = LRUCache(REMEMBERED)

    def __call__(self, coords: Int64[Tensor, 'voxels 4']) -> VoxelLevel:
        """The level of these coordinates, from the cache or made now.

        Raises:
            ValueError: As for :class:`~rm3d_plugin.ops.kernel_map.VoxelLevel`.
        """
        level = VoxelLevel(coords)
        if self.limit == 0:
            return level
        key = blake2b(level.keys.cpu().numpy().tobytes(), digest_size=16, key=str(coords.device).encode()).digest()
        self._shrink()
        if key in self._kept:
            return self._kept[key]
        if key in self._seen:
            self._kept[key] = level
        self._seen[key] = None
        return level

    def nbytes(self) -> int:
        """Memory of what is kept."""
        return sum(level.nbytes() for level in self._kept.values())

    def _shrink(self) -> None:
        """Maps are made while a level is in use, so sizes are looked at when the next one is asked for."""
        while self._kept and self.nbytes() > self.limit:
            self._kept.popitem()

    def __getstate__(self) -> dict[str, Any]:
        """A copy of a network, or one sent to another process, starts with an empty cache."""
        return {'limit': self.limit, '_kept': LRUCache(math.inf), '_seen': LRUCache(REMEMBERED)}
