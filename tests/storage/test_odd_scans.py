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


@pytest.mark.parametrize('text', ['{"x": [1, 2]}\n', '(1, 2)\nno points\n'])
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


def ply(kinds, body, rows=2, before='', after=''):
    properties = ''.join(f'property {kind}\n' for kind in kinds)
    return f'ply\nformat {before}element vertex {rows}\n{properties}{after}end_header\n'.encode() + body


def pcd(kinds, body, rows=2, data='ascii', shape=''):
    fields, types, sizes = zip(*(kind.split(':') for kind in kinds), strict=True)
    lines = [f'FIELDS {" ".join(fields)}', f'TYPE {" ".join(types)}', f'SIZE {" ".join(sizes)}', shape or '#']
    return '\n'.join([*lines, f'POINTS {rows}', f'DATA {data}', '']).encode() + body


FLOATS = ('float x', 'float y', 'float z')
PLACE = ('x:F:4', 'y:F:4', 'z:F:4')
NUMBERS = np.arange(1, 10, dtype='<f4').tobytes()


@pytest.mark.parametrize(
    ('name', 'content', 'told'),
    [
        ('a.txt', b'PK\x03\x04' + b'1 2 3\n', r'is a zip archive, not \.txt; unpack it first'),
        ('a.bin', b'\x1f\x8b\x08\x08' + NUMBERS, r'is a gzip archive, not \.bin; unpack it first'),
        ('a.las', b'version https://git-lfs.github.com/spec/v1\n', 'is a pointer of Git LFS, not .las; fetch'),
        ('a.laz', b'<!DOCTYPE html><html>', 'is a web page'),
        ('a.txt', ply(FLOATS, b'1 2 3\n' * 2, before='ascii 1.0\n'), r'is a PLY file, not \.txt; name it \.ply'),
        ('a.bin', saved(np.zeros((9, 4), np.float32)), r'is an array of numpy, not \.bin; name it \.npy'),
        ('a.npy', b'PK\x03\x04', r'holds an archive, not one array; name it \.npz'),
        ('a.txt', '412,345.67 5,123,456.78 120.5\n', r"line 1: '412,345\.67' seems to have commas between thousands"),
        ('a.txt', 'x\ty\tz\n412,345\t5,123,456\t120\n', "line 2: '412,345' seems to have commas between thousands"),
        ('a.txt', '1_000 2 3\n', "'1_000' is not a number"),
        ('a.ply', ply(FLOATS, NUMBERS * 2, 1, 'ascii 1.0\nelement vertex 1\nproperty int x\n'), 'several elements'),
        ('a.pcd', pcd(PLACE, b'1 2 3\n' * 2, shape='WIDTH 3\nHEIGHT 3'), 'POINTS 2, but WIDTH 3 and HEIGHT 3'),
        ('a.pcd', pcd(PLACE, b'', rows=0), 'holds no points'),
        ('a.bin', np.c_[points(), points()[:, :3]].astype('<f4').tobytes(), 'looks like 7 float32 a point; expected 4'),
        ('a.npy', saved(np.array([[1, 'a', 2]], dtype=object)), 'holds Python objects, which are never read'),
    ],
)  # fmt: skip
def test_what_it_is_and_what_to_do(tmp_path, name, content, told):
    with pytest.raises(SceneError, match=told):
        read(tmp_path, name, content)


@pytest.mark.parametrize(
    ('name', 'content', 'told'),
    [
        ('a.ply', ply(FLOATS, NUMBERS, before='binary_little_endian 1.0\n'), 'element vertex 2, but 12 bytes follow'),
        ('a.ply', ply(FLOATS, b'1 2 3\n4 5 6\n7 8 9\n', before='ascii 1.0\n'), 'element vertex 2, but 5 bytes follow'),
        ('a.pcd', pcd(PLACE, NUMBERS, data='binary'), 'says POINTS 2, but 12 bytes follow'),
        ('a.txt', 'x y z label class\n1 2 3 70 1\n4 5 6 71 2\n7 8 9 72 2\n', "both 'label' and 'class' could be"),
        ('a.txt', 'x y z label class\n1 2 3 70 1\n4 5 6 71 1\n', ''),
        ('a.txt', 'x y z label class\n1 2 3 70 7\n4 5 6 71 5\n', ''),
        ('a.txt', b'1 2 3\r\n4 5 6\r7 8 9\n', ''),
        ('a.ply', ply(FLOATS, b'1 2 3\n4 5 6\n3 0 1 1\n', before='ascii 1.0\n',
                      after='element face 1\nproperty list uchar int i\n'), ''),
        ('a.txt', '1,2.5,3 100,200,250\n4,5.5,6 1,2,3\n', ''),
        ('a.txt', '1.5 2.5 3 100,200,250\n4 5 6 1,2,3\n', ''),
    ],
)  # fmt: skip
def test_points_and_what_is_said_of_them(tmp_path, name, content, told):
    scan, said = read(tmp_path, name, content)
    assert scan.cloud.xyz[:2, 2].tolist() == [3, 6]
    assert told in said and bool(told) == bool(said)


def test_eight_numbers_a_point_may_be_four_in_a_pattern(tmp_path):
    eight = np.c_[points(), points(500)[:, ::-1] * 9].astype('<f4')
    assert 'looks like 8 float32 a point' in read(tmp_path, 'a.bin', eight.tobytes())[1]


@pytest.mark.parametrize('width', [4, 5])
def test_a_lidar_that_fires_low_and_high_in_turn_has_no_wider_points(tmp_path, width):
    """Sixteen lasers, every second one below the horizon: two points together scatter less than one."""
    ring = np.tile([0, 8, 1, 9, 2, 10, 3, 11, 4, 12, 5, 13, 6, 14, 7, 15], 300)
    turn, range_ = np.linspace(0, 2 * np.pi, len(ring)), 8 + np.sin(np.arange(len(ring)) / 90)
    high = np.tan(np.deg2rad(2 * ring - 15.0)) * range_
    strength = np.random.default_rng(0).uniform(0, 1, len(ring))
    rows = np.c_[range_ * np.cos(turn), range_ * np.sin(turn), high, strength, ring][:, :width].astype('<f4')
    scan, said = read(tmp_path, 'a.bin', rows.tobytes())
    np.testing.assert_array_equal(scan.cloud.xyz, rows[:, :3])
    assert ('read as 5 float32' in said) if width == 5 else said == ''


@pytest.mark.parametrize(
    ('kind', 'numbers', 'red'),
    [
        ('rgb:F:4', ('16711680', '65280'), [1, 0]),  # the number that should be in the bits
        ('rgb:F:4', ('2.3418052e-38', '9.147676e-41'), [1, 0]),
        ('rgb:U:4', ('16711680', '65280'), [1, 0]),
    ],
)
def test_packed_colours(tmp_path, kind, numbers, red):
    scan, said = read(tmp_path, 'a.pcd', pcd((*PLACE, kind), ''.join(f'1 2 3 {n}\n' for n in numbers).encode()))
    assert scan.cloud.colors[:, 0].tolist() == red and said == ''


def test_colours_that_text_lost(tmp_path):
    for lost in (b'nan', b'-nan'):
        body = b'1 2 3 ' + lost + b'\n1 2 3 2.3418052e-38\n'
        scan, said = read(tmp_path, 'a.pcd', pcd((*PLACE, 'rgb:F:4'), body))
        assert scan.cloud.colors[:, 0].tolist() == [0, 1] and 'colors: 1 of 2 points are NaN' in said


def test_arrays_of_an_archive(tmp_path):
    def told(**arrays):
        np.savez(tmp_path / 'a.npz', **arrays)
        return read_scan(tmp_path / 'a.npz', labels=True)

    xyz = points()[:, :3]
    upper = told(X=xyz[:, 0], Y=xyz[:, 1], Z=xyz[:, 2], note=np.array(['a'] * 500))
    np.testing.assert_array_equal(upper.cloud.xyz, xyz.astype(np.float32))
    assert told(XYZ=xyz, colors=np.full((500, 4), [255, 0, 0, 7])).cloud.colors[0].tolist() == [1, 0, 0]
    apart = told(x=xyz[:, :1], y=xyz[:, 1:2], z=xyz[:, 2:], rgb=np.full(500, 0xFF0000, np.uint32))
    np.testing.assert_array_equal(apart.cloud.xyz, xyz.astype(np.float32))
    with pytest.warns(UserWarning, match=r'label has shape \(500, 3\), expected 1 a point: read as label_0'):
        told(xyz=xyz, label=np.zeros((500, 3), int))
    with pytest.warns(UserWarning, match='x of xyz passed over: another array has it, too'):
        assert told(xyz=xyz, x=xyz[:, 0] + 1).cloud.xyz[:, 0].tolist() == (xyz[:, 0] + 1).astype(np.float32).tolist()
    with pytest.warns(UserWarning, match='intensity of points passed over'):
        strong = told(points=np.c_[xyz, np.zeros(500)], intensity=np.ones(500))
    assert strong.cloud.intensity.tolist() == [1.0] * 500
    with pytest.raises(SceneError, match="array 'meta': it holds Python objects"):
        told(xyz=xyz, meta=np.array({}, dtype=object))


def test_las_whose_header_does_not_fit(tmp_path):
    laspy = pytest.importorskip('laspy')
    las = laspy.LasData(laspy.LasHeader(point_format=6, version='1.4'))
    las.x, las.y, las.z = points()[:, :3].T
    las.write(tmp_path / 'good.las')
    good = (tmp_path / 'good.las').read_bytes()
    with pytest.raises(SceneError, match='400 points, but the header says 500; cut off?'):
        read(tmp_path, 'cut.las', good[: -100 * las.point_format.size])
    with pytest.raises(SceneError, match='scales 0 0.01 0.01 in the header'):
        read(tmp_path, 'flat.las', good[:131] + bytes(8) + good[139:])
    centre = saved(np.array([[1e15, 1e15, 1.0]]))
    assert 'are float64, in steps of 0.125 m: digits are lost; subtract an offset' in read(tmp_path, 'a.npy', centre)[1]
