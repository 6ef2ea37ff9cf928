"""Pairs cut from one scan, and what descriptors reach on them."""

import numpy as np
import pytest
from reference.rooms import make_room

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments import Request, make_table, scenes
from rm3d_plugin.experiments.poses import POSES, pose_cell
from rm3d_plugin.experiments.render import to_markdown
from rm3d_plugin.experiments.scan_pairs import INLIER, ROOM_UNIT, cut_pair, length_unit, true_places
from rm3d_plugin.experiments.scenes import Collection, TableScene, described_surface
from rm3d_plugin.experiments.tables import descriptors_matching
from rm3d_plugin.experiments.tables.descriptors_matching import (
    MatchingScores,
    Patches,
    fill_matching,
    make_patches,
    region_auc,
    score_pair,
)
from rm3d_plugin.structures import Descriptors, PointCloud, Regions


@pytest.fixture(scope='module')
def room():
    xyz, truth = make_room(density=120, seed=0)
    return TableScene('room', described_surface(PointCloud(xyz)), truth, truth)


@pytest.fixture(scope='module')
def pair(room):
    return cut_pair(room.cloud, ROOM_UNIT, (0, 0, 0))


def places(pair, pose):
    """The perfect descriptor: the place in the frame of the scan."""
    back = pair.targets[pose].xyz @ pair.motions[pose][:3, :3]
    return [Descriptors(_lifted(xyz), np.ones(len(xyz), dtype=bool)) for xyz in (pair.source.xyz, back)]


def _lifted(xyz):
    """Rows of one length whose cosine falls with the distance (nearly: a paraboloid on a sphere)."""
    flat = np.asarray(xyz, dtype=np.float64) / 100
    return np.concatenate([flat, np.sqrt(1 - (flat**2).sum(axis=1, keepdims=True))], axis=1).astype(np.float32)


def test_cuts_overlap_as_wanted_and_the_motion_is_known(room):
    for number in range(4):
        pair = cut_pair(room.cloud, ROOM_UNIT, (number,))
        share = len(pair.shared) / len(pair.source)
        assert 0.25 < share < 0.8  # 30 to 70 % and a border of 10 cm
        for pose in POSES:
            gaps = np.linalg.norm(
                true_places(pair, pose)[pair.shared][:50, None] - pair.targets[pose].xyz[None], axis=2
            ).min(axis=1)
            assert (gaps <= INLIER * ROOM_UNIT + 1e-5).all()
        assert len(pair.source) != len(pair.targets['z']) == len(pair.targets['so3'])
    assert (pair.motions['original'] == np.eye(4)).all() and pair.motions['z'][2, 2] == 1 != pair.motions['so3'][2, 2]


def test_equal_seeds_give_equal_pairs(room, pair):
    again = cut_pair(room.cloud, ROOM_UNIT, (0, 0, 0))
    np.testing.assert_array_equal(again.source.xyz, pair.source.xyz)
    np.testing.assert_array_equal(again.targets['so3'].xyz, pair.targets['so3'].xyz)


def test_unit_is_the_spacing_where_a_lidar_is_meant():
    grid = np.stack(np.meshgrid(np.arange(6), np.arange(6), [0]), axis=-1).reshape(-1, 3) * 0.15
    cloud = PointCloud(grid.astype(np.float32))
    assert length_unit(cloud, 'lidar') == pytest.approx(0.15) and length_unit(cloud, 'indoor') == 0.025


@pytest.mark.parametrize('pose', POSES)
def test_a_perfect_descriptor_matches_and_registers(pair, pose):
    scores = score_pair(pair, pose, places(pair, pose), [0])
    assert scores.registered and scores.described == 1
    assert scores.inliers == pytest.approx(len(pair.shared) / len(pair.source), abs=0.05)


def test_random_and_missing_descriptors_do_not(pair):
    ends = places(pair, 'so3')
    rng = np.random.default_rng(0)
    noise = [Descriptors(rng.normal(size=end.values.shape).astype(np.float32), end.valid) for end in ends]
    scores = score_pair(pair, 'so3', noise, [0])
    assert not scores.registered and scores.inliers < 0.02
    blind = Descriptors(ends[0].values, np.zeros(len(ends[0]), dtype=bool))
    assert score_pair(pair, 'so3', [blind, ends[1]], [0]) == (0.0, False, 0.0)


def test_region_auc_of_points_by_hand():
    regions = Regions(np.array([0, 0, 1, 1, 2, 2]))
    patches = Patches(regions, np.array([0, 0, 1]), np.array([[0, 1], [1, 2]]))
    values = np.float32([[1, 0], [9, 9], [1, 0], [1, 0], [0, 1], [0, 1]])
    valid = np.array([True, False, True, True, True, True])
    assert region_auc(Descriptors(np.where(valid[:, None], values, np.float32(0)), valid), patches) == 1.0
    assert region_auc(Descriptors(values[[4, 1, 2, 3, 0, 0]], valid), patches) == 0.0


def test_patches_depend_on_no_descriptor(room):
    collection = Collection('toy', 'toy', 'indoor', int(room.semantic.max()) + 1, (room,), (room,))
    patches = make_patches(room, collection)
    assert len(patches.objects) == len(patches.regions) > 20 and patches.edges.max() < len(patches.regions)
    owners = patches.objects[patches.regions.labels]
    numbers = np.unique(room.objects, return_inverse=True)[1]
    assert (owners == numbers)[room.semantic >= 0].mean() > 0.8


def test_table_is_kept_descriptor_by_descriptor(room, tmp_path, monkeypatch):
    collection = Collection('toy', 'toy (synthetic)', 'indoor', int(room.semantic.max()) + 1, (room,), (room,))
    monkeypatch.setitem(scenes.COLLECTIONS, 'toy', lambda root, amount: collection)
    monkeypatch.setattr(descriptors_matching, 'PAIRS', 2)
    asked = []

    def made(names):
        request = Request(tmp_path, data=['toy'], descriptors=names, log=asked.append)
        return make_table('descriptors-matching', request)

    first = made(['SuperpointGraph'])
    assert [row['pose'] for row in first.records] == list(POSES)
    row = first.records[0]
    assert row['auc'] > 0.5 and row['pairs'] == 2 and row['within'] == pytest.approx(0.1) and row['described'] == 1
    monkeypatch.setattr(
        descriptors_matching, '_measure_trial', lambda name, *rest: [_row(name, pose) for pose in POSES]
    )
    second = made(['SuperpointGraph', 'FPFH'])
    assert second.records[3:] == first.records and second.records[0]['auc'] == 0.75  # in the order of the tables
    assert (tmp_path / 'descriptors-matching.md').read_text() == to_markdown(second)
    with pytest.raises(ConfigError, match='nothing to measure'):
        monkeypatch.setitem(scenes.COLLECTIONS, 'toy', lambda root, amount: None)
        made(['FPFH'])


def _row(name, pose, scene='a', inliers=0.25):
    return MatchingScores('toy', name, pose, scene, 1.0, inliers, 0.5, 0.75, 1.0, 0.125, 4, 0.1)


def test_table_as_printed():
    rows = [_row('FPFH', pose, scene, share) for pose in POSES for scene, share in (('a', 0.25), ('b', 0.35))]
    lines = to_markdown(fill_matching(rows, 3)).splitlines()
    assert '**toy: 2 scenes, 8 pairs, matches within 0.10 m**' in lines
    assert '| 30.0 ± 7.1 / 30.0 ± 7.1 / 30.0 ± 7.1 | 50.0 ± 0.0 /' in lines[-1] and lines[-1].endswith('| 100 | 0.12 |')


def test_a_single_scene_has_no_spread():
    assert pose_cell({'original': [1.0], 'z': [2.0], 'so3': [3.0]}).text == '1.0 / 2.0 / 3.0'
