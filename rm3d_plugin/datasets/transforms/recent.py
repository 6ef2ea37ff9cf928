"""What was computed of the last few scenes, kept in memory: a data set of few scenes meets each of them every epoch."""

from collections import OrderedDict
from collections.abc import Callable
from typing import Any

import numpy as np

from rm3d_plugin.storage.files import content_key


class RecentArrays:
    """Arrays by the content they depend on; the ones asked for longest ago are forgotten.

    Args:
        size: How many to keep. Larger: more memory, fewer repetitions.
    """

    def __init__(self, size: int = 16) -> None:
        if size < 1:
            raise ValueError(f'RecentArrays: expected size >= 1, got {size}')
        self.size = size
        self._kept: OrderedDict[str, np.ndarray] = OrderedDict()

    @classmethod
    def shared(cls, kind: str, size: int) -> 'RecentArrays':
        """One memory for all who compute the same from the same content: the pipelines of training and of predicting.

        Args:
            kind: Names what is computed, with its settings.
            size: At least so many are kept.
        """
        found = _SHARED.setdefault(kind, cls(size))
        found.size = max(found.size, size)
        return found

    def __len__(self) -> int:
        return len(self._kept)

    def get_or_make(self, content: np.ndarray, make: Callable[[], np.ndarray]) -> np.ndarray:
        """The array made of ``content``, from memory or else from ``make``; not to be written to."""
        key = content_key('recent', content)
        if key not in self._kept:
            self._kept[key] = make()
            if len(self._kept) > self.size:
                self._kept.popitem(last=False)
        self._kept.move_to_end(key)
        return self._kept[key]

    def __getstate__(self) -> dict[str, Any]:
        """Empty: what is kept shall not travel to other processes."""
        return {'size': self.size, '_kept': OrderedDict()}


_SHARED: dict[str, RecentArrays] = {}
