"""Threads for numba kernels that release the interpreter lock.

Plain Python threads over fixed blocks instead of numba's ``prange``: the blocks never depend on the number of threads,
so neither does a result; no thread outlives a call, so a process may fork afterwards (a data loader's worker, say); and
kernels compile in a fraction of the time that numba's parallel backend takes.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from numba import config

Result = TypeVar('Result')


def map_blocks(work: Callable[[int, int], Result], total: int, block: int) -> list[Result]:
    """Call ``work(start, stop)`` for consecutive blocks of ``range(total)``; results in the order of the blocks.

    Args:
        work: Releases the interpreter lock to run in parallel (``@njit(nogil=True)``).
        total: Number of items.
        block: Items in a block; the last one may be shorter.

    Returns:
        One result a block. ``NUMBA_NUM_THREADS`` bounds the threads.
    """
    spans = [(start, min(start + block, total)) for start in range(0, total, block)]
    threads = min(int(config.NUMBA_NUM_THREADS), len(spans))
    if threads <= 1:
        return [work(start, stop) for start, stop in spans]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(lambda span: work(*span), spans))
