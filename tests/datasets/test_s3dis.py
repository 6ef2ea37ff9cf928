"""S3DIS' native files, rooms of a few points worked by hand, and the files that its release has wrong."""

import numpy as np
import pytest

from rm3d_plugin.datasets import DatasetNotFoundError
from rm3d_plugin.datasets.s3dis import S3DISDataset
from rm3d_plugin.datasets.s3dis_format import CLASSES, list_objects, read_object
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.structures import SceneError

OBJECTS = {
    'ceiling_1': '1.5 2.25 3.125 10 20 30\n1.6 2 3 255 0 1\n',
    'chair_2': '0 0 0.5 1 2 3\n',
    'chair_10': '0 1 0.5 1 2 3\r\n0 2 0.5 4 5 6\r\n',
    'table_1': '-0.125 1e-1 .5 7 8 9\n',
    'stairs_1': '2 2 2 0 0 0',
}
# by class name, then number: ceiling_1, chair_2, chair_10, stairs_1, table_1
XYZ = [[1.5, 2.25, 3.125], [1.6, 2, 3], [0, 0, 0.5], [0, 1, 0.5], [0, 2, 0.5], [2, 2, 2], [-0.125, 0.1, 0.5]]
RGB = [[10, 20, 30], [255, 0, 1], [1, 2, 3], [1, 2, 3], [4, 5, 6], [0, 0, 0], [7, 8, 9]]
SEMANTIC = [0, 0, 8, 8, 8, 12, 7]
INSTANCE = [0, 0, 1, 2, 2, 3, 4]


def write_room(root, room, objects=OBJECTS):
    folder = root / room / 'Annotations'
    folder.mkdir(parents=True)
    for name, text in objects.items():
        (folder / f'{name}.txt').write_bytes(text.encode('latin-1'))
    return folder


@pytest.fixture
def world(tmp_path):
    for area in range(1, 7):
        write_room(tmp_path / 's3dis', f'Area_{area}/office_1')
    return tmp_path / 's3dis'


def build(world, **options):
    return S3DISDataset(world, **{'cache': None, 'split': 'test', **options})


def test_the_room_by_hand(world, tmp_path):
    config = {
        'type': 'rm3d_plugin.S3DISDataset',
        'data_root': str(world),
        'split': 'test',
        'cache': str(tmp_path / 'c'),
    }
    for _ in range(3):  # parsed, then twice from the cache
        dataset = DATASETS.build(config)
        cloud, truth = dataset.load_cloud(0), dataset.load_truth(0)
        assert dataset.scene_ids == ('Area_5_office_1',)
        np.testing.assert_array_equal(cloud.xyz, np.float32(XYZ))
        np.testing.assert_array_equal(cloud.colors, np.float32(RGB) / np.float32(255))
        assert truth.semantic.tolist() == SEMANTIC and truth.instance.tolist() == INSTANCE
        assert truth.semantic.dtype == truth.instance.dtype == np.int64
        assert dataset.original_index(0).tolist() == list(range(7))
        assert dataset.thing_classes == tuple(range(13))
        assert len(list((tmp_path / 'c').glob('*.npz'))) == 1


def test_a_changed_file_is_read_anew(world, tmp_path):
    first = build(world, cache=tmp_path / 'c').load_cloud(0)
    (world / 'Area_5/office_1/Annotations/chair_2.txt').write_text('0 0 0.75 1 2 3\n0 0 0 1 1 1\n')
    second = build(world, cache=tmp_path / 'c').load_cloud(0)
    assert len(second) == len(first) + 1 and second.xyz[2].tolist() == [0, 0, 0.75]


def test_class_order():
    assert CLASSES == tuple(
        'ceiling floor wall beam column window door table chair sofa bookcase board clutter'.split()
    )


def test_areas_of_the_six_folds(world):
    for area in range(1, 7):
        test, train = build(world, test_area=area), build(world, test_area=area, split='train')
        assert test.scene_ids == (f'Area_{area}_office_1',)
        assert train.scene_ids == tuple(f'Area_{k}_office_1' for k in range(1, 7) if k != area)
    with pytest.raises(ValueError, match='test_area: expected 1 to 6, got 7'):
        build(world, test_area=7)
    with pytest.raises(ValueError, match='split: expected one of train, test'):
        build(world, split='val')
    with pytest.raises(ValueError, match="labels='truth' is for splits that metrics are measured on"):
        build(world, split='train', labels='truth')


def test_fewer_things(world):
    dataset = build(world, things=('chair', 'table'))
    assert dataset.thing_classes == (7, 8)
    assert dataset.load_truth(0).instance.tolist() == [-1, -1, 0, 1, 1, -1, 2]
    with pytest.raises(ValueError, match="things: 'lamp' is no class"):
        build(world, things=('lamp',))


def test_thinned_instances_have_no_gaps(world):
    dataset = build(world, voxel_downsample=1.2, labels='truth')
    rows = dataset.original_index(0)
    # cells of 1.2 m, (x, y, z): (1,1,2) (1,1,2) (0,0,0) (0,0,0) (0,1,0) (1,1,1) (-1,0,0)
    assert rows.tolist() == [0, 0, 1, 1, 2, 3, 4]
    item = dataset[0]
    assert item['semantic'].tolist() == [0, 8, 8, 12, 7] and item['instance'].tolist() == [0, 1, 2, 3, 4]
    np.testing.assert_array_equal(item['points'][:, :3], np.float32(XYZ)[[0, 2, 4, 5, 6]])


def test_what_lies_about_in_the_release(tmp_path):
    objects = {
        'ceiling_1': '0 0 0 1 1 1\n',
        'wall_3': '0 0 1 1 1 1\n',
        'wall_3 (1)': '0 0 1 1 1 1\n',
        '._wall_3': '\x00',
    }
    folder = write_room(tmp_path, 'Area_6/copyRoom_1', objects)
    (folder / '.DS_Store').write_bytes(b'\x00\x01')
    (folder / 'Icon\r').write_bytes(b'')
    (folder.parent / 'copy_Room_1.txt').write_text('0 0 0 1 1 1\n0 0 1 1 1 1\n')
    (tmp_path / 'Area_6' / '.DS_Store').write_bytes(b'\x00')
    (tmp_path / 'Area_6' / 'Area_6_alignmentAngle.txt').write_text('## angles\ncopyRoom_1 180\n')
    dataset = build(tmp_path, test_area=6)
    assert dataset.scene_ids == ('Area_6_copyRoom_1',)
    with pytest.warns(UserWarning, match=r'wall_3 \(1\).txt: a second copy of wall_3.txt, left out'):
        assert dataset.load_truth(0).semantic.tolist() == [0, 2]
    (folder / 'wall_3.txt').unlink()
    assert [item.name for item in list_objects(folder)] == ['ceiling', 'wall']


@pytest.mark.parametrize(
    ('line', 'expected'),
    [
        (b'22.350 6.692 3.048 185\x00187 182', [22.35, 6.692, 3.048, 185, 187, 182]),  # a blank without its bit 0x20
        (b'19.302 -9.1\x160 1.785 146 137 106', [19.302, -9.16, 1.785, 146, 137, 106]),  # a 6 without it
        (b'0.5775 -12.4075 2.604 167.\x1000000 175.0 177.0', [0.5775, -12.4075, 2.604, 167, 175, 177]),
        (b'1 2 3 \x01 4 5 6', [1, 2, 3, 4, 5, 6]),
        (b'1 2 3 4 5 6\xa0', [1, 2, 3, 4, 5, 6]),
    ],
)
def test_stray_bytes(tmp_path, line, expected):
    path = tmp_path / 'ceiling_1.txt'
    path.write_bytes(b'1 1 1 2 2 2\n' + line + b'\n3 3 3 4 4 4\n')
    with pytest.warns(UserWarning, match=r'ceiling_1.txt, line 2: stray byte in .*, read as'):
        table = read_object(path)
    assert table.tolist() == [[1, 1, 1, 2, 2, 2], expected, [3, 3, 3, 4, 4, 4]]


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        (b'', 'holds no points'),
        (b'1 2 3 4 5 6\n1 2 3 4 5\n', "line 2: 5 numbers, expected 6: '1 2 3 4 5'"),
        (b'1 2 3 185187 6\n', 'line 1: 5 numbers, expected 6'),
        (b'1 2 3 4 5 6 7\n', 'line 1: 7 numbers, expected 6'),
        (b'1 2 3 4\x00 5\n', 'line 1: '),
        (b'1 2 x\x00 4 5 6\n', 'line 1: '),
        (b'1 2 3 4 5 6\x17\n', 'line 1: '),  # 6 or 67
        (b'1 2 3 4 5 6\n\nnan 2 3 4 5 6\n', 'line 3: x is nan, expected a finite number'),
        (b'1 2 3 4 5 256\n', 'line 1: blue is 256.0, expected 0 to 255'),
        (b'1 2 3 -4 5 6\n', 'line 1: red is -4.0, expected 0 to 255'),
    ],
)
def test_bad_lines_are_named(tmp_path, text, message):
    path = tmp_path / 'ceiling_1.txt'
    path.write_bytes(text)
    with pytest.raises(SceneError, match=message) as caught:
        read_object(path)
    assert str(path) in str(caught.value)


def test_a_smudged_file_is_not_repaired_for_ever(tmp_path):
    path = tmp_path / 'ceiling_1.txt'
    path.write_bytes(b'1 2 3 4\x005 6\n' * 30)
    with pytest.raises(SceneError, match='line 21'), pytest.warns(UserWarning, match='stray byte'):
        read_object(path)


def test_bad_rooms_are_named(world):
    folder = world / 'Area_5' / 'office_1' / 'Annotations'
    (folder / 'lamp_1.txt').write_text('0 0 0 1 1 1\n')
    with pytest.raises(SceneError, match="lamp_1.txt: unknown class 'lamp'; expected one of ceiling"):
        build(world).load_cloud(0)
    (folder / 'lamp_1.txt').rename(folder / 'notes.txt')
    with pytest.raises(SceneError, match='notes.txt: expected a name like chair_3.txt'):
        build(world).load_cloud(0)
    for path in folder.iterdir():
        path.unlink()
    with pytest.raises(SceneError, match='holds no objects'):
        build(world).load_cloud(0)
    (folder.parent / 'office_1.txt').write_text('')
    folder.rmdir()
    with pytest.raises(SceneError, match='Area_5_office_1: .*Annotations: no such folder'):
        build(world)[0]


def test_layout_help(tmp_path):
    with pytest.raises(DatasetNotFoundError, match='no room in Area_5(.|\n)*Annotations/'):
        len(build(tmp_path))


def test_a_single_point(tmp_path):
    write_room(tmp_path, 'Area_5/tiny_1', {'board_1': '1 2 3 4 5 6'})
    item = build(tmp_path, labels='truth')[0]
    assert item['points'].shape == (1, 6) and item['semantic'].tolist() == [11] and item['instance'].tolist() == [0]


def test_what_lies_in_folders_beside_the_data(world):
    """Hidden files do not count, texts of other programs are read, rooms and areas that lack are told."""
    folder = world / 'Area_1/office_1/Annotations'
    plain = S3DISDataset(world, cache=None).load_cloud(0)
    for name in ('._chair_2.txt', '.DS_Store', 'Thumbs.db'):
        (folder / name).write_bytes(b'\x00\x05')
    (world / 'Area_1/._office_1/Annotations').mkdir(parents=True)
    text = (folder / 'chair_10.txt').read_text()
    (folder / 'chair_10.txt').write_bytes(text.encode('utf-16'))
    (folder / 'ceiling_1.txt').write_bytes(b'\xef\xbb\xbf' + (folder / 'ceiling_1.txt').read_bytes())
    dataset = S3DISDataset(world, cache=None)
    assert dataset.scene_ids[0] == 'Area_1_office_1' and len(dataset) == 5
    np.testing.assert_array_equal(dataset.load_cloud(0).xyz, plain.xyz)
    (world / 'Area_1/office_2').mkdir()
    (world / 'Area_6').rename(world / 'area_6')
    with pytest.warns(UserWarning) as told:
        assert len(S3DISDataset(world).scene_ids) == 4
    assert 'no rooms in Area_6; they are left out' in str(told[0].message)
    assert 'office_2: no folder Annotations, so it is left out (1 such folders)' in str(told[1].message)
    (folder / 'wall_1.TXT').write_text('1 2 3 4 5 6\n')
    assert [item.path.name for item in list_objects(folder)][-1] == 'wall_1.TXT'


def test_colours_from_0_to_1_stay(tmp_path):
    write_room(tmp_path, 'Area_5/a', {'wall_1': '0 0 0 0.5 0.25 1\n', 'floor_1': '1 0 0 0 0 0.125\n'})
    colors = S3DISDataset(tmp_path, 'test', cache=None).load_cloud(0).colors
    np.testing.assert_array_equal(colors, [[0, 0, 0.125], [0.5, 0.25, 1]])


def test_a_folder_above_or_below_is_named(world):
    for root in (world / 'Area_1', world.parent):
        with pytest.raises(DatasetNotFoundError) as told:
            len(S3DISDataset(root))
        assert f'It seems to lie at {world}: pass data_root={world}.' in str(told.value)
    with pytest.raises(DatasetNotFoundError) as told:
        len(S3DISDataset(world / 'nothing'))
    assert 'It seems' not in str(told.value)


@pytest.mark.parametrize(
    ('text', 'told'),
    [
        ('1e300 0 0 1 2 3\n', 'line 1: x is 1e.300, expected a finite number'),
        ('7z\xbc\xaf\x27\x1c', 'is a 7z archive, not .txt; unpack it first'),
    ],
)
def test_a_file_that_is_no_object(tmp_path, text, told):
    write_room(tmp_path, 'Area_5/a', {'wall_1': text})
    with pytest.raises(SceneError, match=told):
        S3DISDataset(tmp_path, 'test', cache=None).load_cloud(0)
