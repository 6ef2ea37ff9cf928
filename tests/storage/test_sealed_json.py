"""JSON with a hash, and the version before it."""

import json
import os
import time

import numpy as np
import pytest

from rm3d_plugin.storage import DamagedFileError, SceneCache, read_sealed, write_json, write_sealed
from rm3d_plugin.storage.files import remove_unfinished

FIRST = {'round': 1, 'losses': {'1': 0.1 + 0.2, '2': float('nan')}, 'name': 'Gebäude'}


def test_what_was_written_comes_back_and_equal_content_gives_equal_bytes(tmp_path):
    path = write_sealed(tmp_path / 'metrics.json', FIRST)
    assert read_sealed(path) == {**FIRST, 'losses': {'1': 0.1 + 0.2, '2': None}}
    other = write_sealed(tmp_path / 'other' / 'metrics.json', dict(FIRST))
    assert path.read_bytes() == other.read_bytes() and len(json.loads(path.read_text())['sha256']) == 64
    with pytest.raises(ValueError, match="'sha256' cannot name a value"):
        write_sealed(path, {'sha256': 1})


@pytest.mark.parametrize('damage', ['cut', 'altered', 'list', 'empty'])
def test_a_damaged_file_gives_way_to_the_one_before_it(tmp_path, damage):
    path = tmp_path / 'metrics.json'
    write_sealed(path, FIRST | {'round': 1}, keep_previous=True)
    write_sealed(path, FIRST | {'round': 2}, keep_previous=True)
    text = path.read_text()
    path.write_text(
        {'cut': text[:40], 'altered': text.replace('"round": 2', '"round": 3'), 'list': '[]'}.get(damage, '')
    )
    with pytest.warns(UserWarning, match=r'metrics\.json: .*metrics\.previous\.json, the version before it, is read'):
        assert read_sealed(path)['round'] == 1
    write_sealed(path, FIRST | {'round': 4}, keep_previous=True)  # the damaged one does not replace the whole one
    assert read_sealed(path)['round'] == 4 and read_sealed(tmp_path / 'metrics.previous.json')['round'] == 1
    for each in tmp_path.iterdir():
        each.write_text('{"round": ')
    with pytest.warns(UserWarning, match='version before it'), pytest.raises(DamagedFileError, match='previous'):
        read_sealed(path)


def test_a_damaged_file_alone_is_named_and_one_without_hash_is_taken(tmp_path):
    path = tmp_path / 'current.json'
    with pytest.raises(FileNotFoundError):
        read_sealed(path)
    write_json(path, {'round': 7})
    assert read_sealed(path) == {'round': 7}
    path.write_text(path.read_text()[:5])
    with pytest.raises(DamagedFileError, match=r'current\.json: not readable as JSON'):
        read_sealed(path)


def test_files_have_the_mode_of_the_umask(tmp_path):
    before = os.umask(0o027)
    try:
        path = write_sealed(tmp_path / 'a.json', FIRST)
    finally:
        os.umask(before)
    assert path.stat().st_mode & 0o777 == 0o640


def test_stale_temporary_files_go_and_fresh_ones_stay(tmp_path):
    old, fresh = tmp_path / '.a.npz.11.ab12cd34.tmp', tmp_path / '.b.npz.12.ab12cd34.tmp'
    for path in (old, fresh):
        path.write_bytes(b'half')
    os.utime(old, (time.time() - 2 * 86_400,) * 2)
    SceneCache(tmp_path).get_or_make('key', lambda: {'a': np.zeros(3)})
    assert not old.exists() and fresh.exists()
    remove_unfinished(tmp_path, '*')
    assert sorted(path.name for path in tmp_path.iterdir()) == ['key.npz']
