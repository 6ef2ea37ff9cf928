"""FPFH: values of PCL and Open3D, the formulas as loops, invariances, what cannot be described (METHOD 3 and 11)."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.fpfh_slow import slow_fpfh
from reference.neighbors_slow import slow_neighbors
from reference.surfaces import bumpy, cloud, digest, rotation

from rm3d_plugin.descriptors import FPFH, fpfh
from rm3d_plugin.ops import fpfh as op
from rm3d_plugin.registry import DESCRIPTORS

GOLDEN = Path(__file__).resolve().parents[1] / 'golden'


def test_equals_pcl():
    """PCL sums in float32; its largest difference is 5e-5 of 100."""
    given_cloud = np.load(GOLDEN / 'cloud_2000.npz')
    expected = np.load(GOLDEN / 'pcl_descriptors.npz')['fpfh33']
    got = FPFH(radius=0.1).compute(cloud(given_cloud['points'], given_cloud['normals']))
    assert got.valid.all()
    np.testing.assert_allclose(got.values, expected, rtol=1e-5, atol=5e-5)
    np.testing.assert_allclose(got.values.reshape(-1, 3, 11).sum(axis=2), 100, rtol=1e-5)


@pytest.mark.parametrize(('cap', 'array'), [(None, 'fpfh33_radius_0p1'), (30, 'fpfh33_hybrid_0p1_max30')])
def test_equals_open3d(cap, array):
    given_cloud = np.load(GOLDEN / 'cloud_2000.npz')
    part = FPFH(radius=0.1, max_neighbors=cap, own_spfh=True)
    got = part.compute(cloud(given_cloud['points'], given_cloud['normals']))
    np.testing.assert_allclose(got.values, np.load(GOLDEN / 'open3d_fpfh.npz')[array], rtol=1e-6, atol=1e-12)


def test_duplicates_count_as_in_open3d():
    """Open3D gives a pair of equal points features of 0; the point's own histogram shows it."""
    given_cloud, want = np.load(GOLDEN / 'cloud_2000.npz'), np.load(GOLDEN / 'open3d_duplicates.npz')
    points, normals = (given_cloud[name][want['rows']] for name in ('points', 'normals'))
    got = fpfh(points, normals, 0.3, own_spfh=True)
    assert got.valid.all() and len(np.unique(points, axis=0)) == len(points) - 63
    np.testing.assert_allclose(got.values, want['fpfh'], rtol=1e-6, atol=2e-5)


@pytest.mark.parametrize('own', [False, True])
def test_duplicates_equal_the_loops(own):
    points, normals = (array[np.r_[np.arange(80), np.arange(0, 80, 3), 4, 4]] for array in bumpy(80))
    members = [[int(i) for i in row] for row, _ in slow_neighbors(points, points, 0.4, None)]
    np.testing.assert_allclose(
        fpfh(points, normals, 0.4, own_spfh=own).values, slow_fpfh(points, normals, members, own), rtol=1e-5, atol=1e-5
    )


@pytest.mark.parametrize('own', [False, True])
@pytest.mark.parametrize(('radius', 'cap'), [(0.12, None), (0.12, 9), (None, 9)])
def test_equals_the_loops(radius, cap, own):
    points, normals = bumpy(250)
    found = slow_neighbors(points, points, np.inf if radius is None else radius, cap)
    want = slow_fpfh(points, normals, [members for members, _ in found], own)
    got = fpfh(points, normals, radius, cap, own)
    np.testing.assert_array_equal(got.valid, [len(members) > 1 for members, _ in found])
    np.testing.assert_allclose(got.values, want, rtol=1e-5, atol=1e-5)


def test_two_points_by_hand():
    """Normals up, the second point 45 degrees up: phi of +-0.707 is in bin 9 or 1, theta and alpha of 0 in bin 5."""
    points, normals = np.array([[0.0, 0, 0], [1, 0, 1]]), np.tile([0, 0, 1.0], (2, 1))
    got = fpfh(points, normals, 2.0)
    want = np.zeros((2, 33))
    want[:, [5, 11 + 5]] = 100
    want[0, 22 + 1], want[1, 22 + 9] = 100, 100  # each shows what the other one counts
    np.testing.assert_allclose(got.values, want, atol=1e-4)


def test_weight_is_one_over_squared_distance():
    """A centre between one neighbour at 1 m and another at 2 m weighs their histograms 4 to 1."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [-2, 0, 0]])
    normals = np.array([[0, 0, 1.0], [0, 0.6, 0.8], [0, -0.6, 0.8]])
    first = slow_fpfh(points, normals, [[0], [1, 0], [2, 0]], own_spfh=True)[1:].reshape(2, 3, 11)  # their own alone
    got = fpfh(points, normals, 2.0, own_spfh=False).values[0].reshape(3, 11)
    assert got.sum() == pytest.approx(300, rel=1e-6)
    np.testing.assert_allclose(got, 0.8 * first[0] + 0.2 * first[1], atol=1e-4)


def test_searching_twice_changes_nothing(monkeypatch):
    points, normals = bumpy(500)
    once = fpfh(points, normals, 0.1).values
    monkeypatch.setattr(op, 'KEEP', 0)
    monkeypatch.setattr(op, 'CHUNK', 100)
    np.testing.assert_array_equal(fpfh(points, normals, 0.1).values, once)


@settings(max_examples=10, deadline=None, derandomize=True)
@given(st.integers(0, 10_000))
def test_rotation_and_order_change_nothing(seed):
    points, normals = bumpy(400)
    turn, order = rotation(seed), np.random.default_rng(seed).permutation(400)
    base = fpfh(points, normals, 0.11).values
    turned = fpfh(points @ turn, normals @ turn, 0.11).values
    assert np.quantile(np.abs(base - turned).max(axis=1), 0.9) < 1e-3  # a pair may move over the edge of a bin
    np.testing.assert_allclose(fpfh(points[order], normals[order], 0.11).values, base[order], rtol=1e-6)


def test_a_plane_fills_the_middle_bins():
    points = np.random.default_rng(0).random((300, 3)) * [1, 1, 0]
    got = FPFH(radius=0.15).compute(cloud(points))
    assert got.valid.all()
    np.testing.assert_allclose(got.values[:, [5, 16, 27]], 100, rtol=1e-6)


def test_radius_grows_with_range():
    line = np.stack([np.arange(60.0), np.zeros(60), np.zeros(60)], axis=1)
    got = FPFH(radius=0.5, range_growth=0.2).compute(cloud(line, np.tile([0, 0, 1.0], (60, 1))))
    np.testing.assert_array_equal(got.valid, np.arange(60) >= 10)  # 0.5 * 0.2 * 10 = 1 m reaches both neighbours


@pytest.mark.parametrize('part', [FPFH(radius=0.1), FPFH(radius=None, max_neighbors=10), FPFH(own_spfh=True)])
@pytest.mark.parametrize(
    'points', [np.zeros((0, 3)), np.zeros((1, 3)), np.zeros((40, 3))], ids=['empty', 'one', 'one place']
)
def test_clouds_that_cannot_be_described(part, points):
    for normals in (None, np.tile([0, 0, 1.0], (len(points), 1))):
        got = part.compute(cloud(points, normals))
        assert got.values.shape == (len(points), 33) and not got.valid.any() and not got.values.any()


def test_points_without_normal_are_left_out():
    points, normals = bumpy(300)
    bad = np.arange(300) % 7 == 0
    holes = np.where(bad[:, None], np.where(np.arange(300)[:, None] % 2 == 0, np.nan, 0.0), normals)
    got, want = fpfh(points, holes, 0.15), fpfh(points[~bad], normals[~bad], 0.15)
    np.testing.assert_allclose(got.values[~bad], want.values, rtol=1e-6)
    assert not got.valid[bad].any() and not got.values[bad].any()


def test_registry_presets_and_bad_numbers():
    assert DESCRIPTORS.build(dict(type='FPFH', radius=0.2, own_spfh=True)).own_spfh
    assert FPFH.preset('indoor').radius == 0.1 and FPFH.preset('lidar').range_growth > 0
    with pytest.raises(ValueError, match="one of .'indoor', 'lidar'., got 'moon'"):
        FPFH.preset('moon')
    with pytest.raises(ValueError, match='radius > 0'):
        FPFH(radius=0)
    with pytest.raises(ValueError, match='max_neighbors >= 2'):
        FPFH(radius=None)
    with pytest.raises(ValueError, match='got neither'):
        fpfh(np.zeros((3, 3)), np.zeros((3, 3)), None)
    with pytest.raises(ValueError, match=r'normals \(2, 3\)'):
        fpfh(np.zeros((3, 3)), np.zeros((2, 3)), 0.1)


def test_threads_change_nothing():
    assert digest('FPFH(radius=.05)', 1) == digest('FPFH(radius=.05)', 3)
