"""Files as other programs and slips of the hand make them: the right value, or a message that names the fault.

``test_the_folder`` walks ``hard_inputs`` of the real scans; the other tests make the same kinds of fault themselves.
"""

import warnings

import numpy as np
import pytest

from rm3d_plugin.datasets.downsampled import thin_voxels
from rm3d_plugin.datasets.files import FilesDataset
from rm3d_plugin.datasets.kitti_format import objects_to_boxes, read_calib, read_objects
from rm3d_plugin.datasets.segmentation import only_things
from rm3d_plugin.datasets.semantickitti import SemanticKittiDataset
from rm3d_plugin.ops.ground import segment_ground
from rm3d_plugin.storage.columns import read_columns
from rm3d_plugin.storage.scans import read_scan
from rm3d_plugin.structures import SceneError, stray_points

UTM = np.array([500123.0, 5411934.0, 312.0])


def world(cloud):
    return cloud.xyz.astype(np.float64) + cloud.origin


def read(path, **options):
    """The scan, and what was said."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        scan = read_scan(path, labels=True, **options)
    return scan, ' | '.join(str(item.message) for item in caught)


# ------------------------------------------------------------------ the folder


def first_points(name):
    return lambda folder: np.testing.assert_allclose(world(read(folder / name)[0].cloud)[0], FIRST[name])


FIRST = {'pandas_index_xyz.csv': [10.5, 20.5, 1.5], 'decimal_comma.csv': [1.5, 2.25, 0.5], 'count_line.xyz': [1, 2, 3]}


def semicolons(folder):
    scan, _ = read(folder / 'cc_semicolon_space.txt')
    np.testing.assert_allclose(scan.cloud.colors[0], np.array([255, 128, 0]) / 255, atol=1e-6)
    assert scan.cloud.intensity is None and 'Scalar field' in read_columns(folder / 'cc_semicolon_space.txt')


def labels_one_and_two(name):
    def check(folder):
        scan, _ = read(folder / name)
        assert scan.label.tolist() == [1, 2] and scan.cloud.intensity is None

    return check


def float_colours(folder):
    np.testing.assert_array_equal(read(folder / 'cc_float_colours.txt')[0].cloud.colors[0], [1, 0.5, 0.25])


def ambiguous(name, reading):
    def check(folder):
        assert 'seven columns without names are ambiguous; read as' in (said := read(folder / name)[1])
        assert reading in said

    return check


def nuscenes(folder):
    assert len(read(folder / 'nuscenes.pcd.bin')[0].cloud) == 400


def utm_with_a_zero(folder):
    real = np.load(folder / 'utm_one_zero.npy')
    scan, _ = read(folder / 'utm_one_zero.npy')
    stray = stray_points(real[:, :3])
    assert stray.sum() == 1 and not real[stray][0, :3].any()
    assert np.abs(world(scan.cloud) - real[:, :3])[~stray].max() < 1e-6
    dataset = FilesDataset(folder, split='val', files='utm_one_zero.npy', cache=None)
    with pytest.warns(UserWarning, match='1 of 1201 points lie far from all others .* at 0, 0, 0'):
        assert len(dataset.load_cloud(0)) == 1200


def zero_normals(folder):
    assert read(folder / 'corner_zero_normals.ply')[0].cloud.normals is None


def millimetres(folder):
    assert 'are these millimetres?' in read(folder / 'corner_mm.xyz')[1]
    assert read(folder / 'corner.ply')[1] == ''


def two_instances(folder):
    dataset = FilesDataset(folder / 'inst', split='val', classes=('a', 'b', 'c'), things=('b', 'c'), cache=None)
    truth = dataset.load_truth(0)
    assert {tuple(pair) for pair in np.c_[truth.semantic, truth.instance] if pair[1] >= 0} == {(1, 0), (2, 1)}


def small_letters(folder):
    frame = folder / 'kitti_lower' / 'training'
    objects = read_objects(frame / 'label_2' / '000000.txt')
    boxes = objects_to_boxes(objects, read_calib(frame / 'calib' / '000000.txt'), ('Pedestrian', 'Cyclist', 'Car'))
    assert [item.type for item in objects] == ['Car'] and boxes.labels.tolist() == [2]


def ground_with_a_stray(folder):
    xyz = np.load(folder / 'ground_stray_2km.npy')
    found = segment_ground(xyz)
    far = np.abs(xyz).max(axis=1) > 1000
    assert far.sum() == 1 and not found.is_ground[far].any()
    np.testing.assert_array_equal(found.is_ground[~far], segment_ground(xyz[~far]).is_ground)


def organised(folder):
    with pytest.raises(SceneError, match="4 of 12 points are NaN or infinite; .*nan_points='drop'"):
        read(folder / 'organised_nan.pcd')
    scan, said = read(folder / 'organised_nan.pcd', nan_points='drop')
    assert len(scan.cloud) == 8 and '4 of 12 points are NaN or infinite; they are dropped' in said
    assert tuple(scan.cloud.sensor) == (1.0, 2.0, 0.5)


def nan_intensity(folder):
    scan, said = read(folder / 'nan_intensity.ply')
    assert len(scan.cloud) == 6 and 'intensity: 1 of 6 points are NaN or infinite; they count as 0' in said


def nan_label(folder):
    assert -1 in read(folder / 'cc_nan_label.ply')[0].label


def holds(name, count):
    def check(folder):
        assert len(read(folder / name)[0].cloud) == count

    return check


def error_with(name, message):
    def check(folder):
        with pytest.raises(SceneError, match=message):
            read(folder / name)

    return check


def five_columns(folder):
    with pytest.raises(SceneError, match='looks like 5 columns of float32 a point'):
        SemanticKittiDataset(folder / 'semantickitti_5col', split='val').load_cloud(0)


CHECKS = {
    'pandas_index_xyz.csv': first_points('pandas_index_xyz.csv'),
    'decimal_comma.csv': first_points('decimal_comma.csv'),
    'count_line.xyz': first_points('count_line.xyz'),
    'cc_semicolon_space.txt': semicolons,
    'empty_column.csv': labels_one_and_two('empty_column.csv'),
    'header_then_comment.txt': labels_one_and_two('header_then_comment.txt'),
    'cc_float_colours.txt': float_colours,
    'cc_unnamed_alpha.xyz': ambiguous('cc_unnamed_alpha.xyz', 'x y z red green blue alpha'),
    'xyzrgbl.txt': ambiguous('xyzrgbl.txt', 'x y z red green blue label'),
    'nuscenes.pcd.bin': nuscenes,
    'utm_one_zero.npy': utm_with_a_zero,
    'utm_room_one_zero.ply': holds('utm_room_one_zero.ply', 1501),
    'corner.ply': holds('corner.ply', 1200),
    'corner_zero_normals.ply': zero_normals,
    'corner_mm.xyz': millimetres,
    'inst': two_instances,
    'kitti_lower': small_letters,
    'ground_stray_2km.npy': ground_with_a_stray,
    'organised_nan.pcd': organised,
    'nan_intensity.ply': nan_intensity,
    'cc_nan_label.ply': nan_label,
    'big_endian.ply': holds('big_endian.ply', 6),
    'list_in_vertex.ply': holds('list_in_vertex.ply', 6),
    'columns.pcd': holds('columns.pcd', 12),
    'modelnet.txt': error_with('modelnet.txt', "look like normals; say so: columns='x y z nx ny nz'"),
    'semantickitti_5col': five_columns,
    't.npy': error_with('t.npy', r'shape \(3, \d+\).*save the transposed array'),
}


def test_the_folder(real_data):
    folder = real_data / 'hard_inputs'
    if not folder.is_dir():
        pytest.skip(f'{folder} is not there')
    assert {path.name for path in folder.iterdir()} - {'README.md'} == CHECKS.keys()
    for check in CHECKS.values():
        check(folder)


# ------------------------------------------------------------------ text


@pytest.mark.parametrize(
    ('text', 'names', 'first'),
    [
        (',x,y,z\n0,10.5,20.5,1.5\n', ['x', 'y', 'z'], [10.5, 20.5, 1.5]),
        ('1,5;2,25;0,5\n', ['x', 'y', 'z'], [1.5, 2.25, 0.5]),
        ('1,5 2,25 0,5\n', ['x', 'y', 'z'], [1.5, 2.25, 0.5]),
        ('1,5\t2,25\t0,5\n', ['x', 'y', 'z'], [1.5, 2.25, 0.5]),
        ('"1,5","2,25","0,5"\n', ['x', 'y', 'z'], [1.5, 2.25, 0.5]),
        ('"x";"y";"z";"my field"\n1;2;3;4\n', ['x', 'y', 'z', 'my field'], [1, 2, 3, 4]),
        ('X\tY\tZ\tScalar field\n1\t2\t3\t4\n', ['X', 'Y', 'Z', 'Scalar field'], [1, 2, 3, 4]),
        ('//X Y Z\n2\n1 2 3\n4 5 6\n', ['X', 'Y', 'Z'], [1, 2, 3]),
        ('2\nx y z\n1 2 3\n4 5 6\n', ['x', 'y', 'z'], [1, 2, 3]),
        ('x,y,z,label\nm,m,m,-\n1,2,3,4\n', ['x', 'y', 'z', 'label'], [1, 2, 3, 4]),
        ('# x y z label\n# units: m\n1 2 3 4\n', ['x', 'y', 'z', 'label'], [1, 2, 3, 4]),
        ('x,y,z,intensity,label\n1,2,3,,4\n', ['x', 'y', 'z', 'intensity', 'label'], [1, 2, 3, np.nan, 4]),
        ('x;y;z;label\n1;2;3;\n', ['x', 'y', 'z', 'label'], [1, 2, 3, np.nan]),
        ('1;2;3;\n4;5;6;\n', ['x', 'y', 'z'], [1, 2, 3]),
        ('x y z\r\n1 2 3\r\n', ['x', 'y', 'z'], [1, 2, 3]),
        ('\ufeffx,y,z\n1,2,3\n', ['x', 'y', 'z'], [1, 2, 3]),
        ('1, 2, 3\n4 5 6\n', ['x', 'y', 'z'], [1, 2, 3]),
    ],
)
def test_text_headers_and_cells(tmp_path, text, names, first):
    path = tmp_path / 'a.txt'
    path.write_text(text, encoding='utf-8', newline='')
    columns = read_columns(path)
    assert list(columns) == names
    np.testing.assert_array_equal([values[0] for values in columns.values()], first)


def test_utf_16_text(tmp_path):
    (tmp_path / 'a.txt').write_text('x y z\n1 2 3\n', encoding='utf-16')
    assert read_columns(tmp_path / 'a.txt')['z'].tolist() == [3]


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('x,y,z,label\n1,2,3\n', 'header names 4 columns .x y z label., but a row has 3'),
        ('x,y,z\n1,5,2,25,0,5\n', 'names 3 columns .*, but a row has 6; .*decimal commas'),
        ('x;y;z;a;a\n1;2;3;4;5\n', "names two columns 'a'"),
        ('3\n1 2 3\n4 5 6\n', '2 points, but a line announces 3; cut off'),
        ('1 2 3\n1 2\n', 'line 2: 2 numbers, expected 3'),
        ('x;y;z\n1;2;3\n1 2;3;4\n', 'line 3: two words in one cell'),
        ('easting northing height\n1 2 3\n', 'no column x, got easting northing height; name the columns'),
        ('0.1 0.2 0.3 0.0 0.6 0.8\n' * 3, 'look like normals'),
    ],
)
def test_text_faults_are_named(tmp_path, text, message):
    path = tmp_path / 'a.txt'
    path.write_text(text)
    with pytest.raises(SceneError, match=message) as caught:
        read_scan(path)
    assert str(path) in str(caught.value)


def test_a_reading_that_is_told_is_not_questioned(tmp_path):
    (tmp_path / 'a.txt').write_text('1 2 3 200 100 50 4\n' * 3)
    scan, said = read(tmp_path / 'a.txt', columns='x y z red green blue label')
    assert scan.label.tolist() == [4] * 3 and said == ''
    assert read(tmp_path / 'a.txt', columns=dict(red=3, green=4, blue=5, label=6, intensity=None))[1] == ''


# ------------------------------------------------------------------ binary


@pytest.mark.parametrize('width', [3, 4, 5, 6])
def test_width_of_float_records(tmp_path, width):
    rng = np.random.default_rng(0)
    table = np.c_[rng.normal(0, 20, (500, 2)), rng.normal(-1, 1, 500), rng.random(500), rng.integers(0, 32, 500)]
    table = np.c_[table, np.full(500, 0.05)][:, :width].astype('<f4')
    table.tofile(tmp_path / 'a.bin')
    scan, said = read(tmp_path / 'a.bin')
    np.testing.assert_array_equal(scan.cloud.xyz, table[:, :3])
    assert (f'read as {width} float32' in said) == (width != 4)


def ply(form, properties, body):
    lines = [
        'ply',
        f'format {form} 1.0',
        'element vertex 2',
        *(f'property {line}' for line in properties),
        'end_header\n',
    ]
    return '\n'.join(lines).encode() + body


def test_ply_of_either_byte_order_with_lists(tmp_path):
    for order, form in (('<', 'binary_little_endian'), ('>', 'binary_big_endian')):
        rows = b''
        for number, seen in ((1, [7, 8]), (2, [])):
            rows += (
                np.array([number], f'{order}i8').tobytes() + bytes([len(seen)]) + np.array(seen, f'{order}i4').tobytes()
            )
            rows += np.array([number, 5, 6], f'{order}f8').tobytes() + b'\1'
        properties = ['int64 label', 'list uchar int seen', 'double x', 'double y', 'double z', 'bool flag']
        (tmp_path / 'a.ply').write_bytes(ply(form, properties, rows))
        columns = read_columns(tmp_path / 'a.ply')
        assert list(columns) == ['label', 'x', 'y', 'z', 'flag'] and columns['label'].tolist() == [1, 2]
        assert columns['x'].tolist() == [1, 2] and columns['flag'].tolist() == [1, 1]
        (tmp_path / 'a.ply').write_bytes(ply(form, properties, rows[:-9]))
        with pytest.raises(SceneError, match='lists of element vertex run past the end'):
            read_columns(tmp_path / 'a.ply')


@pytest.mark.parametrize('value', ['300', '1.5', '-1', 'nan'])
def test_integers_of_ascii_ply_are_checked(tmp_path, value):
    properties = ['float x', 'float y', 'float z', 'list uchar int seen', 'uchar label']
    (tmp_path / 'a.ply').write_bytes(ply('ascii', properties, f'1 2 3 2 9 9 255\n1 2 3 0 {value}\n'.encode()))
    with pytest.raises(SceneError, match='a.ply: label: expected a whole number that uint8 holds'):
        read_columns(tmp_path / 'a.ply')


def pcd(count, form='ascii', rows=2):
    head = f'FIELDS x y z _\nSIZE 4 4 4 1\nTYPE F F F U\nCOUNT 1 1 1 {count}\nWIDTH {rows}\nHEIGHT 1\nPOINTS {rows}\n'
    return f'{head}DATA {form}\n'.encode()


@pytest.mark.parametrize('form', ['ascii', 'binary', 'binary_compressed'])
@pytest.mark.parametrize('count', [-1, 10**9, 10**15])
def test_absurd_counts_of_pcd_are_refused_at_once(tmp_path, form, count):
    (tmp_path / 'a.pcd').write_bytes(pcd(count, form) + b'1 2 3 0\n4 5 6 0\n')
    with pytest.raises(SceneError, match='a.pcd'):
        read_columns(tmp_path / 'a.pcd')


# ------------------------------------------------------------------ channels and places


def test_normals_of_any_length(tmp_path):
    np.savez(tmp_path / 'a.npz', xyz=np.eye(3), normals=[[0, 0, 5.0], [np.nan, 0, 1], [3e-300, 4e-300, 0]])
    scan, said = read(tmp_path / 'a.npz')
    np.testing.assert_allclose(scan.cloud.normals, [[0, 0, 1], [0, 0, 0], [0.6, 0.8, 0]], atol=1e-6)
    assert 'normals: 1 of 3 points are NaN or infinite; they count as 0' in said


def test_stray_points_move_no_origin_and_get_no_label(tmp_path):
    xyz = np.random.default_rng(1).random((400, 3)) * [8, 8, 3] + UTM
    strays = [[0, 0, 0], [3e38, 0, 0]]
    np.savez(tmp_path / 'a.npz', xyz=np.concatenate([xyz[:200], strays, xyz[200:]]), label=np.ones(402, np.int32))
    cloud = read_scan(tmp_path / 'a.npz').cloud
    keep = np.r_[:200, 202:402]
    assert np.abs(world(cloud)[keep] - xyz).max() < 1e-6
    dataset = FilesDataset(tmp_path, split='val', classes=('a', 'b'), labels='truth', cache=None)
    with pytest.warns(UserWarning, match=r'2 of 402 points lie far .*the first is point 200 at 0, 0, 0'):
        item = dataset.raw(0)
    assert item['num_points'] == 400 and (item['semantic'] == 1).all()
    truth = item['annotation']
    assert truth.semantic[200:202].tolist() == [-1, -1] and (truth.semantic[keep] == 1).all()
    np.testing.assert_array_equal(dataset.original_index(0)[keep], np.arange(400))


def test_lost_digits_degrees_and_millimetres_are_suspected(tmp_path):
    rng = np.random.default_rng(2)
    wall = rng.random((1000, 3)) * [5, 5, 3]
    cases = {
        'float32, in steps of 0.5 m': (wall + UTM).astype(np.float32),
        'look like degrees': np.c_[wall[:, :2] * 1e-5 + [11.5, 48.1], wall[:, 2]],
        'are these millimetres': wall * 1000,
    }
    for message, xyz in cases.items():
        np.save(tmp_path / 'a.npy', xyz)
        assert message in read(tmp_path / 'a.npy')[1]
    for xyz in (wall, wall + UTM):
        np.save(tmp_path / 'a.npy', xyz)
        assert read(tmp_path / 'a.npy')[1] == ''


def test_a_voxel_grid_that_overflows_is_an_error_at_any_size():
    for far in (1e15, 1e18, 1e300):
        with pytest.raises(ValueError, match='a point lies'):
            thin_voxels(np.array([[far, 0, 0], [0, 0, 0]]), 0.001)


def test_ground_costs_what_the_points_cost():
    rng = np.random.default_rng(3)
    sparse = np.c_[rng.random((1000, 2)) * 20_000, np.zeros(1000)]
    with pytest.warns(UserWarning, match='cells of .* m are used .are the coordinates metres'):
        assert segment_ground(sparse).is_ground.all()


def test_instances_are_pairs_of_class_and_number():
    semantic, instance = np.array([1, 1, 2, 2, 0, 1]), np.array([1, 1, 1, 4, 1, -1])
    assert only_things(instance, semantic, (1, 2)).tolist() == [0, 0, 1, 2, -1, -1]


def test_bad_scenes_of_any_kind_are_skipped_with_file_and_reason(tmp_path):
    np.savez_compressed(tmp_path / 'torn.npz', xyz=np.zeros((500, 3)))
    data = bytearray((tmp_path / 'torn.npz').read_bytes())
    data[60:90] = b'\xff' * 30
    (tmp_path / 'torn.npz').write_bytes(bytes(data))
    (tmp_path / 'header.npy').write_bytes(b'\x93NUMPY\x01\x00\x10\x00{"descr": ((((((\n')
    np.save(tmp_path / 'good.npy', np.eye(3))
    dataset = FilesDataset(tmp_path, split='val', bad_scenes='skip', cache=None)
    with pytest.warns(UserWarning, match='2 of 3 scenes cannot be used and are left out: .*header.npy.*torn.npz'):
        assert dataset.scene_ids == ('good',)


def test_kitti_labels_with_a_mark_and_crlf(tmp_path):
    line = 'car 0 0 0 1 1 2 2 1.5 1.6 4 1 1.5 20 0\r\n'
    (tmp_path / 'a.txt').write_bytes(b'\xef\xbb\xbf' + (line * 2).encode())
    assert [item.type for item in read_objects(tmp_path / 'a.txt')] == ['Car', 'Car']
