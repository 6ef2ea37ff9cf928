"""Named columns of every kind of file, against other readers and by hand."""

import builtins
import struct

import numpy as np
import pytest

from rm3d_plugin.storage.columns import ENDINGS, _readers, read_columns
from rm3d_plugin.storage.pcd import read_pcd
from rm3d_plugin.storage.ply import write_ply
from rm3d_plugin.storage.scans import Scan, map_labels, read_cloud, read_scan, unit_colors
from rm3d_plugin.structures import SceneError

XYZ = np.array([[0.5, -1.0, 2.0], [3.0, 4.0, 5.0], [6.0, 7.0, 8.5]])
RGB = np.array([[255, 0, 51], [0, 102, 255], [1, 2, 3]], dtype=np.uint8)
LABEL = np.array([2, 0, 7], dtype=np.int32)
HEAD = """# .PCD v0.7
VERSION 0.7
FIELDS x y z rgb label _ hist
SIZE 4 4 4 4 4 1 4
TYPE F F F U U U F
COUNT 1 1 1 1 1 4 2
WIDTH 3
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS 3
"""


def pcd_columns():
    packed = RGB[:, 0].astype(np.uint32) << 16 | RGB[:, 1].astype(np.uint32) << 8 | RGB[:, 2]
    floats = [XYZ[:, i].astype('<f4') for i in range(3)]
    return [*floats, packed, LABEL.astype('<u4'), *[np.zeros(3, 'u1')] * 4, *[np.float32([i, 1, 2]) for i in (5, 6)]]


def lzf_plain(data):
    """LZF without compression: runs of plain bytes."""
    return b''.join(bytes([len(data[i : i + 32]) - 1]) + data[i : i + 32] for i in range(0, len(data), 32))


def write_pcd(path, form):
    columns = pcd_columns()
    body = b''
    if form == 'ascii':
        body = '\n'.join(' '.join(str(c[i]) for c in columns) for i in range(3)).encode()
    elif form == 'binary':
        body = b''.join(c[i].tobytes() for i in range(3) for c in columns)
    else:
        fields = [*columns[:5], np.stack(columns[5:9], 1), np.stack(columns[9:], 1)]  # a field's numbers stay together
        plain = b''.join(f.tobytes() for f in fields)
        packed = lzf_plain(plain)
        body = np.array([len(packed), len(plain)], '<u4').tobytes() + packed
    path.write_bytes((HEAD + f'DATA {form}\n').encode() + body)
    return path


@pytest.mark.parametrize('form', ['ascii', 'binary', 'binary_compressed'])
def test_pcd_by_hand(tmp_path, form):
    got = read_pcd(write_pcd(tmp_path / 'a.pcd', form))
    assert list(got) == ['x', 'y', 'z', 'label', 'hist_0', 'hist_1', 'red', 'green', 'blue']
    np.testing.assert_array_equal(np.stack([got[name] for name in 'xyz'], 1), XYZ.astype(np.float32))
    np.testing.assert_array_equal(np.stack([got[name] for name in ('red', 'green', 'blue')], 1), RGB)
    assert got['label'].tolist() == LABEL.tolist() and got['hist_1'].tolist() == [6, 1, 2]
    scan = read_scan(tmp_path / 'a.pcd', labels=True)
    np.testing.assert_allclose(scan.cloud.colors, RGB / 255, atol=1e-7)
    assert scan.label.tolist() == LABEL.tolist() and scan.cloud.intensity is None


@pytest.mark.parametrize(('ascii', 'compressed'), [(True, False), (False, False), (False, True)])
def test_pcd_of_another_writer(tmp_path, ascii, compressed):
    open3d = pytest.importorskip('open3d')
    cloud = open3d.geometry.PointCloud()
    xyz = np.repeat(np.random.default_rng(0).normal(size=(40, 3)), 20, axis=0)  # repeats make LZF refer back
    cloud.points = open3d.utility.Vector3dVector(xyz)
    cloud.colors = open3d.utility.Vector3dVector(np.tile(RGB / 255, (267, 1))[:800])
    path = str(tmp_path / 'a.pcd')
    open3d.io.write_point_cloud(path, cloud, write_ascii=ascii, compressed=compressed)
    got = read_cloud(path)
    np.testing.assert_allclose(got.xyz, xyz, atol=1e-6)
    np.testing.assert_allclose(got.colors, np.asarray(cloud.colors), atol=1 / 255)


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (lambda b: b[:-3], 'bytes of points, expected'),
        (lambda b: b.replace(b'DATA binary', b'DATA hexadecimal'), "DATA 'hexadecimal'; expected one of ascii"),
        (lambda b: b.replace(b'FIELDS', b'FELDER'), 'no line FIELDS'),
        (lambda b: b.replace(b'COUNT 1', b'COUNT'), 'do not fit'),
        (lambda b: b.replace(b'x y z', b'x x z'), 'names a field twice'),
    ],
)
def test_bad_pcd_files_are_named(tmp_path, change, message):
    path = write_pcd(tmp_path / 'a.pcd', 'binary')
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(SceneError, match=message) as caught:
        read_cloud(path)
    assert str(path) in str(caught.value)


def test_damaged_compressed_points(tmp_path):
    path = write_pcd(tmp_path / 'a.pcd', 'binary_compressed')
    start = path.read_bytes().index(b'compressed\n') + 11 + 8
    for byte in (255, 64):  # a reference before the beginning, or a run that ends too early
        data = bytearray(path.read_bytes())
        data[start] = byte
        path.write_bytes(data)
        with pytest.raises(SceneError, match='a.pcd: the compressed points are damaged'):
            read_cloud(path)


def test_text_headers(tmp_path):
    rows = '\n0.5 -1 2 255 0 51 2\n3 4 5 0 102 255 0\n6 7 8.5 1 2 3 7\n'
    heads = ['x y z red green blue label', '# x y z red green blue label', '//X Y Z R G B Classification']
    heads += ['"x";"y";"z";"red";"green";"blue";"scalar_Label"', '# made by hand\n# x y z r g b class\n']
    for head in heads:
        (tmp_path / 'a.txt').write_text(head + rows)
        scan = read_scan(tmp_path / 'a.txt', labels=True)
        np.testing.assert_array_equal(scan.cloud.xyz, XYZ)
        np.testing.assert_allclose(scan.cloud.colors, RGB / 255, atol=1e-7)
        assert scan.label.tolist() == LABEL.tolist(), head
    (tmp_path / 'b.csv').write_text('label,z,y,x,time\n3,2,1,0,9\n4,5,4,3,9\n')
    scan = read_scan(tmp_path / 'b.csv', labels=True)
    assert scan.cloud.xyz.tolist() == [[0, 1, 2], [3, 4, 5]] and scan.label.tolist() == [3, 4]
    (tmp_path / 'c.csv').write_text('x,y,z,label\n3,2,1,0\n4,5,4,3,9\n')
    with pytest.raises(SceneError, match="c.csv, line 3: 5 numbers, expected 4: '4,5,4,3,9'"):
        read_cloud(tmp_path / 'c.csv')


def test_columns_by_number_and_name(tmp_path):
    table = np.c_[LABEL, XYZ, RGB, [9, 8, 7]]
    np.save(tmp_path / 'a.npy', table)
    np.savetxt(tmp_path / 'a.txt', table)
    table.astype('<f4').tofile(tmp_path / 'a.bin')
    given = dict(x=1, y=2, z=3, red=4, green=5, blue=6, label=0)
    for name, names in (('a.npy', given), ('a.txt', given), ('a.npy', 'label x y z red green blue -')):
        scan = read_scan(tmp_path / name, names, labels=True)
        np.testing.assert_array_equal(scan.cloud.xyz, XYZ)
        np.testing.assert_allclose(scan.cloud.colors, RGB / 255, atol=1e-7)
        assert scan.label.tolist() == LABEL.tolist() and scan.cloud.intensity is None
    assert read_scan(tmp_path / 'a.npy', given).label is None  # labels are read where they are asked for
    with pytest.raises(SceneError, match='no column 8 for label; the file has 8: 0 1 2 3 4 5 6 7'):
        read_scan(tmp_path / 'a.npy', {**given, 'label': 8})
    with pytest.raises(SceneError, match="columns: unknown part 'colour'"):
        read_scan(tmp_path / 'a.npy', {**given, 'colour': 1})
    with pytest.raises(SceneError, match='no column x, got 0 1 2 3 4 5 6 7; name the columns'):
        read_scan(tmp_path / 'a.npy')
    with pytest.raises(SceneError, match='no column green'):
        read_scan(tmp_path / 'a.npy', dict(x=1, y=2, z=3, red=4))


def test_a_named_file_keeps_what_is_not_mentioned(tmp_path):
    names = dict(zip(('x', 'y', 'z', 'red', 'green', 'blue'), np.c_[XYZ, RGB].T.astype(np.float32), strict=True))
    write_ply(tmp_path / 'a.ply', names | {'scalar_Classification': LABEL, 'tree_id': LABEL, 'i': LABEL})
    scan = read_scan(tmp_path / 'a.ply', dict(label='tree_id', intensity=None), labels=True)
    assert scan.label.tolist() == LABEL.tolist() and scan.cloud.intensity is None and scan.cloud.colors is not None
    assert read_scan(tmp_path / 'a.ply', labels=True).label.tolist() == LABEL.tolist()
    np.testing.assert_array_equal(read_cloud(tmp_path / 'a.ply').intensity, LABEL)


def test_npz_and_structured_npy(tmp_path):
    np.savez(tmp_path / 'a.npz', points=XYZ, rgb=RGB, labels=LABEL, instance=LABEL + 1, pose=np.eye(4), name='scan')
    scan = read_scan(tmp_path / 'a.npz', labels=True)
    np.testing.assert_array_equal(scan.cloud.xyz, XYZ)
    assert scan.label.tolist() == LABEL.tolist() and scan.instance.tolist() == (LABEL + 1).tolist()
    np.savez(tmp_path / 'b.npz', x=XYZ[:, 0], y=XYZ[:, 1], z=XYZ[:, 2], feat=np.zeros((3, 2)))
    assert list(read_columns(tmp_path / 'b.npz')) == ['x', 'y', 'z', 'feat_0', 'feat_1']
    rows = np.zeros(3, dtype=[('x', 'f8'), ('y', 'f8'), ('z', 'f8'), ('label', 'i4')])
    rows['x'], rows['label'] = XYZ[:, 0], LABEL
    np.save(tmp_path / 'c.npy', rows)
    scan = read_scan(tmp_path / 'c.npy', labels=True)
    assert scan.cloud.xyz[:, 0].tolist() == XYZ[:, 0].tolist() and scan.label.tolist() == LABEL.tolist()
    np.savez(tmp_path / 'd.npz', xyz=XYZ, labels=LABEL[:2])
    with pytest.raises(SceneError, match=r'labels: shape \(2,\), but xyz has shape \(3, 3\)'):
        read_scan(tmp_path / 'd.npz')
    np.savez(tmp_path / 'e.npz', xyz=XYZ, label=np.array(['a', 'b', 'c']))
    with pytest.raises(SceneError, match='label: expected numbers, got <U1'):
        read_scan(tmp_path / 'e.npz')


def test_labels_must_be_whole(tmp_path):
    for bad in (1.5, np.inf, 1e300):
        np.savez(tmp_path / 'a.npz', xyz=XYZ, label=np.array([1, 2, bad]))
        with pytest.raises(SceneError, match='a.npz: label: expected whole numbers'):
            read_scan(tmp_path / 'a.npz', labels=True)
    np.savez(tmp_path / 'a.npz', xyz=XYZ, label=np.array([1, 2, np.nan]))
    assert read_scan(tmp_path / 'a.npz', labels=True).label.tolist() == [1, 2, -1]
    np.savez(tmp_path / 'a.npz', xyz=XYZ, intensity=np.array([1, 2, np.nan]))
    with pytest.warns(UserWarning, match='a.npz: intensity: 1 of 3 points are NaN or infinite; they count as 0'):
        assert read_scan(tmp_path / 'a.npz').cloud.intensity.tolist() == [1, 2, 0]


def test_colour_ranges(tmp_path):
    path = tmp_path / 'a'
    dark = np.array([[10, 20, 200]], dtype=np.uint16)
    np.testing.assert_allclose(unit_colors(dark, 'auto', path), dark / 255, atol=1e-7)
    np.testing.assert_allclose(unit_colors(dark, 65535, path), dark / 65535, atol=1e-7)
    np.testing.assert_allclose(unit_colors(dark * 100, 'auto', path), dark / 655.35, atol=1e-7)
    np.testing.assert_allclose(unit_colors(dark / 255, 'auto', path), dark / 255, atol=1e-7)
    np.testing.assert_allclose(unit_colors(dark * 1.0, 'auto', path), dark / 255, atol=1e-7)
    with pytest.raises(SceneError, match='colors: expected 0 to 1, got 10 to 200; pass color_range'):
        unit_colors(dark, 1, path)
    with pytest.raises(SceneError, match='colors: expected 0 to 255, got -1 to 5'):
        unit_colors(np.array([[-1, 5]]), 'auto', path)
    with pytest.raises(ValueError, match='color_range: expected one of'):
        read_scan(path, color_range=256)


def test_label_maps(tmp_path):
    raw = np.array([0, 2, 6, 2])
    assert map_labels(raw, 2, {0: -1, 2: 0, 6: 1}, tmp_path).tolist() == [-1, 0, 1, 0]
    assert map_labels(raw, 7, None, tmp_path).tolist() == [0, 2, 6, 2]
    assert map_labels(np.array([-1]), 7, None, tmp_path).tolist() == [-1]
    assert map_labels(raw, 2, {2: 1}, tmp_path, 'ignore').tolist() == [-1, 1, -1, 1]
    with pytest.raises(SceneError, match=r'label: expected -1 to 5, got 6; map it \(label_map=\{6: CLASS\}'):
        map_labels(raw, 6, None, tmp_path)
    with pytest.raises(SceneError, match=r'label: expected one of \[0, 2\], got 6'):
        map_labels(raw, 2, {0: 0, 2: 1}, tmp_path)


def test_scan_to_arrays_and_back(tmp_path):
    np.savez(tmp_path / 'a.npz', xyz=XYZ + 5e5, colors=RGB, label=LABEL)
    scan = read_scan(tmp_path / 'a.npz', labels=True)
    again = Scan.from_arrays(scan.to_arrays())
    np.testing.assert_array_equal(again.cloud.xyz.astype(float) + again.cloud.origin, XYZ + 5e5)
    np.testing.assert_array_equal(again.cloud.colors, scan.cloud.colors)
    assert again.label.tolist() == LABEL.tolist() and again.instance is None and again.cloud.sensor is None


def write_las(path, ending, xyz, classification, colors=None):
    laspy = pytest.importorskip('laspy')
    las = laspy.create(point_format=3 if colors is not None else 1, file_version='1.2')
    las.header.scales, las.header.offsets = [0.001] * 3, [400000, 5000000, 0]
    las.x, las.y, las.z = xyz.T
    las.classification = classification
    las.intensity = np.arange(len(xyz)) * 100
    if colors is not None:
        las.red, las.green, las.blue = colors.T
    las.write(path.with_suffix(ending))
    return path.with_suffix(ending)


@pytest.mark.parametrize('ending', ['.las', '.laz'])
def test_las_keeps_utm_coordinates(tmp_path, ending):
    world = XYZ + [400123.456, 5000987.654, 12.5]
    path = write_las(tmp_path / 'a', ending, world, LABEL.astype(np.uint8), RGB.astype(np.uint16) * 257)
    scan = read_scan(path, labels=True)
    np.testing.assert_allclose(scan.cloud.xyz.astype(float) + scan.cloud.origin, world, atol=1e-6)
    np.testing.assert_allclose(scan.cloud.colors, RGB / 255, atol=1e-7)
    assert scan.label.tolist() == LABEL.tolist() and scan.cloud.intensity.tolist() == [0, 100, 200]
    black = write_las(tmp_path / 'b', ending, world, LABEL.astype(np.uint8), np.zeros((3, 3), dtype=np.uint16))
    assert read_scan(black).cloud.colors is None
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(SceneError, match='a.la[sz]: not readable as LAS or LAZ'):
        read_scan(path)


def test_las_without_laspy_names_the_extra(tmp_path, monkeypatch):
    (tmp_path / 'a.las').write_bytes(b'LASF')
    real = builtins.__import__

    def no_laspy(name, *args, **kwargs):
        if name == 'laspy':
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, '__import__', no_laspy)
    with pytest.raises(SceneError, match=r'a.las: LAS and LAZ need laspy; pip install "rm3d_plugin\[las\]"'):
        read_cloud(tmp_path / 'a.las')


def test_every_ending_has_a_reader():
    assert tuple(sorted(_readers())) == ENDINGS


def test_native_files_of_oakland_are_tables_with_names(tmp_path):
    path = tmp_path / 'oakland_part2_ac.xyz_label_conf'
    head = '#Thu Aug  7 2008 \n#File format: x y z label_id confidence \n#  Ground truth => confidence = 2 \n'
    path.write_text(head + '#  1103 -- utility_pole \n15.41 -28.32 2.06 1302 2\n1 2 3 1103 1\n')
    columns = read_columns(path)
    assert list(columns) == ['x', 'y', 'z', 'label_id', 'confidence']
    scan = read_scan(path, labels=True)
    assert scan.label.tolist() == [1302, 1103] and scan.cloud.xyz[1].tolist() == [1, 2, 3]
    bare = tmp_path / 'part3_aj.xyz_label_conf'
    bare.write_text('15.41 -28.32 2.06 1302 2\n1 2 3 1103 1\n')
    assert read_scan(bare, labels=True).label.tolist() == [1302, 1103]
    same = tmp_path / 'same.txt'
    same.write_bytes(path.read_bytes())
    assert read_scan(same, labels=True).label.tolist() == [1302, 1103]


def test_six_floats_are_colours_where_they_look_like_them(tmp_path):
    rng = np.random.default_rng(0)
    place, colors = rng.uniform(-4, 4, (80, 3)), rng.integers(0, 256, (80, 3))
    np.c_[place, colors].astype('<f4').tofile(tmp_path / 'room.bin')
    with pytest.warns(UserWarning, match=r'6 float32 a point \(x y z red green blue\)'):
        cloud = read_cloud(tmp_path / 'room.bin')
    np.testing.assert_allclose(cloud.colors, colors / 255, atol=1e-6)
    ringed = np.c_[place, rng.integers(0, 256, 80), np.arange(80) % 32, np.linspace(0, 0.5, 80)]
    ringed.astype('<f4').tofile(tmp_path / 'sweeps.bin')
    with pytest.warns(UserWarning, match=r'x y z intensity - -'):
        cloud = read_cloud(tmp_path / 'sweeps.bin')
    assert cloud.colors is None
    np.testing.assert_array_equal(cloud.intensity, ringed[:, 3])


@pytest.mark.parametrize('width', [3, 4])
def test_doubles_are_told(tmp_path, width):
    table = np.random.default_rng(0).uniform(-40, 40, (90, width))
    table.tofile(tmp_path / 'a.bin')
    with pytest.raises(SceneError, match=r'a\.bin: looks like float64 numbers; expected float32'):
        read_cloud(tmp_path / 'a.bin')
    single = table.astype('<f4')
    single[::10] = np.nan  # as many as some scanners leave, and still no doubles
    single.tofile(tmp_path / 'b.bin')
    with pytest.raises(SceneError, match='NaN or infinite'):
        read_cloud(tmp_path / 'b.bin', 'x y z intensity'[: 2 * width - 1] if width == 3 else None)


def test_complex_numbers_are_refused(tmp_path):
    np.save(tmp_path / 'a.npy', np.ones((4, 3), dtype=complex))
    with pytest.raises(SceneError, match=r'a\.npy: x: expected numbers, got complex128'):
        read_cloud(tmp_path / 'a.npy')


@pytest.mark.parametrize('order', ['<', '>'])
def test_faces_and_empty_elements_before_the_vertices(tmp_path, order):
    header = (
        f'ply\nformat binary_{"little" if order == "<" else "big"}_endian 1.0\nelement mesh 2\nelement face 2\n'
        'property list uchar int vertex_indices\nelement vertex 2\nproperty float x\nproperty list uchar short n\n'
        'property float y\nproperty double z\nend_header\n'
    )
    faces = struct.pack(f'{order}B3iB2i', 3, 0, 1, 0, 2, 1, 0)
    rows = struct.pack(f'{order}fBhfd', 1, 1, 7, 2, 3) + struct.pack(f'{order}fBfd', 4, 0, 5, 6)
    (tmp_path / 'a.ply').write_bytes(header.encode() + faces + rows)
    np.testing.assert_array_equal(read_cloud(tmp_path / 'a.ply').xyz, [[1, 2, 3], [4, 5, 6]])
