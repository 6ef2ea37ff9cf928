"""Thinning: equal to looking at every kept point, no preference for axes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.surfaces import rotation

from rm3d_plugin.ops.voxel_downsample import voxel_downsample_points


def slow_thin(points, spacing):
    kept = []
    for row, point in enumerate(points):
        if all(((points[other] - point) ** 2).sum() >= spacing * spacing for other in kept):
            kept.append(row)
    return kept


@settings(max_examples=20, deadline=None, derandomize=True)
@given(st.integers(0, 10_000), st.sampled_from([0.02, 0.1, 0.3, 2.0]))
def test_equals_the_loop(seed, spacing):
    points = np.random.default_rng(seed).random((200, 3)) * [1, 1, 0.2] - 0.5
    np.testing.assert_array_equal(voxel_downsample_points(points, spacing), slow_thin(points, spacing))


def test_a_turned_cloud_keeps_the_same_points():
    points = np.random.default_rng(0).random((3000, 3)) * [2, 2, 0.1]
    np.testing.assert_array_equal(
        voxel_downsample_points(points @ rotation(1), 0.05), voxel_downsample_points(points, 0.05)
    )


def test_spacing_and_cover():
    points = np.random.default_rng(0).random((2000, 3))
    kept = points[voxel_downsample_points(points, 0.1)]
    apart = np.linalg.norm(kept[:, None] - kept, axis=2) + 10 * np.eye(len(kept))
    assert apart.min() >= 0.1 and np.linalg.norm(points[:, None] - kept, axis=2).min(axis=1).max() < 0.1


def test_small_clouds_and_bad_numbers():
    assert len(voxel_downsample_points(np.zeros((0, 3)), 0.1)) == 0
    np.testing.assert_array_equal(voxel_downsample_points(np.zeros((5, 3)), 0.1), [0])
    np.testing.assert_array_equal(voxel_downsample_points(np.array([[0.0, 0, 0], [0.1, 0, 0]]), 0.1), [0, 1])
    with pytest.raises(ValueError, match='metres > 0, got 0'):
        voxel_downsample_points(np.zeros((5, 3)), 0)


def test_a_cloud_of_any_width(monkeypatch):
    points = np.array([[0.0, 0, 0], [0.005, 0, 0], [1e6, 0, 0], [1e6 + 0.009, 0, 0], [1e6 + 0.02, -1e6, 0]])
    np.testing.assert_array_equal(voxel_downsample_points(points, 0.01), [0, 2, 4])
    monkeypatch.setattr('rm3d_plugin.ops.voxel_downsample.REACH', 8)
    with pytest.raises(ValueError, match='times as wide'):
        voxel_downsample_points(np.arange(24.0).reshape(8, 3), 0.01)
