"""Scenes of S3DIS told in ScanNet's classes, worked out by hand."""

import numpy as np
import pytest

from rm3d_plugin.datasets import OtherClassesDataset
from rm3d_plugin.datasets.other_classes import class_names_of, numbers_by_name
from rm3d_plugin.datasets.scannet_format import CLASSES


@pytest.fixture
def rooms(tmp_path):
    """One room: three points of a chair, two of a beam, two of a wall."""
    folder = tmp_path / 's3dis' / 'Area_5' / 'office_1' / 'Annotations'
    folder.mkdir(parents=True)
    for name, count in (('beam_1', 2), ('chair_1', 3), ('wall_1', 2)):
        lines = [f'{0.1 * number} 0.0 {len(name)} 10 20 30' for number in range(count)]
        (folder / f'{name}.txt').write_text('\n'.join(lines) + '\n')
    (tmp_path / 's3dis' / 'Area_5' / 'office_1' / 'office_1.txt').write_text('')
    return tmp_path / 's3dis'


def test_shared_classes_keep_their_points_and_others_are_ignored(rooms):
    data = OtherClassesDataset(
        'S3DISDataset', 'ScanNetDataset', rooms, labels='truth', pipeline=[], scene_options={'cache': None}
    )
    assert data.scene_ids == ('Area_5_office_1',) and data.classes == CLASSES
    truth = data.load_truth(0)
    chair, wall = CLASSES.index('chair'), CLASSES.index('wall')
    assert truth.semantic.tolist() == [-1, -1, chair, chair, chair, wall, wall]  # ScanNet has no beams
    assert truth.instance.tolist() == [-1, -1, 0, 0, 0, 1, 1]
    assert {CLASSES[number] for number in data.thing_classes} == {
        'floor', 'wall', 'window', 'door', 'table', 'chair', 'sofa'
    }  # fmt: skip
    assert data.annotation(0).semantic.tolist() == truth.semantic.tolist()
    assert np.isfinite(data.load_cloud(0).xyz).all()


def test_names_and_what_cannot_be(rooms):
    assert class_names_of('ScanNetDataset') == CLASSES
    assert numbers_by_name(('beam', 'wall'), CLASSES).tolist() == [-1, 0]
    with pytest.raises(ValueError, match="classes_of: expected a data set with classes of its own, got 'Nothing'"):
        class_names_of('Nothing')
    with pytest.raises(ValueError, match='share no class'):
        OtherClassesDataset('S3DISDataset', 'OaklandDataset', rooms, scene_options={'cache': None})
