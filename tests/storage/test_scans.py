import numpy as np
import pytest

from rm3d_plugin.storage.ply import read_ply, write_ply
from rm3d_plugin.storage.scans import read_cloud
from rm3d_plugin.structures import SceneError

XYZ = np.array([[0.5, -1.0, 2.0], [3.0, 4.0, 5.0]], dtype=np.float32)
RGB = np.array([[255, 0, 51], [0, 102, 255]], dtype=np.uint8)
UNIT = RGB / 255


def ply_text(form, body=b'', extra=''):
    head = f'ply\nformat {form} 1.0\ncomment by hand\nelement vertex 2\nproperty float x\nproperty float y\n'
    head += f'property float32 z\nproperty uchar red\nproperty uchar green\nproperty uint8 blue\n{extra}end_header\n'
    return head.encode() + body


def test_ply_by_hand_ascii_and_binary(tmp_path):
    lines = b'0.5 -1 2 255 0 51\n3 4 5 0 102 255\n'
    (tmp_path / 'a.ply').write_bytes(
        ply_text('ascii', lines + b'3 0 1 1\n', 'element face 1\nproperty list uchar int v\n')
    )
    row = np.dtype([('xyz', '<f4', 3), ('rgb', 'u1', 3)])
    table = np.array([(XYZ[i], RGB[i]) for i in range(2)], dtype=row)
    (tmp_path / 'b.ply').write_bytes(ply_text('binary_little_endian', table.tobytes()))
    for name in ('a.ply', 'b.ply'):
        cloud = read_cloud(tmp_path / name)
        np.testing.assert_array_equal(cloud.xyz, XYZ)
        np.testing.assert_allclose(cloud.colors, UNIT, atol=1e-7)


def test_ply_write_and_read_back(tmp_path):
    columns = {
        'x': XYZ[:, 0].astype(np.float64),
        'red': RGB[:, 0],
        'region': np.array([-1, 70000], dtype=np.int32),
        'intensity': np.float32([0.25, 1]),
    }
    got = read_ply(write_ply(tmp_path / 'c.ply', columns))
    assert list(got) == list(columns)
    for name, values in columns.items():
        np.testing.assert_array_equal(got[name], values)
        assert got[name].dtype == values.dtype
    with pytest.raises(ValueError, match='column region: expected 2 numbers'):
        write_ply(tmp_path / 'd.ply', {'x': XYZ[:, 0], 'region': np.array([1, 2])})


def test_ply_elements_before_the_vertices_are_passed_over(tmp_path):
    head = 'ply\nformat {} 1.0\nelement camera 1\nproperty double f\nelement vertex 1\n'
    head += 'property float x\nproperty float y\nproperty float z\nend_header\n'
    (tmp_path / 'a.ply').write_text(head.format('ascii') + '7\n1 2 3\n')
    body = np.array([7.0]).tobytes() + np.float32([1, 2, 3]).tobytes()
    (tmp_path / 'b.ply').write_bytes(head.format('binary_little_endian').encode() + body)
    for name in ('a.ply', 'b.ply'):
        assert read_cloud(tmp_path / name).xyz.tolist() == [[1, 2, 3]]


@pytest.mark.parametrize(
    ('content', 'message'),
    [
        (b'solid\n', 'does not begin with "ply"'),
        (ply_text('binary_mixed'), 'expected one of ascii, binary_little_endian, binary_big_endian'),
        (ply_text('binary_little_endian', b'abc'), '3 bytes after the header, expected at least 30'),
        (ply_text('ascii', b'0 0 0 1 1 1\n'), '1 vertices, the header says 2'),
        (ply_text('ascii', b'0 0 0 1 1\n0 0 0 1 1 1\n'), 'vertex 0: 5 numbers, expected 6'),
        (ply_text('ascii', b'0 0 zero 1 1 1\n0 0 0 1 1 1\n'), "vertex 0: 'zero' is not a number"),
        (ply_text('ascii').split(b'end_header')[0], 'no end_header'),
        (b'ply\nformat ascii 1.0\nelement face 0\nend_header\n', 'has no element vertex'),
        (b'ply\nformat ascii 1.0\nelement vertex 0\nproperty half x\nend_header\n', "unknown type 'half'"),
        (b'ply\nformat ascii 1.0\nelement vertex 1\nproperty float u\nend_header\n1\n', 'no column x, got u'),
    ],
)
def test_bad_ply_files_are_named(tmp_path, content, message):
    path = tmp_path / 'bad.ply'
    path.write_bytes(content)
    with pytest.raises(SceneError, match=message) as caught:
        read_cloud(path)
    assert str(path) in str(caught.value)


def test_tables_of_three_to_seven_columns(tmp_path):
    intensity = np.array([[0.5], [0.25]])
    tables = {
        'xyz.npy': XYZ,
        'xyzi.npy': np.c_[XYZ, intensity],
        'xyzrgb.npy': np.c_[XYZ, RGB],
        'unit.npy': np.c_[XYZ, UNIT],
        'all.npy': np.c_[XYZ, intensity, RGB],
    }
    for name, table in tables.items():
        np.save(tmp_path / name, table)
        np.savetxt(tmp_path / (name + '.txt'), table)
        np.savetxt(tmp_path / (name + '.xyz'), table, delimiter=', ', header='a comment')
        for path in (tmp_path / name, tmp_path / (name + '.txt'), tmp_path / (name + '.xyz')):
            cloud = read_cloud(path)
            np.testing.assert_array_equal(cloud.xyz, XYZ)
            assert (cloud.intensity is not None) == (table.shape[1] in (4, 7))
            assert (cloud.colors is not None) == (table.shape[1] in (6, 7))
            if cloud.colors is not None:
                np.testing.assert_allclose(cloud.colors, UNIT, atol=1e-6)
            if cloud.intensity is not None:
                assert cloud.intensity.tolist() == [0.5, 0.25]


def test_an_archive_with_an_origin_lies_where_it_says(tmp_path):
    origin = np.array([5e5, 5.4e6, 300.25])
    np.savez(tmp_path / 'a.npz', xyz=XYZ.astype(np.float32), origin=origin)
    cloud = read_cloud(tmp_path / 'a.npz')
    np.testing.assert_allclose(
        cloud.xyz.astype(float) + cloud.origin, XYZ.astype(np.float32) + origin, atol=1e-6, rtol=0
    )
    np.savez(tmp_path / 'b.npz', xyz=XYZ.astype(np.float32), origin=np.zeros(3))
    np.testing.assert_array_equal(read_cloud(tmp_path / 'b.npz').xyz, XYZ.astype(np.float32))
    np.savez(tmp_path / 'c.npz', xyz=XYZ, origin=np.array([1.0, np.nan, 0.0]))
    with pytest.raises(SceneError, match='c.npz: origin: expected three finite numbers'):
        read_cloud(tmp_path / 'c.npz')


def test_bin_and_npz(tmp_path):
    np.c_[XYZ, [0.5, 1]].astype('<f4').tofile(tmp_path / 'a.bin')
    cloud = read_cloud(tmp_path / 'a.bin')
    assert cloud.intensity.tolist() == [0.5, 1] and cloud.sensor.tolist() == [0, 0, 0]
    np.savez(tmp_path / 'a.npz', xyz=XYZ, colors=RGB, label=np.zeros(2))
    np.savez(tmp_path / 'b.npz', points=np.c_[XYZ, [0.5, 1]])
    np.testing.assert_allclose(read_cloud(tmp_path / 'a.npz').colors, UNIT, atol=1e-7)
    assert read_cloud(tmp_path / 'b.npz').intensity.tolist() == [0.5, 1]


def test_columns_may_be_named(tmp_path):
    table = np.c_[RGB, XYZ, [3, 4]]
    np.save(tmp_path / 'a.npy', table)
    np.savetxt(tmp_path / 'a.txt', table)
    table.astype('<f4').tofile(tmp_path / 'a.bin')
    for name in ('a.npy', 'a.txt', 'a.bin'):
        cloud = read_cloud(tmp_path / name, 'red green blue x y z -')
        np.testing.assert_array_equal(cloud.xyz, XYZ)
        np.testing.assert_allclose(cloud.colors, UNIT, atol=1e-7)
        assert cloud.intensity is None
    with pytest.raises(SceneError, match='the columns named are 3'):
        read_cloud(tmp_path / 'a.npy', 'x y z')
    for bad in ('x y', 'x y z z', 'x y z red', 'x y z depth'):
        with pytest.raises(SceneError, match='columns: expected x y z'):
            read_cloud(tmp_path / 'a.npy', bad)


def test_sixteen_bit_colours_and_large_coordinates(tmp_path):
    world = XYZ.astype(np.float64) + [4e5, 5e6, 100]
    np.savez(tmp_path / 'a.npz', xyz=world, colors=RGB.astype(np.uint16) * 257)
    cloud = read_cloud(tmp_path / 'a.npz')
    np.testing.assert_allclose(cloud.xyz + cloud.origin, world, atol=1e-6)
    np.testing.assert_allclose(cloud.colors, UNIT, atol=1e-7)


def test_bad_files_are_named(tmp_path):
    def message(name, content=None):
        if content is not None:
            (tmp_path / name).write_bytes(content)
        with pytest.raises(SceneError) as caught:
            read_cloud(tmp_path / name)
        assert str(tmp_path / name) in str(caught.value)
        return str(caught.value)

    assert "unknown ending '.rcp'; expected one of .bin" in message('a.rcp', b'')
    assert 'no such file' in message('none.npy')
    assert 'no multiple of 16' in message('a.bin', b'12345')
    assert 'holds no points' in message('b.bin', b'')
    assert 'NaN or infinite' in message('c.bin', np.float32([np.nan, 0, 0, 0]).tobytes())
    assert 'not readable as .npy' in message('a.npy', b'text')
    assert 'not readable as .npz' in message('a.npz', b'text')
    assert 'holds no points' in message('a.txt', b'# nothing\n')
    assert "line 2: 2 numbers, expected 3: '1 2'" in message('b.txt', b'1 2 3\n1 2\n')
    assert 'expected numbers' in message('c.txt', b'1 2 3\n1 two 3\n')
    assert 'no column x, got 0 1; name the columns' in message('d.txt', b'1 2\n')
    np.savez(tmp_path / 'b.npz', depth=XYZ)
    assert 'holds depth; expected xyz' in message('b.npz')
    np.savez(tmp_path / 'c.npz', xyz=XYZ, colors=RGB[:1])
    assert 'colors: shape (1, 3), but xyz has shape (2, 3)' in message('c.npz')
    np.save(tmp_path / 'd.npy', np.array([{'a': 1}], dtype=object))
    assert 'not readable as .npy' in message('d.npy')
