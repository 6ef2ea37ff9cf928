"""Boxes around instances, as ScanNet's detection benchmark has them."""

import numpy as np
import pytest

from rm3d_plugin.datasets import InstanceBoxDataset, S3DISDataset, ScanNetDataset
from rm3d_plugin.datasets.synthetic import make_scannet_rooms
from rm3d_plugin.structures import SceneError


@pytest.fixture(scope='module')
def rooms(tmp_path_factory):
    return make_scannet_rooms(tmp_path_factory.mktemp('scannet') / 'rooms', 1, 1, seed=2, progress=False)


def slow_boxes(source, index, classes):
    """(class, centre, size) of each instance, point by point."""
    truth, xyz = source.load_truth(index), source.load_cloud(index).xyz.astype(np.float64)
    found = []
    for number in range(int(truth.instance.max()) + 1):
        points = np.flatnonzero(truth.instance == number)
        name = source.classes[truth.semantic[points[0]]]
        if name in classes:
            low, high = xyz[points].min(axis=0), xyz[points].max(axis=0)
            found.append((classes.index(name), (low + high) / 2, np.maximum(high - low, 1e-3)))
    return found


def test_eighteen_classes_of_scannet(rooms):
    data = InstanceBoxDataset('ScanNetDataset', rooms, split='val', labels='truth')
    source = ScanNetDataset(rooms, split='val')
    assert len(data.classes) == 18 and not {'wall', 'floor'} & set(data.classes)
    truth, expected = data.load_truth(0), slow_boxes(source, 0, list(data.classes))
    assert len(truth.boxes) == len(expected) > 5
    assert truth.boxes.labels.tolist() == [label for label, *_ in expected]
    np.testing.assert_allclose(truth.boxes.tensor[:, :3], [center for _, center, _ in expected])
    np.testing.assert_allclose(truth.boxes.tensor[:, 3:6], [size for *_, size in expected])
    assert not truth.boxes.tensor[:, 6].any()
    assert data[0]['num_points'] == len(source.load_cloud(0)) and data[0]['points'].shape[1] == 7  # grey, then colour


def test_a_choice_of_classes_and_of_sizes(rooms):
    whole = InstanceBoxDataset('ScanNetDataset', rooms)
    some = InstanceBoxDataset('ScanNetDataset', rooms, classes=['table', 'cabinet'], min_points=30)
    names = [whole.classes[label] for label in whole.load_truth(0).boxes.labels]
    assert 0 < len(some.load_truth(0).boxes) <= sum(name in ('table', 'cabinet') for name in names)
    with pytest.raises(ValueError, match="'wall' has no instances in ScanNetDataset; expected some of cabinet, bed"):
        InstanceBoxDataset('ScanNetDataset', rooms, classes=['wall'])
    with pytest.raises(ValueError, match="labels='truth' is for splits"):
        InstanceBoxDataset('ScanNetDataset', rooms, labels='truth')


def test_the_test_split_has_none(rooms):
    (rooms / 'scannetv2_test.txt').write_text((rooms / 'scannetv2_val.txt').read_text())
    data = InstanceBoxDataset('ScanNetDataset', rooms, split='test')
    assert not data.is_labelled(0) and len(data.load_cloud(0)) > 0
    with pytest.raises(SceneError, match='ScanNet keeps the labels'):
        data.load_truth(0)


def test_things_of_s3dis(tmp_path):
    rng = np.random.default_rng(0)
    folder = tmp_path / 'Area_5' / 'office_1' / 'Annotations'
    folder.mkdir(parents=True)
    for name in ('wall_1', 'chair_1', 'chair_2', 'table_1', 'clutter_1'):
        rows = np.c_[np.round(rng.uniform(0, 3, (30, 3)), 3), rng.integers(0, 255, (30, 3))]
        np.savetxt(folder / f'{name}.txt', rows, fmt='%.3f %.3f %.3f %d %d %d')
    things = ['table', 'chair', 'sofa', 'bookcase', 'board']
    options = {'cache': None}
    data = InstanceBoxDataset('S3DISDataset', tmp_path, split='test', classes=things, scene_options=options)
    expected = slow_boxes(S3DISDataset(tmp_path, split='test', cache=None), 0, things)
    found = data.load_truth(0).boxes
    assert sorted(found.labels) == [0, 1, 1] and found.labels.tolist() == [label for label, *_ in expected]
    np.testing.assert_allclose(found.tensor[:, 3:6], [size for *_, size in expected])
