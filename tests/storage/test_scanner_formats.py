"""PTS, PTX and E57: several scans in a file, poses, cells without a return."""

import os

import numpy as np
import pytest

from rm3d_plugin.storage import columns
from rm3d_plugin.storage.columns import read_columns
from rm3d_plugin.storage.scans import read_scan
from rm3d_plugin.structures import SceneError

# A quarter turn about z, x to y, then a shift; rows (x, y, z, 1) stand on its left.
TURNED = '2\n2\n10 20 3\n0 1 0\n-1 0 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n10 20 3 1\n'
PLAIN = '1\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n'


def written(folder, name, text):
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize('end', ['\n', '\r\n'])
def test_pts_of_two_scans(tmp_path, end):
    rows = ['2', '1 2 3 -2048 255 0 10', '4 5 6 2047 0 0 0', '0', '1', '7 8 9 100 1 2 3', '', '']
    path = written(tmp_path, 'a.pts', '')
    path.write_bytes(end.join(rows).encode())
    found = read_columns(path)
    assert list(found) == ['x', 'y', 'z', 'intensity', 'red', 'green', 'blue']
    assert found['y'].tolist() == [2, 5, 8] and found['intensity'].tolist() == [-2048, 2047, 100]
    scan = read_scan(path)
    np.testing.assert_allclose(scan.cloud.colors[0], [1, 0, 10 / 255], atol=1e-6)


def test_pts_without_a_count_and_with_fewer_columns(tmp_path):
    assert read_columns(written(tmp_path, 'a.pts', '1 2 3\n4 5 6\n'))['z'].tolist() == [3, 6]
    assert list(read_columns(written(tmp_path, 'b.pts', '1\n1 2 3 7\n'))) == ['x', 'y', 'z', 'intensity']


@pytest.mark.parametrize(
    ('text', 'told'),
    [
        ('3\n1 2 3\n4 5 6\n', '2 points, but 3 are announced; cut off'),
        ('1\n1 2 3\n4 5 6\n', 'line 3: more points than announced'),
        ('2\n1 2 3\n4 five 6\n', "line 3: 'five' is not a number"),
        ('\n\n1\n\n1 2 3\n\n4 5 6\n', 'line 7: more points than announced'),
        ('1\n412,345.67 5,123,456.78 120.5 3\n', "line 2: '412,345.67' seems to have commas between thousands"),
        ('2\n1 2 3 0 0 1\n4 5 6 0 -1 0\n', 'columns 4 to 6 look like normals, .pts has colours there; save it as .txt'),
        ('1\n1 2 3\n1\n1 2 3 4\n', r'rows of \[3, 4\] numbers'),
        ('1\n1 2 3 4 5\n', r'rows of \[5\] numbers; expected one of \[3, 4, 6, 7\]'),
        ('-1\n1 2 3\n', "line 1: expected how many there are, got '-1'"),
        ('0\n', 'holds no points'),
        ('', 'holds no points'),
    ],
)
def test_bad_pts_is_told(tmp_path, text, told):
    with pytest.raises(SceneError, match=told):
        read_columns(written(tmp_path, 'a.pts', text))


@pytest.mark.parametrize(
    'text',
    [
        '2\n1,5 2,5 3,5\n4 5,25 6\n',
        '# x y z\n2\n1.5 2.5 3.5\n# end of row 1\n4 5.25 6\n',
        '//X Y Z\n1.5, 2.5, 3.5\n4, 5.25, 6\n',
        '2\n1.5;2.5;3.5\n4;5.25;6\n',
    ],
)
def test_pts_of_other_programs(tmp_path, text):
    """Decimal commas, remarks and separators."""
    found = read_columns(written(tmp_path, 'a.pts', text))
    assert [found[axis].tolist() for axis in 'xyz'] == [[1.5, 4], [2.5, 5.25], [3.5, 6]] and len(found) == 3


def test_ptx_moves_its_points_and_leaves_out_cells_without_a_return(tmp_path):
    path = written(tmp_path, 'a.ptx', TURNED + '1 0 0 0.25\n0 0 0 0.5\n0 2 1 1\n3 4 5 0\n')
    found = read_columns(path)
    np.testing.assert_allclose(np.stack([found[axis] for axis in 'xyz'], axis=1), [[10, 21, 3], [8, 20, 4], [6, 23, 8]])
    assert found['intensity'].tolist() == [0.25, 1, 0]
    scan = read_scan(path)
    assert scan.cloud.sensor.tolist() == [10, 20, 3]
    far = written(tmp_path, 'far.ptx', TURNED.replace('10 20 3', '400010 5000020 3') + '1 0 0 0.25\n' * 4)
    cloud = read_scan(far).cloud
    np.testing.assert_allclose(cloud.sensor + cloud.origin, [400010, 5000020, 3], atol=1e-6)


def test_ptx_of_two_scans_has_no_one_sensor(tmp_path):
    text = TURNED + '1 0 0 0.25 255 0 0\n' * 4 + PLAIN + '1 2 3 0.5 0 255 0\n' * 2
    path = written(tmp_path, 'a.ptx', text)
    scan = read_scan(path)
    assert len(scan.cloud) == 6 and scan.cloud.sensor is None
    np.testing.assert_allclose(scan.cloud.xyz[[0, 4]], [[10, 21, 3], [1, 2, 3]])
    np.testing.assert_allclose(scan.cloud.colors[[0, 4]], [[1, 0, 0], [0, 1, 0]])


@pytest.mark.parametrize(
    ('text', 'told'),
    [
        (PLAIN + '1 2 3 4\n', '1 points, but 2 are announced; cut off'),
        (PLAIN[:20], "line 5: expected 3 numbers of a header, got '0 1'"),
        (PLAIN.replace('1\n2\n', '1\n-2\n', 1) + '1 2 3 4\n', "line 2: expected how many there are, got '-2'"),
        (
            PLAIN.replace('0 0 1 0\n0 0 0 1', '0 0 1 5\n0 0 0 1') + '1 2 3 4\n' * 2,
            'line 7: the last column of the transform',
        ),
        (PLAIN + '1 2 3 4\n1 2\n', 'line 12: 2 numbers, expected 4'),
        (PLAIN + '0 0 0 0.5\n' * 2, 'holds no points'),
        ('1e300\n1e300\n' + PLAIN[4:], 'expected how many there are'),
        (
            PLAIN.replace('0 0 0\n', 'nan 0 0\n', 1) + '1 2 3 4\n' * 2,
            "line 3: expected 3 numbers of a header, got 'nan 0 0'",
        ),
    ],
)
def test_bad_ptx_is_told(tmp_path, text, told):
    with pytest.raises(SceneError, match=told):
        read_columns(written(tmp_path, 'a.ptx', text))


def test_e57_without_its_package_says_what_to_do(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__('sys').modules, 'pye57', None)
    with pytest.raises(SceneError, match=r'E57 needs pye57; pip install "rm3d_plugin\[e57\]", or save it as LAS'):
        read_columns(written(tmp_path, 'a.e57', 'ASTM-E57'))


def test_e57_of_two_scans(tmp_path):
    pye57 = pytest.importorskip('pye57')
    path = tmp_path / 'a.e57'
    file = pye57.E57(str(path), mode='w')
    xyz = np.arange(12.0).reshape(4, 3)
    rows = {'cartesianX': xyz[:, 0], 'cartesianY': xyz[:, 1], 'cartesianZ': xyz[:, 2], 'intensity': np.arange(4.0)}
    file.write_scan_raw(rows)
    quarter = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    file.write_scan_raw(rows, rotation=quarter, translation=np.array([10.0, 20, 3]))
    file.close()
    found = read_columns(path)
    assert list(found) == ['x', 'y', 'z', 'intensity']
    got = np.stack([found[axis] for axis in 'xyz'], axis=1)
    np.testing.assert_allclose(got[:4], xyz, atol=1e-9)
    np.testing.assert_allclose(got[4:], np.c_[10 - xyz[:, 1], 20 + xyz[:, 0], 3 + xyz[:, 2]], atol=1e-9)
    path.write_bytes(path.read_bytes()[:-300])
    with pytest.raises(SceneError, match=r'a\.e57: not readable as E57 \(.*; copy it again'):
        read_columns(path)


def e57_of(path, *scans):
    """A file of scans: rows by name, and their pose."""
    pye57 = pytest.importorskip('pye57')
    file = pye57.E57(str(path), mode='w')
    for rows, pose in scans:
        file.write_scan_raw(rows, **pose)
    file.close()
    return path


def test_e57_whose_scans_differ_or_do_not_turn(tmp_path):
    rows = {f'cartesian{axis}': np.arange(3.0) for axis in 'XYZ'}
    colored = rows | {f'color{name}': np.full(3, 255, dtype=np.uint8) for name in ('Red', 'Green', 'Blue')}
    with pytest.warns(UserWarning, match='red, green, blue: not every scan of the file has them; they are left out'):
        assert list(read_columns(e57_of(tmp_path / 'a.e57', (colored, {}), (rows, {})))) == ['x', 'y', 'z']
    flat = {'rotation': np.zeros(4), 'translation': np.zeros(3)}
    with pytest.raises(SceneError, match='scan 2: rotation 0 0 0 0: expected a quaternion of length 1'):
        read_columns(e57_of(tmp_path / 'b.e57', (rows, {}), (rows, flat)))
    name = os.fsdecode(os.fsencode(tmp_path) + b'/b\xfcro.e57')
    os.rename(tmp_path / 'a.e57', name)
    with pytest.raises(SceneError, match='pye57 opens no file whose name is no UTF-8; rename it'):
        read_columns(name)


def test_every_ending_has_a_reader():
    assert set(columns._readers()) == set(columns.ENDINGS)


def test_headers_of_ptx_with_decimal_commas_and_remarks_behind_blanks(tmp_path):
    rows = '1 0 0 0.25\n0 2 1 1\n' * 2
    text = TURNED.replace('10 20 3', '10.5 20.25 3.5') + rows
    plain = read_columns(written(tmp_path, 'a.ptx', text))
    commas = '  # exported\n\t// twice\n' + text.replace('.', ',')
    other = read_columns(written(tmp_path, 'b.ptx', commas))
    for name, values in plain.items():
        np.testing.assert_array_equal(other[name], values)
    with pytest.raises(SceneError, match='c.pts'):
        read_columns(written(tmp_path, 'c.pts', '/ 1\n1\n1 2 3\n'))  # one stroke is no remark
