"""Which files of a folder count, and texts of other programs."""

import os

import pytest

from rm3d_plugin.storage.plain_files import files_ending, read_list, read_number, read_text
from rm3d_plugin.structures import SceneError


def test_hidden_files_do_not_count_and_endings_are_small(tmp_path):
    for name in ('b.bin', 'a.bin', '._a.bin', '.DS_Store', 'a.txt', 'a.bin.part'):
        (tmp_path / name).touch()
    assert [path.name for path in files_ending(tmp_path, '.bin')] == ['a.bin', 'b.bin']
    assert files_ending(tmp_path / 'nothing', '.bin') == []
    (tmp_path / 'c.BIN').touch()
    assert [path.name for path in files_ending(tmp_path, '.bin', large=True)] == ['a.bin', 'b.bin', 'c.BIN']
    with pytest.raises(SceneError, match=r'c\.BIN: expected the ending \.bin in small letters; rename the file'):
        files_ending(tmp_path, '.bin')


def test_texts_in_other_encodings(tmp_path):
    path = tmp_path / 'a.txt'
    for data in ('ü 1\r\n2\r'.encode('utf-16'), b'\xef\xbb\xbf' + 'ü 1\r\n2\r'.encode(), 'ü 1\n2\n'.encode()):
        path.write_bytes(data)
        assert read_text(path) == 'ü 1\n2\n'
    path.write_bytes(b'a\n\xfc 1\n')
    with pytest.raises(SceneError, match=r'a\.txt, line 2: byte 0xfc is no UTF-8; save the file as UTF-8 text'):
        read_text(path)
    assert read_text(path, strict=False) == 'a\n\N{REPLACEMENT CHARACTER} 1\n'


def test_a_list_finds_a_file_whose_name_is_no_utf_8(tmp_path):
    (tmp_path / os.fsdecode(b'b\xfcro.ply')).touch()
    (tmp_path / 'list.txt').write_bytes(b'\n b\xfcro.ply \r\na b.ply\n\n')
    names = read_list(tmp_path / 'list.txt')
    assert len(names) == 2 and (tmp_path / names[0]).is_file() and names[1] == 'a b.ply'
    assert read_list(tmp_path / 'list.txt', words=True)[1:] == ['a', 'b.ply']


@pytest.mark.parametrize('wrong', ['1_0', True, 'x', None, [1]])
def test_numbers_that_are_none(wrong):
    assert read_number('-1e2') == -100 and read_number(3) == 3
    with pytest.raises((ValueError, TypeError)):
        read_number(wrong)
