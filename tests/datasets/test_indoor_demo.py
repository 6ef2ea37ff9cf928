"""The readers read back exactly what the demo's writers were asked to write."""

import numpy as np
import pytest

from rm3d_plugin.datasets.s3dis import S3DISDataset
from rm3d_plugin.datasets.s3dis_format import CLASSES as S3DIS
from rm3d_plugin.datasets.scannet import ScanNetDataset
from rm3d_plugin.datasets.scannet_format import NYU40_IDS
from rm3d_plugin.datasets.synthetic import make_s3dis_rooms, make_scannet_rooms, make_vkitti_streets
from rm3d_plugin.datasets.synthetic.room_things import CATEGORIES
from rm3d_plugin.datasets.synthetic.rooms import make_room
from rm3d_plugin.datasets.synthetic.vkitti_writer import make_frame, make_sensor
from rm3d_plugin.datasets.vkitti import VKITTI3DDataset
from rm3d_plugin.structures import SceneError


def same_parts(got, wanted):
    """Two numberings of the same parts, -1 in the same places."""
    pairs = np.unique(np.stack([got, wanted], axis=1), axis=0)
    assert len(pairs) == len(np.unique(got)) == len(np.unique(wanted))
    assert ((got == -1) == (wanted == -1)).all()


def test_scannet_rooms(tmp_path):
    root = make_scannet_rooms(
        tmp_path / 'demo', num_train=1, num_val=1, num_test=1, seed=3, spacing=0.12, progress=False
    )
    for number, split in enumerate(('train', 'val')):
        room = make_room(3, number, 0.12)
        dataset = ScanNetDataset(root, split=split, align=False)
        cloud, truth = dataset.load_cloud(0), dataset.load_truth(0)
        np.testing.assert_array_equal(cloud.xyz, room.xyz.astype(np.float32))
        np.testing.assert_array_equal(cloud.colors, (room.colors / 255).astype(np.float32))
        wanted = [NYU40_IDS.index(i) if i in NYU40_IDS else -1 for i in room.nyu40.tolist()]
        assert truth.semantic.tolist() == wanted
        things = np.where(np.array(wanted) >= 2, room.instance, -1)
        same_parts(truth.instance, things)
        assert len(np.unique(truth.instance)) > 3
        turned = ScanNetDataset(root, split=split).load_cloud(0)
        np.testing.assert_allclose(turned.xyz, room.aligned, atol=1e-4)
        for source in ('ply', 'aggregation'):
            assert ScanNetDataset(root, split=split, label_source=source).load_truth(0).semantic.tolist() == wanted
    test = ScanNetDataset(root, split='test')
    np.testing.assert_allclose(test.load_cloud(0).xyz, make_room(3, 2, 0.12).aligned, atol=1e-4)
    with pytest.raises(SceneError, match='keeps the labels of its test scans'):
        test.load_truth(0)


def test_s3dis_rooms(tmp_path):
    root = make_s3dis_rooms(tmp_path / 'demo', rooms_per_area=1, seed=2, spacing=0.2, progress=False)
    dataset = S3DISDataset(root, split='test', labels='truth', cache=tmp_path / 'cache')
    assert len(dataset) == 1 and len(S3DISDataset(root)) == 5
    item = dataset[0]
    room = make_room(2, 4, 0.2, 'office', 'tripod', structure=0.6)
    area, name = dataset.scene_ids[0][:6], dataset.scene_ids[0][7:]
    whole = np.loadtxt(root / area / name / f'{name}.txt')  # the room's own file: all points, in the order of the scan
    rows = {tuple(row) for row in np.c_[whole[:, :3].astype(np.float32), whole[:, 3:]].tolist()}
    got = np.c_[item['points'][:, :3], np.round(item['points'][:, 3:] * 255)]
    assert {tuple(row) for row in got.tolist()} == rows and len(got) == len(whole) == len(room)
    classes = np.array([S3DIS.index(CATEGORIES[raw].s3dis) for raw in room.things])
    sizes = np.bincount(room.instance, minlength=len(room.things))
    wanted = sorted(zip(classes.tolist(), sizes.tolist(), strict=True))
    found = [
        (int(item['semantic'][item['instance'] == k][0]), int((item['instance'] == k).sum()))
        for k in range(item['instance'].max() + 1)
    ]
    assert sorted(found) == [pair for pair in wanted if pair[1] > 0]


def test_vkitti_streets(tmp_path):
    root = make_vkitti_streets(tmp_path / 'demo', num_train=5, num_val=1, seed=1, step=1.5, progress=False)
    train, test = VKITTI3DDataset(root), VKITTI3DDataset(root, split='test')
    assert train.scene_ids == tuple(f'{fold:02d}_0001_00000' for fold in range(1, 6))
    assert test.scene_ids == ('06_0001_00000',)
    frame = make_frame(1, 0, make_sensor(1.5)).astype(np.float32)
    cloud, truth = train.load_cloud(0), train.load_truth(0)
    np.testing.assert_array_equal(cloud.xyz, frame[:, :3])
    np.testing.assert_allclose(cloud.colors, frame[:, 3:6] / 255, atol=1e-7)
    assert truth.semantic.tolist() == frame[:, 6].astype(int).tolist()
