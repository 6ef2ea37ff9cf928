"""SHOT: PCL's values and frames, the formulas as loops, invariances, what cannot be described (METHOD 3)."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.neighbors_slow import slow_neighbors
from reference.shot_slow import slow_frame, slow_shot
from reference.surfaces import bumpy, cloud, digest, rotation

from rm3d_plugin.descriptors import SHOT, shot
from rm3d_plugin.ops.shot import _azimuth, _inclination
from rm3d_plugin.registry import DESCRIPTORS

GOLDEN = Path(__file__).resolve().parents[1] / 'golden'


def test_equals_pcl():
    given_cloud, golden = np.load(GOLDEN / 'cloud_2000.npz'), np.load(GOLDEN / 'pcl_descriptors.npz')
    described = np.isfinite(golden['shot352']).all(axis=1)
    assert (~described).sum() == 13
    got = shot(given_cloud['points'], given_cloud['normals'], 0.1, 'l2')
    np.testing.assert_array_equal(got.valid, described)
    np.testing.assert_allclose(got.values[described], golden['shot352'][described], atol=1e-6)
    np.testing.assert_allclose(got.frames.reshape(-1, 9)[described], golden['shot_lrf'][described], atol=3e-6)
    np.testing.assert_array_equal(
        SHOT(0.1, 'l2').compute(cloud(given_cloud['points'], given_cloud['normals'])).values, got.values
    )


@pytest.mark.parametrize('cap', [None, 12])
def test_equals_the_loops(cap):
    points, normals = bumpy(300)
    got = shot(points, normals, 0.14, 'l1', cap)
    seen = 0
    for row, (members, squares) in enumerate(slow_neighbors(points, points, 0.14, cap)):
        members = members[squares > 0]
        assert got.valid[row] == (len(members) >= 5)
        if got.valid[row]:
            frame = slow_frame(points[members] - points[row], 0.14)
            np.testing.assert_allclose(got.frames[row], frame, atol=1e-6)
            want = slow_shot(points[members] - points[row], normals[members], 0.14, frame)
            np.testing.assert_allclose(got.values[row], want / want.sum(), atol=1e-6)
            seen += 1
    assert seen > 280


def test_polynomials_are_the_functions():
    angles = np.linspace(-np.pi, np.pi, 4001)[1:-1]
    got = [_azimuth(np.sin(a), np.cos(a)) for a in angles]
    np.testing.assert_allclose(got, angles, atol=3e-8)
    cosines = np.linspace(-1, 1, 4001)
    np.testing.assert_allclose([_inclination(c) for c in cosines], np.arccos(cosines), atol=3e-8)
    assert _inclination(1 + 1e-15) == 0


def test_norms():
    points, normals = bumpy(300)
    first, second = shot(points, normals, 0.14, 'l1'), shot(points, normals, 0.14, 'l2')
    np.testing.assert_allclose(first.values[first.valid].sum(axis=1), 1, rtol=1e-5)
    np.testing.assert_allclose((second.values[second.valid] ** 2).sum(axis=1), 1, rtol=1e-5)
    lengths = np.linalg.norm(first.values[first.valid], axis=1, keepdims=True)
    np.testing.assert_allclose(first.values[first.valid] / lengths, second.values[second.valid], atol=1e-6)


def test_frames_are_right_handed_and_orthonormal():
    points, normals = bumpy(300)
    got = shot(points, normals, 0.14)
    frames = got.frames[got.valid].astype(np.float64)
    np.testing.assert_allclose(frames @ frames.transpose(0, 2, 1), np.tile(np.eye(3), (len(frames), 1, 1)), atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(frames), 1, atol=1e-6)


@settings(max_examples=10, deadline=None, derandomize=True)
@given(st.integers(0, 10_000))
def test_rotation_and_order_change_nothing(seed):
    points, normals = bumpy(400)
    turn, order = rotation(seed), np.random.default_rng(seed).permutation(400)
    base = shot(points, normals, 0.12)
    turned = shot(points @ turn, normals @ turn, 0.12)
    np.testing.assert_array_equal(turned.valid, base.valid)
    np.testing.assert_allclose(turned.values, base.values, atol=1e-6)
    np.testing.assert_allclose(turned.frames, base.frames @ turn.astype(np.float32), atol=1e-5)
    np.testing.assert_array_equal(shot(points[order], normals[order], 0.12).values, base.values[order])


def test_radius_grows_with_range():
    rng = np.random.default_rng(0)
    points = rng.random((4000, 3)) * [40, 2, 0.01]
    got = SHOT(radius=0.12, range_growth=0.2).compute(cloud(points, np.tile([0, 0, 1.0], (4000, 1))))
    assert got.valid[points[:, 0] < 5].mean() < 0.5 < 0.99 < got.valid[points[:, 0] > 20].mean()


@pytest.mark.parametrize(
    'points',
    [
        np.zeros((0, 3)),
        np.zeros((1, 3)),
        np.zeros((40, 3)),
        np.eye(5, 3) * 0.05,
        np.arange(40.0)[:, None] * [0.01, 0.02, 0.005],
    ],
    ids=['empty', 'one', 'one place', 'five', 'line'],
)
def test_clouds_that_cannot_be_described(points):
    for normals in (None, np.tile([0, 0, 1.0], (len(points), 1))):
        got = SHOT(radius=0.1).compute(cloud(points, normals))
        assert got.values.shape == (len(points), 352) and not got.valid.any() and not got.values.any()


def test_points_without_normal_shape_the_frame_alone():
    points, normals = bumpy(300)
    holes = normals.copy()
    holes[::3], holes[1::30] = 0.0, np.nan
    full, got = shot(points, normals, 0.15), shot(points, holes, 0.15)
    np.testing.assert_array_equal(got.frames[got.valid], full.frames[got.valid])
    assert np.isfinite(got.values).all() and got.valid.sum() > 280
    assert not shot(points, np.zeros_like(points), 0.15).valid.any()


def test_registry_presets_and_bad_numbers():
    assert DESCRIPTORS.build(dict(type='SHOT', norm='l2')).norm == 'l2'
    assert SHOT.preset('indoor').radius == 0.1 and SHOT.preset('lidar').range_growth > 0
    with pytest.raises(ValueError, match="one of .'indoor', 'lidar'., got 'moon'"):
        SHOT.preset('moon')
    with pytest.raises(ValueError, match='radius > 0'):
        SHOT(radius=0)
    with pytest.raises(ValueError, match="one of .'l1', 'l2'., got 'max'"):
        SHOT(norm='max')
    with pytest.raises(ValueError, match=r'normals \(2, 3\)'):
        shot(np.zeros((3, 3)), np.zeros((2, 3)), 0.1)


def test_threads_change_nothing():
    assert digest('SHOT(radius=.05)', 1) == digest('SHOT(radius=.05)', 3)
