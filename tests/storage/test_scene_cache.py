"""The cache makes once, notices damage, and survives company."""

import os

import numpy as np
import pytest

from rm3d_plugin.storage import SceneCache, read_npz


class Maker:
    def __init__(self):
        self.calls = 0

    def __call__(self):
        self.calls += 1
        return {'a': np.arange(1000), 'n': 3}


def test_made_once_and_equal_when_read(tmp_path):
    cache, make = SceneCache(tmp_path / 'cache'), Maker()
    first, second = cache.get_or_make('k', make), cache.get_or_make('k', make)
    assert make.calls == 1
    assert list(first) == list(second) == ['a', 'n']
    for name in first:
        np.testing.assert_array_equal(first[name], second[name], strict=True)
    cache.get_or_make('other', make)
    assert make.calls == 2


def test_a_damaged_file_is_named_and_made_again(tmp_path):
    cache, make = SceneCache(tmp_path), Maker()
    cache.get_or_make('scene-1', make)
    path = cache.path('scene-1')
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.warns(UserWarning, match=r'scene-1\.npz: cut off.*made again now'):
        again = cache.get_or_make('scene-1', make)
    assert make.calls == 2
    np.testing.assert_array_equal(again['a'], np.arange(1000))
    assert list(read_npz(path)) == ['a', 'n']
    cache.get_or_make('scene-1', make)
    assert make.calls == 2


def test_a_failing_maker_leaves_nothing(tmp_path):
    cache = SceneCache(tmp_path)
    with pytest.raises(ZeroDivisionError):
        cache.get_or_make('k', lambda: {'a': np.array(1 // 0)})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('key', ['', '../up', 'a/b', '.hidden', 'a b'])
def test_keys_must_be_file_names(tmp_path, key):
    with pytest.raises(ValueError, match='cannot be a file name'):
        SceneCache(tmp_path).path(key)


def test_processes_at_once_agree(tmp_path):
    cache = SceneCache(tmp_path)
    children = []
    for _ in range(6):
        child = os.fork()
        if child == 0:
            ok = all(
                (cache.get_or_make(f'k{i}', lambda i=i: {'a': np.full(2000, i)})['a'] == i).all() for i in range(15)
            )
            os._exit(0 if ok else 1)
        children.append(child)
    assert [os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) for child in children] == [0] * 6
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(f'k{i}.npz' for i in range(15))
