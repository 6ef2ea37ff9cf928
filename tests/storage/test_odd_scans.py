"""Scans as other programs write them, and what is no scan: the right values, or one message that says what it is."""

import io
import os
import struct
import warnings

import numpy as np
import pytest

from rm3d_plugin.storage.scans import read_scan
from rm3d_plugin.structures import SceneError

PTX = '1\n2\n5 6 7\n1 0 0\n0 1 0\n0 0 1\n{}\n10 20 30 1\n'
AXES = '1 0 0 0\n0 1 0 0\n0 0 1 0'


def read(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        return read_scan(path, labels=True), ' | '.join(str(item.message) for item in caught)


def saved(array):
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def points(count=500):
    rng = np.random.default_rng(0)
    return np.c_[rng.uniform(-50, 50, (count, 2)), rng.uniform(-2, 3, count), rng.random(count)]


@pytest.mark.parametrize(
    ('name', 'content'),
    [
        ('bars.txt', 'x|y|z|label\n1|2|3|4\n5|6|7|8\n'),
        ('bars_quoted.csv', '"X [m]" | "Y [m]" | "Z [m]" | Class\n1 | 2 | 3 | 4\n5 | 6 | 7 | 8\n'),
        ('mark.ply', b'\xef\xbb\xbf' + b'ply\nformat ascii 1.0\nelement vertex 2\n' + b''.join(
            b'property %s\n' % of for of in (b'float x', b'float y', b'float z', b'uchar label')
        ) + b'end_header\n1 2 3 4\n5 6 7 8\n'),
        ('fields.npy', saved(np.array([((1, 2, 3), 4), ((5, 6, 7), 8)], dtype=[('xyz', 'f4', (3,)), ('label', 'u1')]))),
        ('column.npy', saved(np.array([((1, 2, 3), (4,)), ((5, 6, 7), (8,))],
                                      dtype=[('xyz', 'f8', 3), ('class', 'i8', (1,))]))),
    ],
)  # fmt: skip
def test_two_points_with_labels(tmp_path, name, content):
    scan, said = read(tmp_path, name, content)
    np.testing.assert_array_equal(scan.cloud.xyz, [[1, 2, 3], [5, 6, 7]])
    assert scan.label.tolist() == [4, 8] and said == ''


def test_a_label_of_one_column_in_an_archive(tmp_path):
    np.savez(tmp_path / 'a.npz', xyz=points()[:, :3], label=np.full((500, 1), 3))
    assert (read_scan(tmp_path / 'a.npz', labels=True).label == 3).all()


@pytest.mark.parametrize('text', ['\r\n\r\n2\r\n1 2 3\r\n  \r\n4 5 6\r\n\r\n', '1\n1 2 3\n\n1\n4 5 6\n'])
def test_empty_lines_in_pts(tmp_path, text):
    np.testing.assert_array_equal(read(tmp_path, 'a.pts', text)[0].cloud.xyz, [[1, 2, 3], [4, 5, 6]])


def test_lines_are_counted_as_an_editor_counts(tmp_path):
    with pytest.raises(SceneError, match=r'line 5: .*4 five 6'):
        read(tmp_path, 'a.pts', '\n2\n\n1 2 3\n4 five 6\n')
    with pytest.raises(SceneError, match=r'line 3: expected 1 numbers of a header'):
        read(tmp_path, 'a.ptx', '1\n\n2 2\n')


def test_ptx_moves_or_tells(tmp_path):
    cells = '1 0 0 .5\n\n0 0 0 .5\n'
    np.testing.assert_array_equal(read(tmp_path, 'a.ptx', PTX.format(AXES) + cells)[0].cloud.xyz, [[11, 20, 30]])
    with pytest.raises(SceneError, match='puts all points into a plane'):
        read(tmp_path, 'b.ptx', PTX.format('1 0 0 0\n0 1 0 0\n0 0 0 0') + cells)


@pytest.mark.parametrize(
    ('content', 'told'),
    [
        (points().astype('>f4').tobytes(), 'big-endian: save them little-endian'),
        (b'1.5 2.5 3.5 4.5\n' * 100, 'text, or damaged'),
        ((points() * 300).astype('<i2').tobytes(), 'another type, or damaged'),
    ],
)
def test_no_float32(tmp_path, content, told):
    with pytest.raises(SceneError, match='make no sense as float32') as error:
        read(tmp_path, 'a.bin', content)
    assert told in str(error.value)
    assert len(read(tmp_path, 'b.bin', points().astype('<f4').tobytes())[0].cloud) == 500
    one_far = points().astype('<f4')
    one_far[0, 0] = 3e38
    assert len(read(tmp_path, 'c.bin', one_far.tobytes())[0].cloud) == 500


@pytest.mark.parametrize(
    ('number', 'found'),
    [(2**31 + 7, 2**31 + 7), (2**63 - 1, 2**63 - 1), (2**64 - 1, -1), (2**63, 'expected numbers up to 922337203')],
)
def test_instances_of_64_bits(tmp_path, number, found):
    head = (
        'ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z'
    )
    content = f'{head}\nproperty uint64 instance\nend_header\n'.encode() + struct.pack('<3fQ', 1, 2, 3, number)
    if isinstance(found, int):
        assert read(tmp_path, 'a.ply', content)[0].instance.tolist() == [found]
        return
    with pytest.raises(SceneError, match=found):
        read(tmp_path, 'a.ply', content)


def test_whole_numbers_too_great_for_text(tmp_path):
    with pytest.raises(SceneError, match='expected whole numbers below 9007199254740992, got 9007199254740992'):
        read(tmp_path, 'a.txt', 'x y z instance\n1 2 3 9007199254740993\n')
    with pytest.raises(SceneError, match=r'expected whole numbers, got 1\.5'):
        read(tmp_path, 'b.txt', 'x y z label\n1 2 3 1.5\n')


def test_lost_digits_of_half_floats_and_few_degrees(tmp_path):
    scan, said = read(tmp_path, 'half.npy', saved((points()[:, :3] + 100).astype(np.float16)))
    assert len(scan.cloud) == 500 and 'are float16, in steps of 0.0625 m' in said and 'overflow' not in said
    rng = np.random.default_rng(1)
    degrees = np.c_[13.4 + rng.random(60) * 0.2, 52.5 + rng.random(60) * 0.2, 30 + rng.random(60) * 20]
    assert 'look like degrees' in read(tmp_path, 'degrees.npy', saved(degrees))[1]


@pytest.mark.parametrize('text', ['{"x": [1, 2]}\n', '<html>\n<body>404</body></html>\n'])
def test_a_text_without_points(tmp_path, text):
    with pytest.raises(SceneError, match='holds no points; no line holds numbers') as error:
        read(tmp_path, 'a.txt', text)
    assert repr(text.splitlines()[0]) in str(error.value)


def test_what_is_no_file(tmp_path):
    (tmp_path / 'folder.ply').mkdir()
    (tmp_path / 'loop.xyz').symlink_to(tmp_path / 'loop.xyz')
    os.mkfifo(tmp_path / 'pipe.xyz')
    for name, told in (('folder.ply', 'a folder'), ('pipe.xyz', 'a device'), ('loop.xyz', 'no such file')):
        with pytest.raises(SceneError, match=told):
            read_scan(tmp_path / name)
