"""Sharing blocks among threads: each once, errors told, whoever is busy is not waited for."""

import threading

import numpy as np
import pytest
import torch
from numba import config, njit

from rm3d_plugin.ops import _parallel
from rm3d_plugin.ops._parallel import each_block, map_ahead, map_blocks, num_threads, set_threads, take_turn


@pytest.fixture(autouse=True)
def threads_as_before(monkeypatch):
    monkeypatch.setattr(config, 'NUMBA_NUM_THREADS', config.NUMBA_NUM_THREADS)
    monkeypatch.setattr(_parallel, '_chosen', None)
    yield
    torch.set_num_threads(1)


@njit(nogil=True)
def count(turns, hits):
    turn = take_turn(turns)
    while turn < len(hits):
        hits[turn] += 1
        turn = take_turn(turns)


@pytest.mark.parametrize('threads', [1, 2, 5])
def test_each_block_is_worked_once(threads):
    set_threads(threads)
    for blocks in (0, 1, 2, 1000):
        hits = np.zeros(blocks, np.int64)
        for _ in range(20):
            each_block(lambda turns, hits=hits: count(turns, hits), blocks)
        assert (hits == 20).all()


def test_few_blocks_are_not_worth_a_thread():
    set_threads(3)
    names = []
    each_block(lambda turns: names.append(threading.current_thread().name), blocks=7, least=8)
    assert names == [threading.main_thread().name]


def test_an_error_of_any_thread_is_raised_and_the_threads_go_on():
    set_threads(2)
    barrier = threading.Barrier(2, timeout=10)

    def fails_in_the_helper(turns):
        barrier.wait()
        if threading.current_thread() is not threading.main_thread():
            raise ValueError('helper')

    for _ in range(2):
        with pytest.raises(ValueError, match='helper'):
            each_block(fails_in_the_helper, 2)


def test_a_call_inside_a_call_works_alone():
    set_threads(2)
    inner = np.zeros(4, np.int64)

    def outer(turns):
        if threading.current_thread() is threading.main_thread():
            each_block(lambda own: count(own, inner), 4)

    each_block(outer, 2)
    assert (inner == 1).all()


def test_one_place_sets_all_threads():
    set_threads(3)
    assert (num_threads(), torch.get_num_threads(), config.NUMBA_NUM_THREADS) == (3, 1, 3)
    with pytest.raises(ValueError, match='at least 1'):
        set_threads(0)


def test_processes_of_a_launcher_share_the_cores(monkeypatch):
    monkeypatch.delenv('LOCAL_WORLD_SIZE', raising=False)
    cores = _parallel.free_cores()
    monkeypatch.setenv('LOCAL_WORLD_SIZE', '2')
    assert _parallel.free_cores() == max(1, cores // 2)


@pytest.mark.parametrize('threads', [1, 3])
def test_blocks_come_in_order_and_a_few_are_worked_ahead(threads, monkeypatch):
    monkeypatch.setattr(config, 'NUMBA_NUM_THREADS', threads)
    begun = []

    def work(start, stop):
        begun.append(start)
        return start, stop

    assert list(map_ahead(work, 25, 10)) == map_blocks(work, 25, 10) == [(0, 10), (10, 20), (20, 25)]
    assert list(map_ahead(work, 0, 10)) == []
    begun.clear()
    results = map_ahead(work, 1000, 1)
    assert next(results) == (0, 1)
    results.close()
    assert len(begun) <= 1 + (_parallel.AHEAD * threads if threads > 1 else 0)
    assert not any(thread.name.startswith('ThreadPoolExecutor') for thread in threading.enumerate())


def test_an_error_in_a_block_reaches_the_caller(monkeypatch):
    monkeypatch.setattr(config, 'NUMBA_NUM_THREADS', 2)

    def work(start, stop):
        if start == 3:
            raise ValueError('block 3')
        return start

    for share in (map_blocks, map_ahead):
        with pytest.raises(ValueError, match='block 3'):
            list(share(work, 10, 1))


def test_a_helper_asks_for_no_help(monkeypatch):
    monkeypatch.setattr(config, 'NUMBA_NUM_THREADS', 2)

    def inner(start, stop):
        return threading.get_ident()

    def outer(start, stop):
        return set(map_blocks(inner, 8, 1)) == {threading.get_ident()}

    assert all(map_blocks(outer, 4, 1))
