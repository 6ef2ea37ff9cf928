"""Things that are costly to read or make again, kept in memory as long as there is room."""

from collections.abc import Callable
from typing import Any, Generic, TypeVar

from cachetools import LRUCache

Item = TypeVar('Item')


class RecentItems(Generic[Item]):
    """Items by key; the ones asked for longest ago are forgotten.

    Args:
        megabytes: Room for all items together; one that is larger than that is kept beside them until another is made.
            Larger: more memory, less reading.
        nbytes: Size of an item.
    """

    def __init__(self, megabytes: int, nbytes: Callable[[Item], int]) -> None:
        self._nbytes = nbytes
        self._kept: LRUCache[str, Item] = LRUCache(megabytes * 2**20, nbytes)
        self._large: dict[str, Item] = {}  # one at most

    def __len__(self) -> int:
        return len(self._kept) + len(self._large)

    def clear(self) -> None:
        """Forget everything."""
        self._kept.clear()
        self._large.clear()

    def get_or_make(self, key: str, make: Callable[[], Item]) -> Item:
        """The item of a key, from memory or else from ``make``; not to be written to."""
        for kept in (self._kept, self._large):
            if key in kept:
                return kept[key]
        self._large.clear()  # before there are two
        item = make()
        if self._nbytes(item) <= self._kept.maxsize:
            self._kept[key] = item
        else:
            self._large[key] = item
        return item

    def __getstate__(self) -> dict[str, Any]:
        """Empty: what is kept shall not travel to other processes."""
        return {'_nbytes': self._nbytes, '_kept': LRUCache(self._kept.maxsize, self._nbytes), '_large': {}}
