"""Normals and curvature against numpy's eigensolver, hand-made shapes and PCL."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.neighbors_slow import slow_neighbors

from rm3d_plugin.ops.normals import estimate_normals
from rm3d_plugin.ops.octree import Octree

GOLDEN = Path(__file__).resolve().parents[1] / 'golden'


def slow_normals(points, neighborhoods):
    """(normal, curvature, eigenvalues) of each neighbourhood by numpy's eigh."""
    rows = []
    for members in neighborhoods:
        centred = points[members].astype(np.float64) - points[members].astype(np.float64).mean(axis=0)
        values, vectors = np.linalg.eigh(centred.T @ centred)
        rows.append((vectors[:, 0], max(values[0], 0) / values.sum(), values))
    return rows


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.integers(4, 40), st.floats(1e-6, 1), st.floats(1e-3, 1), st.sampled_from([0.0, 1e3, 1e6]), st.integers(0, 99))
def test_equals_numpy_on_flat_and_long_neighborhoods(count, flatness, width, offset, seed):
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    points = (rng.normal(size=(count, 3)) * [1, width, flatness * width]) @ turn + offset
    got = estimate_normals(points, k=12)
    expected = slow_normals(points, [row for row, _ in slow_neighbors(points, points, k=12)])
    for normal, curvature, valid, (want, want_curvature, values) in zip(
        got.normals, got.curvature, got.valid, expected, strict=True
    ):
        assert valid
        assert curvature == pytest.approx(want_curvature, abs=1e-7)
        gap = (values[1] - values[0]) / values[2]
        if gap > 1e-6:  # otherwise the normal is any of a plane of directions
            assert abs(normal @ want) == pytest.approx(1, abs=1e-6)


def test_plane_and_sphere():
    rng = np.random.default_rng(0)
    tilted = np.array([1.0, 2.0, 2.0]) / 3
    flat = rng.random((300, 3))
    flat -= np.outer(flat @ tilted, tilted)
    got = estimate_normals(flat, k=15, viewpoint=10 * tilted)
    np.testing.assert_allclose(got.normals, np.tile(tilted, (300, 1)), atol=1e-6)
    np.testing.assert_allclose(got.curvature, 0, atol=1e-12)
    sphere = rng.normal(size=(4000, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    inward = estimate_normals(sphere, radius=0.2, viewpoint=(0, 0, 0)).normals
    assert np.degrees(np.arccos(np.clip(-(inward * sphere).sum(axis=1), -1, 1))).max() < 4
    assert (estimate_normals(sphere, radius=0.2, viewpoint=(0, 0, 0)).curvature < 0.02).all()


def test_isotropic_neighborhood_has_the_largest_curvature():
    cross = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    np.testing.assert_allclose(estimate_normals(cross, k=6).curvature, 1 / 3, atol=1e-7)


def test_without_viewpoint_the_largest_component_is_positive():
    points = np.random.default_rng(0).random((200, 3)) * [1, 1, 0.01]
    for view in (None, (0.5, 0.5, 9.0)):
        assert (estimate_normals(points, viewpoint=view).normals[:, 2] > 0.9).all()
    assert (estimate_normals(points, viewpoint=(0.5, 0.5, -9.0)).normals[:, 2] < -0.9).all()


@pytest.mark.parametrize(
    ('points', 'kwargs'),
    [
        (np.zeros((0, 3)), {}),
        (np.ones((1, 3)), {}),
        (np.array([[0.0, 0, 0], [1, 0, 0]]), {}),
        (np.random.default_rng(0).random((9, 3)), {'k': 2}),
        (np.random.default_rng(0).random((9, 3)), {'radius': 1e-6}),
        (np.full((30, 3), 5.0), {}),
    ],
    ids=['empty', 'one', 'two', 'k = 2', 'tiny radius', 'one place'],
)
def test_too_few_points_are_not_valid(points, kwargs):
    got = estimate_normals(points, **kwargs)
    assert not got.valid.any()
    np.testing.assert_array_equal(got.normals, np.tile(np.float32([0, 0, 1]), (len(points), 1)))
    np.testing.assert_array_equal(got.curvature, np.zeros(len(points), dtype=np.float32))
    assert got.normals.dtype == got.curvature.dtype == np.float32


def test_three_points_and_a_line():
    triangle = estimate_normals(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]))
    np.testing.assert_allclose(triangle.normals, [[0, 0, 1]] * 3, atol=1e-7)
    line = estimate_normals(np.linspace(0, 1, 30)[:, None] * np.array([[1.0, 2, 3]]))
    assert line.valid.all()
    np.testing.assert_allclose(np.linalg.norm(line.normals, axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(line.normals @ np.array([1, 2, 3]), 0, atol=1e-5)


def test_a_given_octree_and_blocks_change_nothing():
    points = np.random.default_rng(0).random((6000, 3))
    first, second = estimate_normals(points), estimate_normals(points, octree=Octree(points, leaf_size=7))
    np.testing.assert_array_equal(first.normals, second.normals)
    some = slow_normals(points, [row for row, _ in slow_neighbors(points, points[::500], k=20)])
    for row, (normal, curvature, _) in zip(range(0, 6000, 500), some, strict=True):
        assert abs(first.normals[row] @ normal) == pytest.approx(1, abs=1e-6)
        assert first.curvature[row] == pytest.approx(curvature, abs=1e-7)


def test_bad_input_is_named():
    points = np.zeros((4, 3))
    with pytest.raises(ValueError, match='k: expected at least 1, got 0'):
        estimate_normals(points, k=0)
    with pytest.raises(ValueError, match='radius: expected a positive radius in metres, got 0'):
        estimate_normals(points, radius=0.0)
    with pytest.raises(ValueError, match='one of the 4 points, got one of 5'):
        estimate_normals(points, octree=Octree(np.zeros((5, 3))))
    with pytest.raises(ValueError, match='1 of 4 rows are NaN'):
        estimate_normals(np.array([[0, 0, 0], [1, 0, 0], [np.nan, 0, 0], [0, 1, 0]]))


def test_equals_pcl():
    points = np.load(GOLDEN / 'cloud_2000.npz')['points']
    expected = np.load(GOLDEN / 'pcl_descriptors.npz')['pcl_normals_curvature_r006']
    got = estimate_normals(points, radius=0.06, viewpoint=(0.5, 0.5, 2.0))
    known = np.isfinite(expected).all(axis=1)
    np.testing.assert_array_equal(got.valid, known)
    assert (got.normals * expected[:, :3]).sum(axis=1)[known].min() > 1 - 1e-6  # sign included
    np.testing.assert_allclose(got.curvature[known], expected[known, 3], atol=3e-6)
