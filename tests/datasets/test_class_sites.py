"""All labels of made-up rooms as classes of sites, and several data sets with blocks of classes of their own."""

from dataclasses import replace

import numpy as np
import pytest

from rm3d_plugin.datasets.joined import JoinedScenes
from rm3d_plugin.datasets.scannet import ScanNetDataset
from rm3d_plugin.datasets.synthetic import make_scannet_rooms
from rm3d_plugin.datasets.transforms import AllLabels, ClassSites
from rm3d_plugin.ops.site_heights import upright_sites
from rm3d_plugin.structures.point_cloud import SceneError


@pytest.fixture(scope='module')
def root(tmp_path_factory):
    return make_scannet_rooms(tmp_path_factory.mktemp('rooms'), 1, 1, seed=3, spacing=0.1, progress=False)


def test_every_label_of_a_scene_in_a_block_of_its_own(root):
    rooms = ScanNetDataset(root, 'train')
    truth, item = rooms.load_truth(0).semantic, rooms[0] | {'dataset': rooms}
    assert 'semantic' not in item
    assert np.array_equal(AllLabels()(item)['semantic'], truth)
    moved = AllLabels(7)(item)['semantic']
    assert np.array_equal(moved[truth >= 0], truth[truth >= 0] + 7) and (moved[truth < 0] == -1).all()


def test_scenes_without_classes_are_refused(root):
    class Unlabelled:
        labels = 'none'

        def load_truth(self, index):
            return replace(ScanNetDataset(root, 'train').load_truth(index), semantic=None)

    with pytest.raises(SceneError, match='has no class of its points'):
        AllLabels()({'dataset': Unlabelled(), 'index': 0, 'scene_id': 'a'})


def test_it_has_no_place_where_a_label_budget_counts(root):
    rooms = ScanNetDataset(root, 'val', labels='truth')
    with pytest.raises(ValueError, match="expected labels='none'"):
        AllLabels()({'dataset': rooms, 'index': 0, 'scene_id': 'a'})


def test_a_site_has_the_class_of_most_of_its_labelled_points(root):
    rooms = ScanNetDataset(root, 'train')
    item = AllLabels()(rooms[0] | {'dataset': rooms})
    found, sites = ClassSites(0.3)(item), upright_sites(item['points'][:, :3], 0.3)
    assert np.array_equal(found['points'], np.c_[sites.places, sites.inputs])
    for site in range(0, len(sites.places), 29):
        own = item['semantic'][sites.rows == site]
        counts = np.bincount(own[own >= 0], minlength=21)
        assert found['semantic'][site] == (counts.argmax() if counts.any() else -1)


def test_steps_of_a_part_come_before_those_of_all(root):
    part = {'type': 'ScanNetDataset', 'data_root': str(root), 'split': 'train'}
    parts = [part | {'pipeline': [{'type': 'AllLabels', 'first_class': first}]} for first in (0, 20)]
    joined = JoinedScenes(parts, [{'type': 'ClassSites', 'voxel_size': 0.3}])
    first, second = (joined[number]['semantic'] for number in range(2))
    assert np.array_equal(np.where(first >= 0, first + 20, -1), second) and (first >= 0).any()
