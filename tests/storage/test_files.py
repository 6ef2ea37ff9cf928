"""Atomic, hashed files: whole or not there, damaged ones told apart."""

import json
import os
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from rm3d_plugin.storage import files
from rm3d_plugin.storage.files import (
    DamagedFileError,
    content_key,
    hash_arrays,
    read_json,
    read_npz,
    write_json,
    write_npz,
    write_text,
)

ARRAYS = {
    'file': np.arange(6, dtype=np.int32).reshape(2, 3),  # numpy.savez could not take this name
    'values': np.array([0.5, np.nan, -0.0]),
    'flags': np.array([True, False]),
    'none': np.zeros((0, 3), dtype=np.float32),
    'text': np.array('bäume'),
    'fortran': np.asfortranarray(np.arange(6.0).reshape(2, 3)),
}


def test_npz_gives_back_names_types_shapes_and_bits(tmp_path):
    read = read_npz(write_npz(tmp_path / 'deep' / 'er' / 'a.npz', ARRAYS))
    assert list(read) == list(ARRAYS)
    for name, value in ARRAYS.items():
        assert read[name].dtype == value.dtype
        np.testing.assert_array_equal(read[name], value, strict=True)


def test_equal_arrays_give_equal_bytes(tmp_path):
    one, two = write_npz(tmp_path / 'a.npz', ARRAYS), write_npz(tmp_path / 'b.npz', ARRAYS)
    assert one.read_bytes() == two.read_bytes()


def test_numpy_itself_can_read_the_file(tmp_path):
    write_npz(tmp_path / 'a.npz', ARRAYS)
    with np.load(tmp_path / 'a.npz', allow_pickle=False) as archive:
        np.testing.assert_array_equal(archive['file'], ARRAYS['file'])


@pytest.mark.parametrize('name', ['', 'a/b', 'a\\b', '__sha256__', '__format__'])
def test_unusable_names_are_refused(tmp_path, name):
    with pytest.raises(ValueError, match='cannot name an array'):
        write_npz(tmp_path / 'a.npz', {name: np.zeros(1)})


def test_objects_are_refused_and_nothing_is_written(tmp_path):
    with pytest.raises(ValueError, match="'bad' holds Python objects"):
        write_npz(tmp_path / 'a.npz', {'bad': np.array([{}])})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('fraction', [0.0, 0.1, 0.5, 0.9, 0.999])
def test_a_cut_off_file_is_damaged(tmp_path, fraction):
    path = write_npz(tmp_path / 'cut.npz', ARRAYS)
    data = path.read_bytes()
    path.write_bytes(data[: int(fraction * len(data))])
    with pytest.raises(DamagedFileError, match=r'cut\.npz'):
        read_npz(path)


def test_no_flipped_byte_goes_unseen(tmp_path):
    path = write_npz(tmp_path / 'bits.npz', {'a': np.arange(50), 'b': np.array([1.5])})
    data = path.read_bytes()
    for at in range(0, len(data), 2):
        path.write_bytes(data[:at] + bytes([data[at] ^ (0x55, 0xFF, 0x01)[at // 2 % 3]]) + data[at + 1 :])
        try:
            read = read_npz(path)
        except DamagedFileError:
            continue
        # what zip does not use (a time stamp, say) may change; values may not
        np.testing.assert_array_equal(read['a'], np.arange(50), strict=True)
        np.testing.assert_array_equal(read['b'], np.array([1.5]), strict=True)


def test_changed_values_do_not_fit_the_hash(tmp_path):
    path = tmp_path / 'forged.npz'
    plain = {'a': np.arange(3), '__format__': np.array(1), '__sha256__': np.array(hash_arrays({'a': np.arange(4)}))}
    with path.open('wb') as file:
        files._zip(file, plain)
    with pytest.raises(DamagedFileError, match='do not fit their hash'):
        read_npz(path)


def test_files_of_others_and_of_other_versions_are_told_apart(tmp_path):
    np.savez(tmp_path / 'foreign.npz', a=np.arange(3))
    with pytest.raises(DamagedFileError, match='another program'):
        read_npz(tmp_path / 'foreign.npz')
    with (tmp_path / 'later.npz').open('wb') as file:
        files._zip(file, {'__format__': np.array(2), '__sha256__': np.array('')})
    with pytest.raises(DamagedFileError, match='format version 2, expected 1'):
        read_npz(tmp_path / 'later.npz')


def test_pickles_are_never_loaded(tmp_path):
    np.savez(tmp_path / 'pickle.npz', a=np.array([{'x': 1}], dtype=object))
    with pytest.raises(DamagedFileError, match=r'pickle\.npz'):
        read_npz(tmp_path / 'pickle.npz')


def test_a_zip_of_something_else_is_damaged(tmp_path):
    with zipfile.ZipFile(tmp_path / 'z.npz', 'w') as archive:
        archive.writestr('a.npy', b'hello')
    with pytest.raises(DamagedFileError, match=r'z\.npz'):
        read_npz(tmp_path / 'z.npz')


def test_a_missing_file_is_missing_not_damaged(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_npz(tmp_path / 'none.npz')
    with pytest.raises(FileNotFoundError):
        read_json(tmp_path / 'none.json')


# ---------------------------------------------------------------------- killed while writing


@pytest.mark.parametrize('step', ['replace', 'fsync'])
def test_an_error_before_the_rename_leaves_the_old_file_and_no_litter(tmp_path, monkeypatch, step):
    path = write_npz(tmp_path / 'a.npz', {'a': np.arange(3)})

    def fail(*_):
        raise OSError('disk full')

    with monkeypatch.context() as patch:
        patch.setattr(files.os, step, fail)
        with pytest.raises(OSError, match='disk full'):
            write_npz(path, {'a': np.arange(9)})
    np.testing.assert_array_equal(read_npz(path)['a'], np.arange(3))
    assert [p.name for p in tmp_path.iterdir()] == ['a.npz']


def test_an_error_while_writing_leaves_the_old_file(tmp_path):
    path = write_text(tmp_path / 'a.txt', 'old')

    def half(file):
        file.write(b'ne')
        raise RuntimeError('power')

    with pytest.raises(RuntimeError, match='power'):
        files.atomic_write(path, half)
    assert path.read_text() == 'old'
    assert [p.name for p in tmp_path.iterdir()] == ['a.txt']


def test_a_killed_process_leaves_the_old_file(tmp_path):
    path = write_npz(tmp_path / 'a.npz', {'a': np.arange(3)})
    child = os.fork()
    if child == 0:  # dies without any clean-up between writing and renaming
        files.os.replace = lambda *_: os._exit(9)
        write_npz(path, {'a': np.arange(9)})
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9
    np.testing.assert_array_equal(read_npz(path)['a'], np.arange(3))
    write_npz(path, {'a': np.arange(4)})
    np.testing.assert_array_equal(read_npz(path)['a'], np.arange(4))


def test_new_files_have_the_usual_permissions(tmp_path):
    plain = tmp_path / 'plain'
    plain.write_text('x')
    assert write_text(tmp_path / 'ours', 'x').stat().st_mode == plain.stat().st_mode


# ---------------------------------------------------------------------- JSON


def test_json_makes_numpy_plain_and_stays_valid(tmp_path):
    value = {'a': np.float32(0.5), 1: np.arange(2), 'nan': [np.nan, np.inf, -1.0], 'p': Path('x'), 'flag': np.True_}
    path = write_json(tmp_path / 'a.json', value)
    assert json.loads(path.read_text(), parse_constant=pytest.fail) == {
        'a': 0.5, '1': [0, 1], 'nan': [None, None, -1.0], 'p': 'x', 'flag': True,
    }  # fmt: skip


def test_broken_json_names_the_file(tmp_path):
    (tmp_path / 'b.json').write_text('{"a": ')
    with pytest.raises(DamagedFileError, match=r'b\.json: not readable as JSON'):
        read_json(tmp_path / 'b.json')


# ---------------------------------------------------------------------- keys


@dataclass(frozen=True)
class Options:
    radius: float
    names: tuple[str, ...] = ()


def test_content_keys_are_stable_over_machines():
    key = content_key({'b': [1, 2.5, None, True], 'a': 'x'}, np.arange(3, dtype=np.int64), Path('p'))
    assert key == content_key({'a': 'x', 'b': (1, 2.5, None, True)}, np.arange(3, dtype=np.int64), Path('p'))
    assert key == '0e803473876426c307379e7e7d0061f6'


def test_different_content_has_different_keys():
    parts = [
        1, 1.0, True, '1', None, 'None', [1], [[1]], [], {}, {'a': 1}, {'a': 2}, ['a', 1], np.array(1), np.array([1]),
        np.array([1.0]), np.array([[1]]), np.array([1], dtype=np.int32), ['ab', 'c'], ['a', 'bc'], Path('1'), 0.0, -0.0,
        Options(1.0), Options(2.0), Options(1.0, ('a',)), {'radius': 1.0, 'names': ()},
    ]  # fmt: skip
    keys = [content_key(part) for part in parts] + [content_key(), content_key(1, 1)]
    assert len(set(keys)) == len(keys)


def test_numpy_numbers_count_as_plain_ones_and_memory_order_does_not_count():
    assert content_key(np.float64(0.25)) == content_key(0.25)
    grid = np.arange(6.0).reshape(2, 3)
    assert content_key(grid) == content_key(np.asfortranarray(grid))
    assert content_key(np.arange(10)[::2]) == content_key(np.arange(10)[::2].copy())


@pytest.mark.parametrize('part', [print, object(), {1, 2}, b'x', np.array([{}])])
def test_what_has_no_stable_content_is_refused(part):
    with pytest.raises(TypeError, match='no stable content'):
        content_key(part)
