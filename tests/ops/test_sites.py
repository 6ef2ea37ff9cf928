"""Units from the data: the distance between points, and one site a voxel of that size."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rm3d_plugin.descriptors.fpfh import fpfh
from rm3d_plugin.ops.normals import estimate_normals
from rm3d_plugin.ops.scan_scale import scan_spacing
from rm3d_plugin.ops.site_histograms import REACH, WIDTH, with_histograms
from rm3d_plugin.ops.sites import CHANNELS, VOXEL, WIDEST, voxel_sites, voxel_size_of


@pytest.fixture
def rng():
    """A generator of its own for each test."""
    return np.random.default_rng(7)


def plane(side, spacing=1.0):
    """A square of points, ``spacing`` apart."""
    x, y = np.meshgrid(np.arange(side) * spacing, np.arange(side) * spacing)
    return np.stack([x.ravel(), y.ravel(), np.zeros(side * side)], axis=1)


@given(st.floats(0.01, 5.0))
@settings(deadline=None, max_examples=8)
def test_the_distance_between_points_is_found_and_scales_with_the_scan(spacing):
    found = scan_spacing(plane(30, spacing))
    assert found == pytest.approx(spacing, rel=0.1)
    assert found == pytest.approx(spacing * scan_spacing(plane(30)), rel=1e-6)


def test_a_random_subset_of_half_the_points_is_root_two_coarser(rng):
    points = rng.uniform(0, 10, (8000, 3)) * [1, 1, 0]
    assert scan_spacing(points[:4000]) / scan_spacing(points) == pytest.approx(np.sqrt(2), rel=0.05)


@pytest.mark.parametrize('points', [np.zeros((0, 3)), np.zeros((1, 3)), np.zeros((5, 3))])
def test_no_distance_where_all_points_share_a_place(points):
    assert scan_spacing(points) == 0.0
    sites = voxel_sites(points)
    assert not sites.valid.any() and len(sites.rows) == len(points) and sites.inputs.shape[1] == CHANNELS


def test_sites_by_hand():
    points = np.array([[0.2, 0.0, 0.0], [0.9, 0.0, 0.0], [1.3, 0.0, 0.0], [0.2, 2.5, 0.0]])
    sites = voxel_sites(points, 1.0)  # from the least corner (0.2, 0, 0): x 0, 0.7 and 1.1
    assert sites.rows.tolist() == [0, 0, 2, 1]
    assert (sites.places - sites.places[0]).tolist() == [[0, 0, 0], [0, 2, 0], [1, 0, 0]]
    assert sites.unit == 1.0 and not sites.valid.any(), 'three sites make no patch'


def test_a_patch_far_from_everything_is_not_described(rng):
    dense = rng.uniform(0, 8, (3000, 3)) * [1, 1, 0.1]
    sites = voxel_sites(np.concatenate([dense, [[500.0, 0.0, 0.0]]]), 0.5)
    assert not sites.valid[sites.rows[-1]] and sites.valid[sites.rows[:-1]].all()


def test_the_voxel_is_as_wide_as_the_density_says():
    points = plane(40, 0.1)
    assert voxel_sites(points).unit == pytest.approx(VOXEL * scan_spacing(points))


def test_order_and_place_of_a_scan_change_nothing(rng):
    points = rng.uniform(0, 6, (2000, 3)) * [1, 1, 0.2]
    sites, order = voxel_sites(points), rng.permutation(2000)
    turned, moved = voxel_sites(points[order]), voxel_sites(points + [64.0, -32.0, 8.0])
    assert np.array_equal(turned.rows, sites.rows[order]) and np.array_equal(turned.places, sites.places)
    np.testing.assert_allclose(turned.inputs, sites.inputs, atol=1e-5)
    assert np.array_equal(moved.rows, sites.rows)
    np.testing.assert_allclose(moved.inputs, sites.inputs, atol=1e-4)


def test_a_stray_point_far_away_does_not_widen_the_grid():
    points = np.concatenate([plane(30, 0.1), [[1e6, 0.0, 0.0]]])
    assert voxel_sites(points, 0.1).places.max() < 100


def corner(rng):
    """Three walls that meet, 12 cm between points."""
    points = rng.uniform(0, 3, (2500, 3))
    points[np.arange(2500), rng.integers(0, 3, 2500)] = 0
    return points


def test_histograms_are_means_of_the_points(rng):
    points = corner(rng)
    normals = estimate_normals(points, 20, viewpoint=np.full(3, 9.0)).normals
    sites = voxel_sites(points)
    told = with_histograms(sites, points, normals)
    rows = np.sqrt(fpfh(points, normals, REACH * sites.unit).values / 100)
    for site in (0, 7, len(sites.places) - 1):
        np.testing.assert_allclose(told.inputs[site, CHANNELS:], rows[sites.rows == site].mean(axis=0), atol=1e-6)
    assert np.array_equal(told.inputs[:, :CHANNELS], sites.inputs) and told.inputs.shape[1] == WIDTH
    seen = with_histograms(sites, points, viewpoint=np.full(3, 9.0))
    np.testing.assert_allclose(seen.inputs, told.inputs, atol=1e-6)


def test_histograms_turn_with_the_scan(rng):
    points, eye = corner(rng), np.full(3, 9.0)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    sites = voxel_sites(points)
    told = with_histograms(sites, points, viewpoint=eye)
    turned = with_histograms(sites, points @ turn.T, viewpoint=turn @ eye)
    assert np.quantile(np.abs(turned.inputs - told.inputs).max(axis=1), 0.99) < 1e-4
    without = with_histograms(sites, points), with_histograms(sites, points @ turn.T)
    assert np.quantile(np.abs(without[0].inputs - without[1].inputs).max(axis=1), 0.99) < 1e-4


def test_no_points_have_no_histograms():
    nothing = with_histograms(voxel_sites(np.zeros((0, 3))), np.zeros((0, 3)))
    assert nothing.inputs.shape == (0, WIDTH)
    one = with_histograms(voxel_sites(np.zeros((4, 3))), np.zeros((4, 3)))
    assert one.inputs.shape == (1, WIDTH) and not one.valid.any()


def test_voxels_grow_until_a_wide_scan_fits():
    rng = np.random.default_rng(0)
    road = np.c_[np.linspace(10, 5000, 120_000), np.zeros((120_000, 2))]
    xyz = np.r_[rng.uniform(0, 0.2, (150_000, 3)), road]
    unit, sites = voxel_size_of(xyz), voxel_sites(xyz)
    doublings = np.log2(sites.unit / unit)
    assert doublings == pytest.approx(round(doublings)) and doublings >= 1
    assert WIDEST / 2 < sites.places[:, 0].max() <= WIDEST
    with pytest.raises(ValueError, match=r'voxels of .* m wide, at most 60000; pass a larger voxel'):
        voxel_sites(xyz, unit)


def test_of_a_crowded_site_some_points_stand_for_all(rng):
    xyz = np.r_[plane(40), rng.uniform([20.1, 20.1, 0], [20.9, 20.9, 0], (5000, 3))]
    sites = voxel_sites(xyz, 1.6)
    assert np.bincount(sites.rows).max() > 1000
    crowded = with_histograms(sites, xyz).inputs
    assert (crowded[:, CHANNELS:].sum(axis=1) > 0).all()
    order = rng.permutation(len(xyz))
    turned_round = with_histograms(voxel_sites(xyz[order], 1.6), xyz[order]).inputs
    assert np.allclose(crowded, turned_round, atol=1e-5)
    alone = with_histograms(voxel_sites(plane(40), 1.6), plane(40)).inputs
    assert np.allclose(crowded[:, CHANNELS:], alone[:, CHANNELS:], atol=0.15), 'a plane is a plane, however crowded'
