"""Any folder of scans becomes a data set."""

import json
import os

import numpy as np
import pytest

from rm3d_plugin.datasets import DatasetNotFoundError
from rm3d_plugin.datasets.files import FilesDataset, class_numbers
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.storage.ply import write_ply
from rm3d_plugin.structures import SceneError

XYZ = np.array([[0.0, 0, 0], [0.01, 0, 0], [1, 0, 0], [1.01, 0, 0], [2, 0, 0]])
RAW = np.array([2, 2, 6, 6, 0], dtype=np.int32)
MAP = {2: 'ground', 6: 'building', 0: -1}
SEMANTIC = [0, 0, 1, 1, -1]


def build(root, **options):
    return FilesDataset(root, **{'cache': None, **options})


@pytest.fixture
def world(tmp_path):
    root = tmp_path / 'scans'
    (root / 'sub').mkdir(parents=True)
    columns = {name: XYZ[:, i] for i, name in enumerate('xyz')}
    write_ply(root / 'b.ply', columns | {'label': RAW})
    np.savez(root / 'sub' / 'a.npz', xyz=XYZ, label=RAW)
    np.savetxt(root / 'c.txt', np.c_[XYZ, RAW], header='x y z label')
    (root / 'notes.md').write_text('not a scan')
    (root / '.hidden.txt').write_text('not a scan')
    return root


def test_every_kind_gives_the_same(world, tmp_path):
    config = {
        'type': 'rm3d_plugin.FilesDataset',
        'data_root': str(world),
        'split': 'val',
        'labels': 'truth',
        'classes': ('ground', 'building'),
        'label_map': MAP,
        'cache': str(tmp_path / 'cache'),
    }
    for _ in range(2):
        dataset = DATASETS.build(config)
        assert dataset.scene_ids == ('b', 'c', 'sub_a')
        for item in dataset:
            np.testing.assert_array_equal(item['points'], XYZ.astype(np.float32))
            assert item['semantic'].tolist() == SEMANTIC and item['instance'].tolist() == [-1] * 5
        assert dataset.thing_classes == () and dataset.original_index(0).tolist() == [0, 1, 2, 3, 4]
        assert dataset.path(2) == world / 'sub' / 'a.npz'
        assert len(list((tmp_path / 'cache').glob('*.npz'))) == 1  # the text


def test_a_changed_text_or_another_option_is_read_anew(world, tmp_path):
    options = dict(files='c.txt', classes=tuple('abcdefg'), cache=tmp_path / 'cache')
    assert build(world, **options).load_truth(0).semantic.tolist() == RAW.tolist()
    options['columns'] = dict(label='x')
    with pytest.raises(SceneError, match='c.txt: label: expected whole numbers, got 0.01'):
        build(world, **options).load_truth(0)
    (world / 'c.txt').write_text('x y z label\n1 1 1 3\n')
    assert build(world, **{**options, 'columns': None}).load_truth(0).semantic.tolist() == [3]


def test_scans_without_labels(world, tmp_path):
    np.save(tmp_path / 'bare.npy', XYZ)
    dataset = build(tmp_path, files='bare.npy', split='test')
    assert dataset[0]['points'].shape == (5, 3) and 'semantic' not in dataset[0]
    with pytest.raises(SceneError, match='labels are asked for, but classes is empty'):
        dataset.load_truth(0)
    dataset = build(tmp_path, files='bare.npy', split='test', classes=('a', 'b'))
    with pytest.raises(SceneError, match='bare.npy: has no column label; name it, columns=dict'):
        dataset.load_truth(0)
    dataset.check_scene(0)  # its points are fine


def test_splits_lists_and_patterns(world, tmp_path):
    (world / 'val').mkdir()
    np.save(world / 'val' / 'd.npy', XYZ)
    assert build(world, split='val').scene_ids == ('d',)
    (world / 'list.lst').write_text('sub/a.npz\n\nb.ply\n')
    assert build(world, split='val', ann_file='list.lst').scene_ids == ('sub_a', 'b')
    assert build(world, files=['c.txt', '*.ply', str(tmp_path / 'scans' / 'sub' / 'a.npz')]).scene_ids == (
        'c', 'b', 'sub_a',
    )  # fmt: skip
    np.save(world / 'b.npy', XYZ)
    assert build(world, files='b.*').scene_ids == ('b.npy', 'b.ply')
    with pytest.raises(SceneError, match='two scans are named sub_b.ply'):
        (world / 'sub_b.ply').write_bytes(b'')
        (world / 'sub' / 'b.ply').write_bytes(b'')
        len(build(world, files='**/*b.ply'))
    with pytest.raises(DatasetNotFoundError, match=r'no scan that fits \*.las(.|\n)*one scan a file'):
        len(build(world, files='*.las'))
    with pytest.raises(DatasetNotFoundError, match='there is no list .*none.txt'):
        len(build(world, ann_file='none.txt'))
    with pytest.raises(SceneError, match='scene none: .*none.ply: no such file'):
        build(world, files=['none.ply'])[0]


def test_things_take_the_instance_column(tmp_path):
    instance = np.array([5, 5, 9, 9, 7])
    np.savez(tmp_path / 'a.npz', xyz=XYZ, label=RAW, instance=instance)
    dataset = build(tmp_path, classes=('ground', 'building'), things=('building',), label_map=MAP)
    assert dataset.thing_classes == (1,)
    assert dataset.load_truth(0).instance.tolist() == [-1, -1, 0, 0, -1]


def test_thinning_keeps_the_way_back(world):
    dataset = build(world, classes=('ground', 'building'), label_map=MAP, voxel_downsample=0.5)
    assert dataset.load_truth(0).semantic.tolist() == [0, 1, -1]
    np.testing.assert_array_equal(dataset.load_cloud(0).xyz, XYZ[[0, 2, 4]].astype(np.float32))
    rows = dataset.original_index(0)
    assert rows.dtype == np.int64 and rows.tolist() == [0, 0, 1, 1, 2]


def test_large_coordinates_colours_and_intensity(tmp_path):
    world = XYZ + [412345.678, 5312345.678, 250.5]
    rgb = np.array([[0, 10, 200]] * 5, dtype=np.uint16)
    np.savez(tmp_path / 'a.npz', xyz=world, colors=rgb, intensity=np.full(5, 500.0))
    dataset = build(tmp_path, color_range=65535, intensity_range=1000)
    cloud = dataset.load_cloud(0)
    np.testing.assert_allclose(cloud.xyz.astype(np.float64) + cloud.origin, world, atol=1e-6)
    np.testing.assert_allclose(cloud.colors, rgb / 65535, atol=1e-7)
    np.testing.assert_array_equal(dataset[0]['points'][:, 3], 0.5)
    assert len(build(tmp_path, voxel_downsample=0.5).load_cloud(0)) == 3
    np.testing.assert_allclose(build(tmp_path).load_cloud(0).colors, rgb / 255, atol=1e-7)


def test_label_maps_survive_json():
    classes = ('ground', 'building')
    again = json.loads(json.dumps(MAP))
    assert class_numbers(again, classes) == class_numbers(MAP, classes) == {2: 0, 6: 1, 0: -1}
    assert class_numbers({3: 1}, classes) == {3: 1}
    for target in ('tree', 2, -2, 1.5):
        with pytest.raises(ValueError, match=r'label_map\[3\]: expected one of ground, building, or -1, got'):
            class_numbers({3: target}, classes)
    with pytest.raises(ValueError, match="raw label 'three': expected a whole number"):
        class_numbers({'three': 1}, classes)


def test_labels_out_of_range_are_named(world):
    with pytest.raises(SceneError, match='b.ply: label: expected -1 to 1, got 2'):
        build(world, classes=('ground', 'building')).load_truth(0)
    with pytest.raises(SceneError, match=r'b.ply: label: expected one of \[2\], got 0'):
        build(world, classes=('ground',), label_map={2: 0}).load_cloud(0)
    options = dict(classes=('ground',), label_map={2: 0}, other_labels='ignore')
    assert build(world, **options).load_truth(0).semantic.tolist() == [0, 0, -1, -1, -1]


def test_bad_options_are_named(world):
    for options, message in (
        ({'split': 'all'}, 'split: expected one of train, val, test'),
        ({'other_labels': 'drop'}, 'other_labels: expected one of error, ignore'),
        ({'color_range': 256}, 'color_range: expected one of'),
        ({'intensity_range': 0}, 'intensity_range: expected a number > 0'),
        ({'files': '*', 'ann_file': 'a'}, 'expected one of them, got both'),
        ({'classes': ('a',), 'things': ('b',)}, "things: 'b' is no class"),
        ({'voxel_downsample': -1}, 'voxel_downsample: expected metres > 0'),
        ({'labels': 'truth'}, "labels='truth' is for splits that metrics are measured on"),
    ):
        with pytest.raises(ValueError, match=message):
            build(world, **options)


def test_a_single_point_and_no_point(tmp_path):
    (tmp_path / 'a.xyz').write_text('1 2 3\n')
    (tmp_path / 'b.xyz').write_text('\n')
    assert build(tmp_path)[0]['points'].tolist() == [[1, 2, 3]]
    with pytest.raises(SceneError, match='scene b: .*b.xyz: holds no points'):
        build(tmp_path)[1]


def test_an_aerial_laz_tile(real_data, tmp_path):
    laspy = pytest.importorskip('laspy')
    folder = real_data / 'las'
    if not folder.is_dir():
        pytest.skip(f'no LAZ tile at {folder}')
    classes = ('ground', 'vegetation', 'building')
    options = dict(classes=classes, label_map={0: -1, 2: 0, 3: 1, 6: 2}, split='val', labels='truth')
    dataset = FilesDataset(folder, cache=tmp_path, voxel_downsample=1.0, **options)
    las = laspy.read(next(iter(folder.glob('*.laz'))))
    whole = FilesDataset(folder, cache=tmp_path, **options)
    cloud, truth = whole.load_cloud(0), whole.load_truth(0)
    xyz = np.stack([las.x, las.y, las.z], axis=1)
    np.testing.assert_allclose(cloud.xyz + cloud.origin, xyz, atol=1e-4)
    assert np.bincount(truth.semantic + 1).tolist() == [
        int((np.asarray(las.classification) == raw).sum()) for raw in (0, 2, 3, 6)
    ]
    rows = dataset.original_index(0)
    thin = dataset.load_cloud(0)
    assert len(rows) == len(xyz) == 401286 and rows.max() == len(thin) - 1 < 401285
    assert (np.floor(thin.xyz[rows] + thin.origin) == np.floor(cloud.xyz + cloud.origin)).all()


def test_a_stray_point_is_named_when_thinning(tmp_path):
    np.save(tmp_path / 'a.npy', np.array([[0.0, 0, 0], [9e5, 0, 0]]))
    with pytest.raises(SceneError, match='scene a: thinning to 0.02 m: a point lies 900000 m from the first one'):
        build(tmp_path, voxel_downsample=0.02).load_cloud(0)


def write_rows(path):
    path.write_text('x y z\n0 0 0\n1 0 0\n2 0 0\n')


def test_links_to_nothing_and_names_that_are_no_utf_8_are_told(tmp_path):
    write_rows(tmp_path / 'a.txt')
    (tmp_path / 'b.ply').symlink_to(tmp_path / 'gone.ply')
    data = FilesDataset(tmp_path, cache=None)
    assert data.scene_ids == ('a', 'b')
    with pytest.raises(SceneError, match=r'b\.ply: no such file'):
        data.load_cloud(1)
    (tmp_path / 'b.ply').unlink()
    write_rows(tmp_path / os.fsdecode(b'b\xfcro.txt'))
    with pytest.raises(SceneError, match='the name of its file or folder is no UTF-8; rename it'):
        len(FilesDataset(tmp_path, cache=None))
    with pytest.warns(UserWarning, match='1 of 2 scenes cannot be used and are left out'):
        assert FilesDataset(tmp_path, cache=None, bad_scenes='skip').scene_ids == ('a',)


def test_lists_of_other_programs(tmp_path):
    write_rows(tmp_path / 'a b.txt')
    (tmp_path / 'list').write_bytes('a b.txt\r\n'.encode('utf-16'))
    assert FilesDataset(tmp_path, ann_file='list', cache=None).scene_ids == ('a b',)
    (tmp_path / 'list').write_bytes(b'')
    with pytest.raises(SceneError, match='list: names no scan; list one a line'):
        len(FilesDataset(tmp_path, ann_file='list', cache=None))
