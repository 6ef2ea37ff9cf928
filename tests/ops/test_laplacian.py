"""Point-cloud Laplacian: eigenvalues of a sphere, a dense solver, parts, what spans no surface (METHOD 3 and 11)."""

import numpy as np
import pytest
import scipy.linalg
from reference.spectral_slow import slow_eigenpairs
from reference.surfaces import rotation, sphere

from rm3d_plugin.ops._blas import one_blas_thread
from rm3d_plugin.ops.laplacian import Laplacian, connected_parts, lowest_eigenpairs, point_laplacian


@pytest.mark.parametrize('radius', [0.5, 3.0])
def test_a_sphere_has_the_eigenvalues_l_l_plus_1_over_r_squared(radius):
    pairs = lowest_eigenpairs(point_laplacian(sphere(4000, radius)), 64)
    want = np.concatenate([np.full(2 * level + 1, level * (level + 1) / radius**2) for level in range(8)])
    assert pairs.values[0] < 1e-9
    np.testing.assert_allclose(pairs.values[1:4], want[1:4], rtol=1e-3)
    np.testing.assert_allclose(pairs.values[1:], want[1:], rtol=0.02)


def test_areas_sum_to_the_surface():
    assert point_laplacian(sphere(2000, 0.5)).mass.sum() == pytest.approx(np.pi, rel=2e-3)
    flat = np.random.default_rng(0).random((3000, 3)) * [1, 2, 0]
    assert point_laplacian(flat).mass.sum() == pytest.approx(2, rel=0.03)


@pytest.mark.parametrize('count', [8, 150], ids=['sparse', 'dense'])
def test_equals_the_dense_generalised_problem(count):
    points = sphere(400) * [1, 1.3, 0.6]
    laplacian = point_laplacian(points)
    got = lowest_eigenpairs(laplacian, count)
    values, functions = slow_eigenpairs(laplacian, count)
    np.testing.assert_allclose(got.values, values, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(
        np.abs(np.sum(got.functions * functions * laplacian.mass[:, None], axis=0)), 1, rtol=1e-6
    )
    gram = got.functions.T @ (laplacian.mass[:, None] * got.functions)
    np.testing.assert_allclose(gram, np.eye(count), atol=1e-10)


def test_few_points_give_few_pairs():
    pairs = lowest_eigenpairs(point_laplacian(sphere(40)), 64)
    assert pairs.values.shape == (40,) and pairs.functions.shape == (40, 40)


def test_motion_changes_nothing_even_far_away():
    points = sphere(600) * [1, 1.2, 0.7]
    base = lowest_eigenpairs(point_laplacian(points), 20).values
    moved = lowest_eigenpairs(point_laplacian(points @ rotation(0) + [500.0, -300, 20]), 20).values
    np.testing.assert_allclose(moved, base, rtol=1e-6, atol=1e-9)


def test_parts():
    first, second = point_laplacian(sphere(300)), point_laplacian(sphere(200, 0.5))
    both = Laplacian(
        scipy.sparse.block_diag([first.stiffness, second.stiffness], format='csc'),
        np.concatenate([first.mass, second.mass]),
    )
    (rows_a, part_a), (rows_b, part_b) = connected_parts(both)
    np.testing.assert_array_equal(np.concatenate([rows_a, rows_b]), np.arange(500))
    assert abs(part_a.stiffness - first.stiffness).max() == 0 and abs(part_b.stiffness - second.stiffness).max() == 0
    np.testing.assert_array_equal(part_b.mass, second.mass)
    assert len(connected_parts(first)) == 1


def test_a_line_is_no_surface():
    assert point_laplacian(np.arange(80.0)[:, None] * [0.04, 0.01, 0]) is None


def test_too_few_points():
    with pytest.raises(ValueError, match='more than n_neighbors = 30 points, got 12'):
        point_laplacian(sphere(12))


def test_blas_threads_come_back():
    from rm3d_plugin.ops._blas import _thread_controls

    before = [get() for get, _ in _thread_controls()]
    with pytest.raises(RuntimeError, match='inside'), one_blas_thread():
        assert all(get() == 1 for get, _ in _thread_controls())
        raise RuntimeError('inside')
    assert [get() for get, _ in _thread_controls()] == before
