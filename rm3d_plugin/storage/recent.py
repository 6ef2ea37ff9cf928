"""Things that are costly to read or make again, kept in memory as long as there is room."""

from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Generic, TypeVar

Item = TypeVar('Item')


class RecentItems(Generic[Item]):
    """Items by key; the ones asked for longest ago are forgotten.

    Args:
        megabytes: Room for all items together; one that is larger than that is not kept. Larger: more memory, less
            reading.
        nbytes: Size of an item.
    """

    def __init__(self, megabytes: int, nbytes: Callable[[Item], int]) -> None:
        self._limit = megabytes * 2**20
        self._nbytes = nbytes
        self._kept: OrderedDict[str, Item] = OrderedDict()
        self._used = 0

    def __len__(self) -> int:
        return len(self._kept)

    def get_or_make(self, key: str, make: Callable[[], Item]) -> Item:
        """The item of a key, from memory or else from ``make``; not to be written to."""
        if key not in self._kept:
            item = make()
            self._kept[key] = item
            self._used += self._nbytes(item)
            while self._used > self._limit:
                self._used -= self._nbytes(self._kept.popitem(last=False)[1])
            return item
        self._kept.move_to_end(key)
        return self._kept[key]

    def __getstate__(self) -> dict[str, Any]:
        """Empty: what is kept shall not travel to other processes."""
        return {'_limit': self._limit, '_nbytes': self._nbytes, '_kept': OrderedDict(), '_used': 0}
