"""Heights of sites against loops over all others, and what turned, strayed and empty scans do."""

import numpy as np
import pytest

from rm3d_plugin.ops.site_heights import HEIGHTS, upright_sites, with_heights
from rm3d_plugin.ops.sites import CHANNELS, voxel_sites


def scene():
    """A floor at 2 m with a wall of 3 m at its edge, and a step of half a metre."""
    rng = np.random.default_rng(0)
    floor = np.c_[rng.uniform(0, 8, (4000, 2)), np.full(4000, 2.0)]
    floor[floor[:, 0] > 6, 2] = 2.5
    wall = np.c_[np.zeros(2000), rng.uniform(0, 8, 2000), rng.uniform(2, 5, 2000)]
    return np.r_[floor, wall]


def test_heights_equal_a_loop():
    sites = voxel_sites(scene(), 0.25)
    found = with_heights(sites).inputs[:, CHANNELS:]
    assert found.shape == (len(sites.places), HEIGHTS) and found.dtype == np.float32
    xyz = sites.places.astype(np.float64) * sites.unit  # from 0
    column = np.floor(xyz[:, :2] - xyz[:, :2].min(axis=0))
    for row in range(0, len(xyz), 37):
        near = (np.abs(column - column[row]) <= 2).all(axis=1)
        assert found[row, 0] == pytest.approx((xyz[row, 2] - xyz[near, 2].min()) / 3, abs=1e-6)
    assert np.allclose(found[:, 1], (xyz[:, 2] - np.percentile(xyz[:, 2], 1)) / 3, atol=1e-6)
    assert np.allclose(found[:, 3], np.log(0.25 / 0.05) / 3)
    inside = (xyz[:, 0] > 1) & (xyz[:, 0] < 5)
    assert np.median(found[inside, 2]) > 0.99, 'the floor points up'
    upper = (xyz[:, 0] < 0.5) & (xyz[:, 2] > 1)
    assert np.median(found[upper, 2]) < 0.1, 'the wall does not'


def test_what_is_far_up_or_down_is_all_alike():
    points = np.r_[scene(), [[4.0, 4.0, 90.0], [4.1, 4.0, 90.0]]]
    found = with_heights(voxel_sites(points, 0.25)).inputs[:, CHANNELS:]
    assert found[:, 0].max() == 4.0 and found[:, 1].max() == 4.0


def test_a_single_return_below_the_ground_changes_no_other_height():
    points = scene()
    before = with_heights(voxel_sites(points, 0.25))
    after = with_heights(voxel_sites(np.r_[points, [[4.0, 4.0, -8.0]]], 0.25))
    first = np.unique(after.rows[: len(points)], return_index=True)[1]
    found, wanted = after.inputs[after.rows[first], CHANNELS], before.inputs[before.rows[first], CHANNELS]
    assert np.abs(found - wanted).max() < 0.05


def test_a_scan_that_is_turned_a_quarter_has_the_same_heights():
    points = scene()
    turned = points[:, [1, 0, 2]] * [1, -1, 1] + [0, 8, 0]
    first, second = (with_heights(voxel_sites(each, 0.25)) for each in (points, turned))
    gaps = np.abs(first.inputs[first.rows, CHANNELS:] - second.inputs[second.rows, CHANNELS:])
    assert np.quantile(gaps[:, [0, 1, 3]], 0.95) < 0.05 and np.quantile(gaps[:, 2], 0.9) < 0.1


@pytest.mark.parametrize('count', [0, 1, 3])
def test_scans_of_few_points(count):
    sites = upright_sites(np.eye(8, 3)[:count])
    assert len(sites.inputs) == len(sites.places) and np.isfinite(sites.inputs).all()
    if count:
        assert sites.inputs.shape[1] == CHANNELS + 33 + HEIGHTS


def test_a_long_road_gets_wider_columns():
    road = np.c_[np.linspace(0, 3e7, 500), np.zeros(500), np.zeros(500)]
    assert np.isfinite(with_heights(voxel_sites(road, 1e3)).inputs).all()
