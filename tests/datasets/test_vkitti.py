"""vKITTI 3D's native files, frames of a few rows worked by hand."""

import numpy as np
import pytest

from rm3d_plugin.datasets import DatasetNotFoundError
from rm3d_plugin.datasets.vkitti import CLASSES, VKITTI3DDataset, read_frame
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.structures import SceneError

ROWS = np.array(
    [
        [5.5, -1, 0.25, 200, 90, 0, 0],
        [6.5, 2, -1.5, 0, 128, 50, 1],
        [7.5, 3, -1.75, 255, 0, 255, 12],
        [8.5, 4, -1.5, 10, 20, 30, 13],
    ]
)


def write(root, name, rows=ROWS):
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, rows)
    return path


@pytest.fixture
def world(tmp_path):
    for fold, sequence in zip(range(1, 7), ('0001', '0001', '0002', '0018', '0020', '0020'), strict=True):
        for frame in (12, 0):
            write(tmp_path, f'{fold:02d}/{sequence}_{frame:05d}.npy')
    (tmp_path / 'doc').mkdir()
    return tmp_path


def test_the_frame_by_hand(world):
    dataset = DATASETS.build({'type': 'rm3d_plugin.VKITTI3DDataset', 'data_root': str(world), 'split': 'test'})
    cloud, truth = dataset.load_cloud(0), dataset.load_truth(0)
    assert dataset.scene_ids == ('06_0020_00000', '06_0020_00012')
    np.testing.assert_array_equal(cloud.xyz, ROWS[:, :3].astype(np.float32))
    np.testing.assert_array_equal(cloud.colors, (ROWS[:, 3:6] / 255).astype(np.float32))
    assert truth.semantic.tolist() == [0, 1, 12, -1] and truth.semantic.dtype == np.int64
    assert truth.instance is None and dataset.thing_classes == ()
    assert dataset.original_index(0).tolist() == [0, 1, 2, 3]
    assert CLASSES[5:9] == ('guardrail', 'trafficsign', 'trafficlight', 'pole') and len(CLASSES) == 13


def test_six_folds(world):
    for fold in range(1, 7):
        test = VKITTI3DDataset(world, split='test', test_fold=fold).scene_ids
        train = VKITTI3DDataset(world, split='train', test_fold=fold).scene_ids
        assert len(test) == 2 and len(train) == 10 and not set(test) & set(train)
        assert {name[:2] for name in test} == {f'{fold:02d}'}
    with pytest.raises(ValueError, match='test_fold: expected 1 to 6, got 0'):
        VKITTI3DDataset(world, test_fold=0)
    with pytest.raises(ValueError, match='split: expected one of train, test'):
        VKITTI3DDataset(world, split='val')
    with pytest.raises(ValueError, match="labels='truth' is for splits that metrics are measured on"):
        VKITTI3DDataset(world, labels='truth')


def test_folders_by_sequence_and_plain_numbers(tmp_path):
    for name in ('0001/00170', '0001/00180', '0001/00230', '0002/00000', '0018/00030', '0020/00444', '0020/00500'):
        write(tmp_path / 'a', f'{name}.npy')
    got = {fold: VKITTI3DDataset(tmp_path / 'a', split='test', test_fold=fold).scene_ids for fold in range(1, 7)}
    assert got == {
        1: ('0001_00170',),
        2: ('0001_00230',),
        3: ('0002_00000',),
        4: ('0018_00030',),
        5: ('0020_00444',),
        6: ('0020_00500',),
    }
    np.testing.assert_array_equal(VKITTI3DDataset(tmp_path / 'a', split='test')[0]['points'][:, 0], ROWS[:, 0])
    write(tmp_path / 'b', '3/frame_7.npy')
    assert VKITTI3DDataset(tmp_path / 'b', split='test', test_fold=3)[0]['scene_id'] == '3_frame_7'


def test_colours_from_0_to_1_and_thinning(tmp_path):
    rows = np.r_[ROWS, ROWS]
    rows[:, 3:6] = 0.5
    write(tmp_path, '06/0020_00500.npy', rows)
    item = VKITTI3DDataset(tmp_path, split='test', labels='truth', voxel_downsample=0.1)[0]
    assert item['points'].shape == (4, 6) and (item['points'][:, 3:] == 0.5).all()
    assert item['semantic'].tolist() == [0, 1, 12, -1]
    dataset = VKITTI3DDataset(tmp_path, split='test', voxel_downsample=0.1)
    assert dataset.original_index(0).tolist() == [0, 1, 2, 3] * 2


def changed(row, column, value):
    rows = ROWS.copy()
    rows[row, column] = value
    return rows


@pytest.mark.parametrize(
    ('rows', 'message'),
    [
        (ROWS[:, :6], r'expected numbers of shape \(N, 7\), x y z r g b label, got \(4, 6\)'),
        (ROWS[:0], 'holds no points'),
        (changed(1, 2, np.nan), '1 of 4 rows hold NaN'),
        (changed(2, 6, 14), 'row 2: label: expected a whole number from 0 to 13, got 14'),
        (changed(2, 6, 1.5), 'row 2: label: expected a whole number from 0 to 13, got 1.5'),
        (changed(3, 4, 300), 'row 3: r, g, b: expected 0 to 255, got 300'),
        (np.array(['a']), r'expected numbers of shape \(N, 7\)'),
    ],
)
def test_bad_frames_are_named(tmp_path, rows, message):
    path = write(tmp_path, '01/a.npy', rows)
    with pytest.raises(SceneError, match=message) as caught:
        read_frame(path)
    assert str(path) in str(caught.value)


def test_cut_off_and_missing(tmp_path):
    path = write(tmp_path, '01/a.npy')
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(SceneError, match='a.npy: not readable as .npy'):
        read_frame(path)
    path.write_bytes(path.read_bytes().replace(b'fortran_order', b'fortran_order('))
    with pytest.raises(SceneError, match='a.npy: not readable as .npy'):
        read_frame(path)
    with pytest.raises(SceneError, match='b.npy: no such file'):
        read_frame(tmp_path / 'b.npy')
    with pytest.raises(DatasetNotFoundError, match="no frame of split 'test'(.|\n)*01/   0001_00000.npy"):
        len(VKITTI3DDataset(tmp_path, split='test'))


def test_two_sequences_are_no_folds(tmp_path):
    """Half a download: 0001 holds two folds, 0002 is the third."""
    for name in ('0001/00000.npy', '0001/00300.npy', '0002/00000.npy'):
        write(tmp_path, name)
    write(tmp_path, '0001/._00000.npy')
    assert VKITTI3DDataset(tmp_path, 'test', test_fold=2).scene_ids == ('0001_00300',)
    assert VKITTI3DDataset(tmp_path, 'test', test_fold=3).scene_ids == ('0002_00000',)


def test_numbers_that_no_frame_has(tmp_path):
    with pytest.raises(SceneError, match=r'expected numbers of shape \(N, 7\).*complex'):
        read_frame(write(tmp_path, 'a.npy', ROWS.astype(complex)))
    with pytest.raises(SceneError, match='1 of 4 rows hold NaN or infinite numbers'):
        read_frame(write(tmp_path, 'a.npy', np.where(ROWS == 5.5, 1e300, ROWS)))
