"""Two crops of one scan: overlap, exact copies, rigid motion, and the sites that networks see of them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rm3d_plugin.datasets.joined import JoinedScenes
from rm3d_plugin.datasets.transforms import CropPairs, PackScene, PairSettings, VoxelUnits, crop_pair
from rm3d_plugin.datasets.transforms.crop_pairs import overlap_of, random_rotation
from rm3d_plugin.datasets.transforms.voxel_units import site_ids
from rm3d_plugin.ops.site_histograms import WIDTH
from rm3d_plugin.ops.viewpoint import virtual_viewpoint


def scan(count=3000):
    """Two walls and a floor."""
    rng = np.random.default_rng(3)
    points = rng.uniform(0, 4, (count, 3))
    points[np.arange(count), rng.integers(0, 3, count)] = 0
    return np.c_[points, rng.random((count, 1))].astype(np.float32)


POINTS = scan()


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=15)
def test_crops_overlap_as_asked_and_copies_are_the_same_points(seed):
    asked = PairSettings(points=800, overlap=(0.4, 0.8), keep=(1.0, 1.0), jitter=0.0)
    pair = crop_pair(POINTS, asked, np.random.default_rng(seed))
    copies = pair.view.point_ids >= 0
    assert len(pair.rows) == len(pair.view.points) == 800
    assert 0.4 <= copies.mean() <= 0.85
    assert np.array_equal(pair.points[pair.view.point_ids[copies], 3], pair.view.points[copies, 3]), 'channels stay'


@given(st.integers(0, 10_000), st.sampled_from(['so3', 'z', 'none']))
@settings(deadline=None, max_examples=15)
def test_crops_are_moved_rigidly(seed, turn):
    pair = crop_pair(POINTS, PairSettings(points=500, jitter=0.0, turn=turn), np.random.default_rng(seed))
    first, raw = pair.points[:, :3].astype(np.float64), POINTS[pair.rows, :3].astype(np.float64)
    gaps, before = (np.linalg.norm(part[::7, None] - part[None, ::7], axis=2) for part in (first, raw))
    np.testing.assert_allclose(gaps, before, atol=1e-5)
    if turn != 'so3':
        np.testing.assert_allclose(np.diff(first[:, 2]), np.diff(raw[:, 2]), atol=1e-5)


def test_the_viewpoint_of_the_scan_moves_with_each_crop():
    pair = crop_pair(POINTS, PairSettings(points=500, jitter=0.0), np.random.default_rng(2))
    eye = virtual_viewpoint(POINTS[:, :3])
    raw = np.linalg.norm(POINTS[pair.rows, :3] - eye, axis=1)
    np.testing.assert_allclose(np.linalg.norm(pair.points[:, :3] - pair.viewpoint, axis=1), raw, atol=1e-5)
    copies = pair.view.point_ids >= 0
    gaps = np.linalg.norm(pair.view.points[copies, :3] - pair.view.viewpoint, axis=1)
    np.testing.assert_allclose(gaps, raw[pair.view.point_ids[copies]], atol=1e-5)


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=10)
def test_density_and_noise_are_within_their_limits(seed):
    asked = PairSettings(points=1000, keep=(0.3, 0.5), jitter=0.01, turn='none')
    pair = crop_pair(POINTS, asked, np.random.default_rng(seed))
    assert 300 <= len(pair.rows) <= 500 and 300 <= len(pair.view.points) <= 500
    raw = POINTS[pair.rows, :3]
    shift = pair.points[:, :3] - raw
    assert np.abs(shift - shift.mean(axis=0)).max() <= 0.03 + 0.005, 'three deviations, and the moved middle'


def test_the_same_generator_makes_the_same_pair():
    pairs = [crop_pair(POINTS, PairSettings(points=500), np.random.default_rng(5)) for _ in range(2)]
    assert np.array_equal(pairs[0].points, pairs[1].points)
    assert np.array_equal(pairs[0].view.points, pairs[1].view.points)


def test_rotations_are_rotations():
    for seed in range(20):
        turn = random_rotation(np.random.default_rng(seed))
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) == pytest.approx(1.0)


def test_a_scan_smaller_than_a_crop_still_makes_two():
    pair = crop_pair(POINTS[:30], PairSettings(points=500), np.random.default_rng(0))
    assert 0 < len(pair.rows) <= 20 and (pair.view.point_ids >= 0).any()


def test_overlap_by_hand():
    assert overlap_of(np.array([1, 2, 3, 4]), np.array([3, 4, 5])) == pytest.approx(2 / 3)


@pytest.mark.parametrize('bad', [{'overlap': [0.0, 0.5]}, {'keep': [0.8, 0.5]}, {'turn': 'x'}, {'jitter': -1.0}])
def test_settings_that_make_no_sense_are_refused(bad):
    with pytest.raises(ValueError, match='CropPairs'):
        CropPairs(**bad)


def item(seed=0):
    """What a data set hands to a pipeline."""
    return {
        'points': POINTS,
        'point_index': np.arange(len(POINTS)),
        'rng': np.random.default_rng(seed),
        'scene_id': 'walls',
        'num_points': len(POINTS),
    }


def test_ids_of_sites_by_hand():
    own = np.array([0, 0, 1, 2])  # sites of the view's points
    ids = np.array([-1, 2, -1, 0])
    first = np.array([5, 6, 7])  # sites of the scene's points
    assert site_ids(ids, own, first).tolist() == [7, -1, 5]


def test_sites_of_a_pair_show_the_same_places():
    out = VoxelUnits()(CropPairs(points=1500, keep=[1.0, 1.0], jitter=0.0, turn='none')(item()))
    (view,) = out['views']
    copies = np.flatnonzero(view.point_ids >= 0)
    assert len(copies) > 100 and view.point_ids.max() < len(out['points'])
    shift = out['points'][view.point_ids[copies], :3] - view.points[copies, :3]
    middle = np.median(shift, axis=0)
    apart = np.abs(shift - middle).max(axis=1)
    assert np.median(apart) <= 1.0 and apart.max() <= 4.0, 'units differ a little, and voxels begin elsewhere'
    told = VoxelUnits(histograms=True)(CropPairs(points=1500)(item()))
    assert told['points'].shape[1] == 3 + WIDTH and told['views'][0].points.shape[1] == 3 + WIDTH
    packed = PackScene()(out)
    assert packed['inputs']['views'][0]['point_ids'].min() == -1


class Numbered:
    """A data set whose items say who they are."""

    def __init__(self, name, count):
        self.name, self.count = name, count

    def __len__(self):
        return self.count

    def __getitem__(self, index):
        return self.name, *divmod(index, self.count)


def test_joined_scenes_keep_epochs():
    joined = JoinedScenes([])
    joined.parts = [Numbered('rooms', 2), Numbered('streets', 3)]
    assert [joined[i] for i in range(5)] == [(n, 0, i) for n, c in (('rooms', 2), ('streets', 3)) for i in range(c)]
    assert joined[5 * 7 + 3] == ('streets', 7, 1) and len(joined) == 5
    with pytest.raises(IndexError):
        joined[-1]
