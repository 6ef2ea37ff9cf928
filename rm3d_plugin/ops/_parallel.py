"""Threads for numba kernels that release the interpreter lock.

Plain Python threads over fixed blocks instead of numba's ``prange``: the blocks never depend on the number of threads,
so neither does a result; and kernels compile in a fraction of the time that numba's parallel backend takes. A thread
takes the next block when it is done with one, and the calling thread works too: where another job holds a core, the
threads on the other cores do its share.
"""

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import copy_context
from functools import cache
from queue import Empty, SimpleQueue
from threading import Lock, Thread, local
from typing import Any, TypeVar

import numpy as np
import torch
from llvmlite import ir  # type: ignore[import-untyped]
from numba import config, types
from numba.extending import intrinsic
from torch.utils.data import get_worker_info

Result = TypeVar('Result')
Array = np.ndarray[Any, Any]
AHEAD = 2  # blocks for each thread that wait to be taken
_chosen: int | None = None
_helper = local()  # ``busy`` in a thread that already is one of several


def set_threads(count: int) -> None:
    """The one place where this process gets its threads: ``count`` for our kernels, one for torch's own operations.

    Torch's OpenMP threads are left out on purpose. They split even the smallest addition evenly, and wait for each
    other spinning: where another job holds a core, everything waits for the part on that core. With one torch thread
    there is nothing to wait for, and the kernels that take the time share their blocks as threads get free.
    """
    global _chosen
    if count < 1:
        raise ValueError(f'threads must be at least 1, got {count}')
    _chosen = count
    config.NUMBA_NUM_THREADS = count
    torch.set_num_threads(1)


def free_cores() -> int:
    """Cores that this process may use: its share, where a launcher started several on this machine."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count() or 1
    return max(1, cores // int(os.environ.get('LOCAL_WORLD_SIZE', '1')))


def num_threads() -> int:
    """Threads of the kernels under the networks: :func:`set_threads`, else torch's; 1 in a data loader's worker."""
    if get_worker_info() is not None:
        return 1
    return _chosen or torch.get_num_threads()


def map_blocks(work: Callable[[int, int], Result], total: int, block: int) -> list[Result]:
    """Call ``work(start, stop)`` for consecutive blocks of ``range(total)``; results in the order of the blocks.

    No thread outlives the call, so a process may fork afterwards (a data loader's worker, say). All threads have
    the caller's context variables.

    Args:
        work: Releases the interpreter lock to run in parallel (``@njit(nogil=True)``).
        total: Number of items.
        block: Items in a block; the last one may be shorter.

    Returns:
        One result a block. ``NUMBA_NUM_THREADS`` bounds the threads; a thread of another call asks no others for help.
    """
    spans = _spans(total, block)
    helpers = _threads_for(spans) - 1
    if helpers < 1:
        return [work(start, stop) for start, stop in spans]
    turns = iter(list(enumerate(spans)))
    results: dict[int, Result] = {}

    def take() -> None:
        with _several():
            try:
                for turn, span in turns:
                    results[turn] = work(*span)
            except BaseException:
                deque(turns, maxlen=0)  # nobody takes another block
                raise

    with ThreadPoolExecutor(helpers) as pool:
        helping = [pool.submit(copy_context().run, take) for _ in range(helpers)]
        take()
        for future in helping:
            future.result()
    return [results[turn] for turn in range(len(spans))]


def map_ahead(work: Callable[[int, int], Result], total: int, block: int) -> Iterator[Result]:
    """As :func:`map_blocks`, one result at a time; the threads go on with the next few while it is being used.

    The threads end when the iterator is exhausted or closed.
    """
    spans = _spans(total, block)
    threads = _threads_for(spans)
    if threads <= 1:
        yield from (work(start, stop) for start, stop in spans)
        return
    waiting: deque[Future[Result]] = deque()
    with ThreadPoolExecutor(threads, initializer=lambda: setattr(_helper, 'busy', True)) as pool:
        try:
            for start, stop in spans:
                waiting.append(pool.submit(work, start, stop))
                if len(waiting) > AHEAD * threads:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            pool.shutdown(cancel_futures=True)


def _spans(total: int, block: int) -> list[tuple[int, int]]:
    return [(start, min(start + block, total)) for start in range(0, total, block)]


def _threads_for(spans: list[tuple[int, int]]) -> int:
    return 1 if getattr(_helper, 'busy', False) else min(int(config.NUMBA_NUM_THREADS), len(spans))


@contextmanager
def _several() -> Iterator[None]:
    """Within, this thread is one of several, and asks no others for help."""
    _helper.busy = True
    try:
        yield
    finally:
        _helper.busy = False


def each_block(work: Callable[[Array], object], blocks: int, least: int = 1) -> None:
    """Work through numbered blocks, by as many threads as :func:`num_threads`; for short and frequent calls.

    Args:
        work: Called once in each thread with ``turns``: it handles block :func:`take_turn` of them until that is no
            longer below ``blocks``. Must release the interpreter lock, and write to places of the block's own only.
        blocks: Number of blocks.
        least: Blocks that are worth a thread: to call one costs about a tenth of a millisecond.
    """
    turns = np.zeros(1, np.int64)
    helpers = min(num_threads(), blocks // least) - 1
    team = _team(os.getpid())
    if helpers < 1 or not team.free.acquire(blocking=False):
        work(turns)
        return
    try:
        team.help(lambda: work(turns), helpers)
    finally:
        team.free.release()


class _Team:
    """Threads that wait for a job and do it along with the caller."""

    def __init__(self) -> None:
        self.free = Lock()  # whoever finds it taken works alone
        self.size = 0
        self.jobs: SimpleQueue[Callable[[], object]] = SimpleQueue()
        self.ended: SimpleQueue[BaseException | None] = SimpleQueue()

    def help(self, job: Callable[[], object], helpers: int) -> None:
        while self.size < helpers:
            Thread(target=self._serve, daemon=True, name=f'rm3d-{self.size}').start()
            self.size += 1
        for _ in range(helpers):
            self.jobs.put(job)
        errors = [_error_of(job)]
        for _ in range(helpers):
            try:
                self.jobs.get_nowait()  # nobody has got a core for it yet, and nothing is left to do: taken back
            except Empty:
                errors.append(self.ended.get())
        for error in errors:
            if error is not None:
                raise error

    def _serve(self) -> None:
        while True:
            self.ended.put(_error_of(self.jobs.get()))


def _error_of(job: Callable[[], object]) -> BaseException | None:
    try:
        job()
    except BaseException as error:
        return error
    return None


@cache
def _team(process: int) -> _Team:
    """One team per process: threads do not survive a fork."""
    return _Team()


@intrinsic
def take_turn(_: Any, turns: Any) -> Any:
    """``turns[0]``, raised by one for whoever asks next, in whatever thread."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        return builder.atomic_rmw('add', data, ir.Constant(ir.IntType(64), 1), 'monotonic')

    return types.int64(turns), codegen
