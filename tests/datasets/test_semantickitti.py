"""SemanticKITTI's native files: the merge, instances, splits, submissions, and scans of the real data set."""

import numpy as np
import pytest

from rm3d_plugin.datasets import DatasetNotFoundError
from rm3d_plugin.datasets.semantickitti import SemanticKittiDataset
from rm3d_plugin.datasets.semantickitti_format import (
    CLASS_TO_RAW,
    CLASSES,
    RAW_TO_NAME,
    merge_ids,
    number_instances,
    read_labels,
    read_lidar_poses,
)
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.storage.exports import write_label_words
from rm3d_plugin.structures import SceneError

RAW = np.array([10, 252, 0, 40, 60, 254, 30, 10, 81, 99])
INSTANCE = np.array([3, 3, 0, 7, 0, 3, 9, 0, 0, 5])
CLASS = [0, 0, -1, 8, 8, 5, 5, 0, 18, -1]
POINTS = np.column_stack([np.arange(10) * 0.5, np.zeros(10), np.ones(10), np.linspace(0, 1, 10)]).astype('<f4')


def write_scan(root, sequence, scan, points=POINTS, raw=RAW, instance=INSTANCE):
    folder = root / 'sequences' / f'{sequence:02d}'
    for name in ('velodyne', 'labels'):
        (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / 'velodyne' / f'{scan:06d}.bin').write_bytes(points.tobytes())
    if raw is not None:
        packed = (raw | instance << 16).astype('<u4')
        (folder / 'labels' / f'{scan:06d}.label').write_bytes(packed.tobytes())
    return folder


@pytest.fixture
def world(tmp_path):
    for scan in range(5):
        write_scan(tmp_path, 0, scan)
    write_scan(tmp_path, 8, 3)
    write_scan(tmp_path, 11, 0, raw=None)
    return tmp_path


def one(world, **arguments):
    return SemanticKittiDataset(world, sequences=[0], **arguments)


def test_a_scan_by_hand(world):
    dataset = DATASETS.build(
        {'type': 'rm3d_plugin.SemanticKittiDataset', 'data_root': str(world), 'split': 'val', 'labels': 'truth'}
    )
    cloud, truth = dataset.load_cloud(0), dataset.load_truth(0)
    assert dataset.scene_ids == ('08_000003',)
    assert dataset.thing_classes == (0, 1, 2, 3, 4, 5, 6, 7)
    np.testing.assert_array_equal(cloud.xyz, POINTS[:, :3])
    np.testing.assert_array_equal(cloud.intensity, POINTS[:, 3])
    assert cloud.sensor.tolist() == [0, 0, 0]
    assert truth.semantic.tolist() == CLASS
    # car 3 rests and moves; person 3 is another thing; the road's number and the ignored one's do not count
    assert truth.instance.tolist() == [0, 0, -1, -1, -1, 1, 2, -1, -1, -1]
    assert dataset.original_index(0).tolist() == list(range(10))
    item = dataset[0]
    assert item['points'].shape == (10, 4)
    np.testing.assert_array_equal(item['semantic'], CLASS)


def test_the_merge_knows_every_id_of_the_benchmark():
    raw = np.array(sorted(RAW_TO_NAME))
    merged = merge_ids(raw, 'here')
    assert len(raw) == 34
    assert raw[merged < 0].tolist() == [0, 1, 52, 99]
    assert raw[merged == CLASSES.index('other-vehicle')].tolist() == [13, 16, 20, 256, 257, 259]
    assert raw[merged == CLASSES.index('road')].tolist() == [40, 60]
    np.testing.assert_array_equal(merge_ids(CLASS_TO_RAW, 'here'), np.arange(19))


def test_unknown_ids_are_listed():
    with pytest.raises(SceneError, match=r'here: label ids that SemanticKITTI does not have: 7 \(2 points\), 300 \(1'):
        merge_ids(np.array([7, 10, 300, 7]), 'here')


def test_instances_of_no_points():
    nothing = np.zeros(0, dtype=np.int64)
    assert number_instances(nothing, nothing).tolist() == []


def test_a_submission_goes_there_and_back(tmp_path):
    classes = np.array([-1, *range(19)])
    raw_ids = np.where(classes >= 0, CLASS_TO_RAW[classes], 0)
    path = write_label_words(tmp_path / '000000.label', raw_ids, np.zeros_like(raw_ids))
    raw = read_labels(path, 20)
    assert raw.semantic.tolist() == [0, *CLASS_TO_RAW.tolist()]
    assert raw.instance.tolist() == [0] * 20
    np.testing.assert_array_equal(merge_ids(raw.semantic, path), classes)


def test_every_second_scan_and_any_sequences(world):
    assert one(world, every=2).scene_ids == ('00_000000', '00_000002', '00_000004')
    assert SemanticKittiDataset(world, sequences=[8, 0], every=5).scene_ids == ('08_000003', '00_000000')
    with pytest.raises(ValueError, match='every: expected a whole number from 1, got 0'):
        one(world, every=0)
    with pytest.raises(ValueError, match='name each once'):
        SemanticKittiDataset(world, sequences=[0, 0])


def test_splits_tell_what_is_missing(world, tmp_path):
    with pytest.warns(UserWarning, match=r"9 of 10 sequences of split 'train' .*: 01, 02, 03, 04, 05, 06, 07, 09, 10"):
        assert len(SemanticKittiDataset(world)) == 5
    with pytest.raises(DatasetNotFoundError, match='no scans of sequence 05'):
        _ = SemanticKittiDataset(world, sequences=[0, 5]).scene_ids
    with pytest.raises(DatasetNotFoundError, match=r'(?s)looked for at .*velodyne/   000000.bin.*--demo'):
        _ = SemanticKittiDataset(tmp_path / 'nowhere', 'val').scene_ids
    with pytest.raises(ValueError, match="split: expected one of train, val, trainval, test, got 'all'"):
        SemanticKittiDataset(world, 'all')
    with pytest.raises(ValueError, match="labels='truth'"):
        SemanticKittiDataset(world, 'train', labels='truth')


def test_test_scans_have_no_labels(world):
    with pytest.warns(UserWarning, match='10 of 11 sequences'):
        dataset = SemanticKittiDataset(world, 'test')
        assert dataset.scene_ids == ('11_000000',)
    assert len(dataset.load_cloud(0)) == 10
    with pytest.raises(SceneError, match='scene 11_000000: SemanticKITTI keeps the labels of its test scans'):
        dataset.load_truth(0)
    with pytest.raises(SceneError, match=r'scene 11_000000: .*000000.label: no such file'):
        SemanticKittiDataset(world, sequences=[11]).load_truth(0)


def test_thinning_and_the_way_back(world):
    dataset = one(world, voxel_downsample=1.1, use_intensity=False)
    cloud, truth, rows = dataset.load_cloud(0), dataset.load_truth(0), dataset.original_index(0)
    assert cloud.intensity is None
    assert cloud.xyz[:, 0].tolist() == [0, 1.5, 2.5, 3.5, 4.5]
    assert rows.tolist() == [0, 0, 0, 1, 1, 2, 2, 3, 3, 4]
    assert truth.semantic.tolist() == [0, 8, 5, 0, -1]
    assert truth.instance.tolist() == [0, -1, 1, -1, -1]


def test_poses_are_about_the_lidar(world):
    dataset = one(world)
    assert dataset.pose(0) is None
    folder = world / 'sequences' / '00'
    # camera: x right, y down, z forward; a metre of the camera forward is a metre of the lidar along its x
    (folder / 'calib.txt').write_text('P0: 1\nTr: 0 -1 0 0 0 0 -1 -0.08 1 0 0 -0.27\n')
    (folder / 'poses.txt').write_text('1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0.5 0 1 0 0 0 0 1 2\n')
    np.testing.assert_allclose(dataset.pose(0), np.eye(4), atol=1e-12)
    np.testing.assert_allclose(dataset.pose(1)[:3, 3], [2, -0.5, 0], atol=1e-12)
    with pytest.raises(SceneError, match='2 rows, none for scan 000004'):
        dataset.pose(4)
    (folder / 'poses.txt').write_text('1 0 0\n')
    with pytest.raises(SceneError, match='row 1: expected 12 numbers'):
        read_lidar_poses(folder)


@pytest.mark.parametrize(
    ('file', 'data', 'message'),
    [
        ('velodyne/000000.bin', b'', r'000000.bin: holds no points'),
        ('velodyne/000000.bin', POINTS.tobytes()[:-3], r'000000.bin: 157 bytes are no multiple of 16'),
        ('velodyne/000000.bin', (POINTS * np.nan).tobytes(), r'000000.bin: 10 of 10 points hold NaN'),
        ('labels/000000.label', b'', r'000000.label: 0 labels, but the scan has 10 points'),
        ('labels/000000.label', bytes(38), r'000000.label: 38 bytes are no multiple of 4'),
        ('labels/000000.label', bytes(36), r'000000.label: 9 labels, but the scan has 10 points'),
        ('labels/000000.label', np.full(10, 5, '<u4').tobytes(), r'000000.label: label ids .*: 5 \(10 points\)'),
    ],
)
def test_bad_files_are_named(world, file, data, message):
    (world / 'sequences' / '00' / file).write_bytes(data)
    with pytest.raises(SceneError, match=message):
        one(world).load_truth(0)
    with pytest.warns(UserWarning, match='1 of 5 scenes'):
        assert len(one(world, bad_scenes='skip')) == 4


def test_real_scans(real_data):
    root = real_data / 'semantickitti'
    if not root.is_dir():
        pytest.skip(f'no {root}')
    dataset = SemanticKittiDataset(root, 'val', sequences=[0, 1, 99], labels='truth')
    assert len(dataset) == 6
    cloud, truth = dataset.load_cloud(0), dataset.load_truth(0)
    assert len(cloud) == 124668
    assert np.bincount(truth.semantic + 1, minlength=20).tolist() == [
        4886, 4234, 0, 0, 0, 0, 0, 0, 88, 35281, 3268, 26360, 0, 18268, 370, 27123, 1192, 2964, 532, 102,
    ]  # fmt: skip
    assert truth.instance.max() + 1 == 14
    assert 0 <= cloud.intensity.min() and cloud.intensity.max() <= 1
    road = cloud.xyz[truth.semantic == CLASSES.index('road')]
    assert abs(np.median(road[np.abs(road[:, 0]) < 10, 2]) + 1.73) < 0.15  # the sensor rides 1.73 m above it


def test_remissions_of_another_scale_are_told(world):
    path = world / 'sequences/00/velodyne/000000.bin'
    path.write_bytes((POINTS * np.array([1, 1, 1, 255], dtype='f4')).astype('<f4').tobytes())
    with pytest.raises(SceneError, match=r'000000\.bin: remission: expected 0 to 1, got 0 to 255; divide it'):
        one(world).load_cloud(0)
    assert one(world, use_intensity=False).load_cloud(0).intensity is None


@pytest.mark.parametrize(
    ('calib', 'poses', 'told'),
    [
        ('Tr: ' + '0 ' * 12, '1 0 0 0 0 1 0 0 0 0 1 0', r'calib\.txt: Tr: its first three columns are no rotation'),
        ('Tr: 1 0 0 0 0 1 0 0 0 0 1 0', '0 ' * 12, r'poses\.txt: row 1: its first three columns are no rotation'),
    ],
)
def test_matrices_that_do_not_turn_are_told(tmp_path, calib, poses, told):
    (tmp_path / 'calib.txt').write_text(calib)
    (tmp_path / 'poses.txt').write_text(poses)
    with pytest.raises(SceneError, match=told):
        read_lidar_poses(tmp_path)


def test_names_of_scans(world):
    folder = world / 'sequences/00'
    (folder / 'velodyne/._000000.bin').write_bytes(b'\0\5')
    assert len(one(world)) == 5
    (folder / 'velodyne/000000.bin').rename(folder / 'velodyne/scan.bin')
    (folder / 'labels/000000.label').rename(folder / 'labels/scan.label')
    (folder / 'calib.txt').write_text('Tr: 1 0 0 0 0 1 0 0 0 0 1 0')
    (folder / 'poses.txt').write_text('1 0 0 0 0 1 0 0 0 0 1 0\n')
    with pytest.raises(SceneError, match=r'scan\.bin: expected a name like 000000\.bin; rename it'):
        one(world).pose(4)
    (folder / 'velodyne/scan.bin').rename(folder / 'velodyne/scan.BIN')
    with pytest.raises(SceneError, match=r'scan\.BIN: expected the ending \.bin in small letters'):
        len(one(world))


def test_labels_without_a_scan_are_told(world):
    (world / 'sequences/00/velodyne/000002.bin').unlink()
    with pytest.warns(
        UserWarning, match=r'1 of 5 files of labels have no scan, .*the first is 000002\); unpack velodyne'
    ):
        assert len(one(world)) == 4


def test_sequences_may_be_written_as_their_folders(world):
    assert len(SemanticKittiDataset(world, sequences=['00'])) == 5
    assert len(SemanticKittiDataset(world, sequences=(number for number in (0,)))) == 5
    with pytest.raises(ValueError, match='every: expected a whole number from 1, got inf'):
        one(world, every=float('inf'))
    with pytest.raises(ValueError, match='sequences: expected a list of numbers'):
        SemanticKittiDataset(world, sequences=[])
    for wrong in ('00', ['a'], [1.5]):
        with pytest.raises(ValueError, match=r'sequences: expected a list of numbers, \[0, 8\], say, got'):
            SemanticKittiDataset(world, sequences=wrong)
    with pytest.raises(ValueError, match='every: expected a whole number from 1, got 1.5'):
        one(world, every=1.5)
