"""What was computed of the last few scenes, kept in memory: a data set of few scenes meets each of them every epoch."""

from collections.abc import Callable
from typing import Any

import numpy as np
from cachetools import LRUCache

from rm3d_plugin.storage.files import content_key


class RecentArrays:
    """Arrays by the content they depend on; the ones asked for longest ago are forgotten.

    Args:
        size: How many to keep. Larger: more memory, fewer repetitions.
    """

    def __init__(self, size: int = 16) -> None:
        if size < 1:
            raise ValueError(f'RecentArrays: expected size >= 1, got {size}')
        self._kept: LRUCache[str, np.ndarray] = LRUCache(size)

    @classmethod
    def shared(cls, kind: str, size: int) -> 'RecentArrays':
        """One memory for all who compute the same from the same content: the pipelines of training and of predicting.

        Args:
            kind: Names what is computed, with its settings.
            size: At least so many are kept.
        """
        found = _SHARED.setdefault(kind, cls(size))
        if found.size < size:
            wider: LRUCache[str, np.ndarray] = LRUCache(size)
            wider.update(found._kept)
            found._kept = wider
        return found

    @property
    def size(self) -> int:
        """How many are kept at most."""
        return int(self._kept.maxsize)

    def __len__(self) -> int:
        return len(self._kept)

    def get_or_make(self, content: np.ndarray, make: Callable[[], np.ndarray]) -> np.ndarray:
        """The array made of ``content``, from memory or else from ``make``; not to be written to."""
        key = content_key('recent', content)
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def __getstate__(self) -> dict[str, Any]:
        """Empty: what is kept shall not travel to other processes."""
        return {'_kept': LRUCache(self.size)}


_SHARED: dict[str, RecentArrays] = {}
