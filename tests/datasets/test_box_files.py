"""Own scans with boxes: layouts of labelling tools, scans that nobody labelled, scans far from zero."""

import numpy as np
import pytest

from rm3d_plugin.datasets import BoxFilesDataset, DatasetNotFoundError
from rm3d_plugin.datasets.box_formats import BOX_FORMATS
from rm3d_plugin.datasets.boxes import with_strength
from rm3d_plugin.datasets.named_boxes import BoxFileError, NamedBoxes
from rm3d_plugin.storage.ply import write_ply
from rm3d_plugin.structures import PointCloud, SceneError

ROW = np.array([[10.0, 2, 1, 4, 2, 2, 0.5]])


def scan(rng, shift=(0.0, 0.0, 0.0)):
    """Twenty points in the box, eighty on the ground."""
    inside = ROW[0, :3] + rng.uniform(-0.5, 0.5, (20, 3))
    ground = np.c_[rng.uniform(-20, 20, (80, 2)), np.full(80, -0.1)]
    return np.concatenate([inside, ground]) + shift


def make_world(root, names=('a', 'b', 'c'), labelled=('a', 'b', 'c'), scans='points', boxes='labels', shift=(0, 0, 0)):
    rng = np.random.default_rng(0)
    (root / scans).mkdir(parents=True)
    (root / boxes).mkdir(exist_ok=True)
    for name in names:
        xyz = scan(rng, shift)
        columns = {axis: xyz[:, i] for i, axis in enumerate('xyz')}
        write_ply(root / scans / f'{name}.ply', columns | {'intensity': np.arange(100, dtype=np.float32) * 40})
        if name in labelled:
            row = ROW + np.r_[shift, np.zeros(4)]
            BOX_FORMATS['openpcdet'].write(root / boxes / f'{name}.txt', NamedBoxes(['car'], row), name, None)
    return root


def read(root, **options):
    return BoxFilesDataset(root, cache=None, **options)


@pytest.mark.parametrize(('scans', 'boxes'), [('points', 'labels'), ('lidar', 'label'), ('pointclouds', 'labels')])
def test_layouts_of_tools(scans, boxes, tmp_path):
    data = read(make_world(tmp_path, scans=scans, boxes=boxes))
    assert data.scene_ids == ('a', 'b', 'c') and data.classes == ('car',)
    truth = data.load_truth(1)
    assert truth.boxes.tensor.tolist() == ROW.tolist() and truth.boxes.labels.tolist() == [0]
    assert truth.semantic.tolist() == [0] * 20 + [1] * 80
    assert truth.instance.tolist() == [0] * 20 + [-1] * 80


def test_lists_and_folders_tell_the_splits(tmp_path):
    make_world(tmp_path / 'lists')
    for name, line in (('train', 'a\nc.ply\n'), ('val', 'b\n')):
        (tmp_path / 'lists' / f'{name}.txt').write_text(line)
    assert read(tmp_path / 'lists').scene_ids == ('a', 'c')
    assert read(tmp_path / 'lists', split='val', labels='truth').scene_ids == ('b',)
    for split in ('train', 'val'):
        make_world(tmp_path / 'folders' / split, names=(split,), labelled=(split,))
    assert read(tmp_path / 'folders', split='val').scene_ids == ('val',)
    (tmp_path / 'lists' / 'val.txt').unlink()
    with pytest.raises(DatasetNotFoundError, match="nothing tells the scans of split 'val'"):
        len(read(tmp_path / 'lists', split='val'))
    (tmp_path / 'lists' / 'train.txt').write_text('a\nz\n')
    with pytest.raises(SceneError, match='there is no scan z .*, but the list names it'):
        len(read(tmp_path / 'lists'))
    with pytest.raises(DatasetNotFoundError, match='labels/ +NAME.txt or NAME.json'):
        len(read(tmp_path / 'nothing'))


def test_a_scan_without_a_file_is_unlabelled_and_an_empty_file_holds_no_object(tmp_path):
    data = read(make_world(tmp_path, labelled=('a',)))
    (tmp_path / 'labels' / 'b.txt').write_text('')
    assert [data.is_labelled(i) for i in range(3)] == [True, True, False]
    assert len(data.load_truth(1).boxes) == 0
    with pytest.raises(BoxFileError, match='scene c: nobody labelled it, there is no .*c.txt; an empty file says'):
        data.load_truth(2)
    data.check_scene(2)  # training may use it
    (tmp_path / 'val.txt').write_text('a\nc\n')
    with pytest.raises(BoxFileError, match='scene c: nobody labelled it'):  # told before training
        read(tmp_path, split='val', labels='truth').find_scenes()
    skipping = read(tmp_path, split='val', labels='truth', bad_scenes='skip')
    with pytest.warns(UserWarning, match='1 of 2 scenes cannot be used and are left out'):
        assert skipping.scene_ids == ('a',)


def test_scans_far_from_zero_move_with_their_boxes(tmp_path):
    data = read(make_world(tmp_path, shift=(500_000, 5_000_000, 100)))
    cloud, truth = data.load_cloud(0), data.load_truth(0)
    assert np.abs(cloud.xyz).max() < 100 and np.any(cloud.origin)
    np.testing.assert_allclose(truth.boxes.tensor[0, :3] + cloud.origin, ROW[0, :3] + [500_000, 5_000_000, 100])
    assert (truth.semantic == 0).sum() == 20


def test_names_with_dots_and_in_sub_folders(tmp_path):
    make_world(tmp_path, names=('2024.05.a', 'b'), labelled=('2024.05.a', 'b'))
    for folder, ending in (('points', 'ply'), ('labels', 'txt')):
        (tmp_path / folder / 'east').mkdir()
        (tmp_path / folder / f'b.{ending}').rename(tmp_path / folder / 'east' / f'b.{ending}')
    data = read(tmp_path)
    assert (
        data.scene_ids == ('2024.05.a', 'east_b')
        and len(data.load_truth(0).boxes) == len(data.load_truth(1).boxes) == 1
    )


def test_the_range_crops_points_and_boxes(tmp_path):
    world = make_world(tmp_path)
    data = read(world, point_range=(-5, -5, -1, 5, 5, 3))
    assert len(data.load_truth(0).boxes) == 0 and np.abs(data.load_cloud(0).xyz[:, :2]).max() <= 5
    with pytest.raises(SceneError, match='scene a: none of its 100 points lies in point_range'):
        read(world, point_range=(90, 90, -1, 95, 95, 3)).load_cloud(0)
    with pytest.raises(ValueError, match='least then greatest'):
        read(world, point_range=(5, 0, 0, 0, 1, 1))


def test_choices_are_checked(tmp_path):
    make_world(tmp_path)
    with pytest.raises(ValueError, match="labels='truth' is for splits that metrics are measured on"):
        read(tmp_path, labels='truth')
    with pytest.raises(ValueError, match='box_format: expected one of auto, openpcdet, kitti'):
        read(tmp_path, box_format='voc')
    with pytest.raises(ValueError, match='intensity_range: expected a number > 0'):
        read(tmp_path, intensity_range=0)


def test_one_strength_a_point_of_any_sensor():
    xyz = np.zeros((101, 3))
    sixteen = with_strength(PointCloud(xyz, intensity=np.arange(101) * 600.0))
    assert sixteen.intensity.max() == 1 and sixteen.intensity[49] == pytest.approx(0.5)
    negative = with_strength(PointCloud(xyz, intensity=np.linspace(-2048, 2047, 101)))
    assert negative.intensity[50] == pytest.approx(0.5, abs=0.01) and negative.intensity[0] == 0
    assert with_strength(PointCloud(xyz, intensity=np.full(101, 0.25)), 0.5).intensity.tolist() == [0.5] * 101
    assert with_strength(PointCloud(xyz, colors=np.full((101, 3), 0.25))).intensity.tolist() == [0.25] * 101
    assert not with_strength(PointCloud(xyz)).intensity.any()
    assert not with_strength(PointCloud(xyz, intensity=np.zeros(101))).intensity.any()


def test_kitti_and_harbour_scans_as_they_are(real_data):
    boats = BoxFilesDataset(real_data / 'boats', cache=None)
    assert (len(boats), boats.classes, boats.box_format) == (80, ('boat',), 'openpcdet')
    val = BoxFilesDataset(real_data / 'boats', split='val', labels='truth', cache=None)
    assert sum(len(val.load_truth(i).boxes) for i in range(len(val))) == 48
    kitti = BoxFilesDataset(real_data / 'kitti', cache=None)
    assert kitti.box_format == 'kitti' and 'Car' in kitti.classes and len(kitti) == 8


def test_files_beside_the_boxes(tmp_path):
    """Hidden files do not count; others that belong to no scan are told once, and are no classes."""
    make_world(tmp_path)
    for name in ('._a.txt', '.DS_Store', '.ipynb_checkpoints/a.txt'):
        (tmp_path / 'labels' / name).parent.mkdir(exist_ok=True)
        (tmp_path / 'labels' / name).write_bytes(b'\0\5')
    assert read(tmp_path).classes == ('car',)
    (tmp_path / 'labels' / 'classes.txt').write_text('car\n')
    (tmp_path / 'labels' / 'd.txt').write_text('1 2 3 4 5 6 0 boat\n')
    with pytest.warns(UserWarning, match=r'2 of 5 files are passed over, since .*; the first is classes\.txt') as told:
        assert read(tmp_path).classes == ('car',)
    assert len(told) == 1


def test_boxes_behind_a_link_to_nothing_are_told(tmp_path):
    make_world(tmp_path)
    (tmp_path / 'labels/b.txt').unlink()
    (tmp_path / 'labels/b.txt').symlink_to(tmp_path / 'gone.txt')
    with pytest.raises(FileNotFoundError, match=r'b\.txt'):
        read(tmp_path)


def test_boxes_of_no_scan_at_all_are_told(tmp_path):
    make_world(tmp_path)
    for name in 'abc':
        (tmp_path / 'labels' / f'{name}.txt').rename(tmp_path / 'labels' / f'{name}_label.txt')
    with pytest.raises(BoxFileError, match=r'a_label\.txt: there is no scan of that name in .*points'):
        read(tmp_path)
    (tmp_path / 'labels' / 'a_label.txt').rename(tmp_path / 'labels' / 'a.TXT')
    with pytest.raises(BoxFileError, match=r'a\.TXT: expected an ending in small letters; rename the file'):
        read(tmp_path)


def test_a_listed_name_is_one_scan(tmp_path):
    """``a`` is not ``a.old``, and not one of two files at will."""
    make_world(tmp_path, names=('a', 'a.old', 'b'), labelled=('a', 'a.old', 'b'))
    (tmp_path / 'points/b.ply').rename(tmp_path / 'points/b.PLY')
    (tmp_path / 'train.txt').write_bytes('a\nb\n'.encode('utf-16'))
    data = read(tmp_path)
    assert data.scene_ids == ('a', 'b')
    assert [data._scan(name).name for name in data.scene_ids] == ['a.ply', 'b.PLY']
    np.save(tmp_path / 'points/a.npy', np.zeros((3, 3)))
    with pytest.raises(SceneError, match=r'the list names a, which may be a\.npy or a\.ply; give it its ending'):
        len(read(tmp_path))


def test_boxes_in_another_frame_are_told(tmp_path):
    """The scan was moved to its middle, the boxes were not."""
    make_world(tmp_path)
    row = ROW + np.array([4.1e5, 5.3e6, 0, 0, 0, 0, 0])
    BOX_FORMATS['openpcdet'].write(tmp_path / 'labels/b.txt', NamedBoxes(['car'], row), 'b', None)
    data = read(tmp_path)
    assert len(data.load_truth(0).boxes) == 1
    with pytest.warns(
        UserWarning, match=r'b\.txt: all 1 boxes are farther from the points than the scan is wide; are they'
    ):
        data.load_truth(1)
