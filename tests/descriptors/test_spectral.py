"""HKS, WKS, SI-HKS: the formulas as loops, invariances, components, what cannot be described (METHOD 3 and 11)."""

import numpy as np
import pytest
from reference.spectral_slow import slow_eigenpairs, slow_hks, slow_sihks, slow_wks
from reference.surfaces import cloud, digest, rotation, sphere

from rm3d_plugin.descriptors import (
    HKS,
    SIHKS,
    WKS,
    heat_kernel_signature,
    scale_invariant_heat_kernel_signature,
    wave_kernel_signature,
)
from rm3d_plugin.descriptors.spectral import spread_to_points
from rm3d_plugin.ops.laplacian import Eigenpairs, lowest_eigenpairs, point_laplacian
from rm3d_plugin.registry import DESCRIPTORS

PARTS = (HKS, WKS, SIHKS)


def pear(count=4000, size=1.0, seed=0):
    """A closed surface without symmetry about 1 m wide, its points in random order."""
    points = sphere(count)
    width = 0.5 + 0.15 * points[:, 2] + 0.1 * points[:, 0] * points[:, 1]
    order = np.random.default_rng(seed).permutation(count)
    return (size * points * width[:, None])[order]


def far(first, second):
    """Relative distance of rows."""
    return np.linalg.norm(first - second, axis=1) / np.linalg.norm(first, axis=1)


@pytest.mark.parametrize(
    ('function', 'slow'),
    [
        (heat_kernel_signature, slow_hks),
        (wave_kernel_signature, slow_wks),
        (scale_invariant_heat_kernel_signature, slow_sihks),
    ],
)
def test_equals_the_loops(function, slow):
    laplacian = point_laplacian(pear(300))
    got = function(lowest_eigenpairs(laplacian, 40))
    np.testing.assert_allclose(got, slow(*slow_eigenpairs(laplacian, 40)), rtol=2e-5, atol=1e-5)


def test_signatures_integrate_to_one_over_the_surface():
    laplacian = point_laplacian(pear(500))
    pairs = lowest_eigenpairs(laplacian, 64)
    for signature in (heat_kernel_signature(pairs), wave_kernel_signature(pairs)):
        np.testing.assert_allclose(laplacian.mass @ signature, 1, rtol=1e-6)


def test_all_points_of_a_sphere_are_alike():
    pairs = lowest_eigenpairs(point_laplacian(sphere(3000, 0.5)), 64)  # 64 = 1 + 3 + ... + 15: whole levels
    got = heat_kernel_signature(pairs)
    np.testing.assert_allclose(got, np.full_like(got, 1 / np.pi), rtol=0.03)
    harmonic = scale_invariant_heat_kernel_signature(pairs)
    assert (harmonic.std(axis=0) < 0.01 * harmonic[:, 0].mean()).all()


@pytest.mark.parametrize('part', PARTS)
@pytest.mark.parametrize('seed', [0, 1])
def test_rotation_changes_nothing(part, seed):
    points = pear()
    turned = (points @ rotation(seed)) + [3.0, -2, 1]
    first, second = part().compute(cloud(points)), part().compute(cloud(turned))
    assert first.valid.all() and second.valid.all()
    gap = far(first.values, second.values)
    assert np.median(gap) < 1e-3 and gap.max() < 0.02


@pytest.mark.parametrize('part', PARTS)
def test_order_changes_little(part):
    """Another order thins to other points of the same surface."""
    points, order = pear(), np.random.default_rng(3).permutation(4000)
    first, second = part().compute(cloud(points)).values, part().compute(cloud(points[order])).values
    assert np.median(far(first[order], second)) < 0.02


@pytest.mark.parametrize('factor', [0.5, 4.0])
def test_sihks_does_not_know_size(factor):
    pairs = lowest_eigenpairs(point_laplacian(pear(800)), 64)
    scaled = lowest_eigenpairs(point_laplacian(factor * pear(800)), 64)
    first, second = (scale_invariant_heat_kernel_signature(p) for p in (pairs, scaled))
    np.testing.assert_allclose(first, second, rtol=1e-5, atol=1e-5)
    heat, more = heat_kernel_signature(pairs), heat_kernel_signature(scaled)
    np.testing.assert_allclose(more * factor**2, heat, rtol=1e-5)  # the others scale as 1 / area


def test_sihks_of_two_sizes_at_one_spacing():
    """The same sub-cloud spacing resolves both: the lowest coefficients agree, whole shapes differ far more."""
    part = SIHKS(spacing=0.04)
    small, large = part.compute(cloud(pear(6000))).values, part.compute(cloud(pear(6000, 2.0))).values
    assert np.median(far(small, large)) < 0.03


def test_heat_stays_where_a_surface_curves():
    """A cigar's ends hold more heat than its waist, at every time."""
    points = sphere(4000) * [0.3, 0.3, 0.9]
    values = HKS().compute(cloud(points)).values
    ends, waist = values[np.abs(points[:, 2]) > 0.85], values[np.abs(points[:, 2]) < 0.1]
    assert (ends.mean(axis=0) > 1.1 * waist.mean(axis=0)).all()


def test_each_component_has_its_own_spectrum():
    """A second surface, a speck and a wire far away change nothing for the first; specks and wires are not valid."""
    points = pear()
    wire = np.arange(200)[:, None] * [0.02, 0, 0] + [0, 5.0, 0]
    speck = np.random.default_rng(0).random((30, 3)) * 0.1 + [5.0, 0, 0]
    alone = HKS().compute(cloud(points))
    together = HKS().compute(cloud(np.concatenate([points, points + [0, 0, 3.0], speck, wire])))
    np.testing.assert_array_equal(together.values[:4000], alone.values)
    assert np.median(far(alone.values, together.values[4000:8000])) < 1e-2
    np.testing.assert_array_equal(together.valid, np.arange(8230) < 8000)
    assert not together.values[8000:].any()


def test_spreading_by_hand():
    """Between samples at 0 and 3: weights 1 / 1 and 1 / 4; a sample of another surface gives nothing."""
    samples, values = np.array([[0.0, 0, 0], [3, 0, 0], [0, 1.5, 0]]), np.array([[10.0], [20.0], [999.0]])
    surface = np.array([0, 0, 1])
    queries = np.array([[1.0, 0, 0], [0, 0, 0], [0, 1.4, 0]])
    got, valid = spread_to_points(queries, samples, surface, values)
    np.testing.assert_allclose(got[:, 0], [12, 10, 999], rtol=1e-5)
    assert valid.all()
    got, valid = spread_to_points(queries, samples, np.array([0, 0, -1]), values)
    np.testing.assert_array_equal(valid, [True, True, False])
    assert got[2, 0] == 0


def test_two_equal_eigenvalues_give_numbers():
    """A spectrum without width has energies in one place."""
    pairs = Eigenpairs(np.array([0.0, 2.0, 2.0]), np.ones((3, 3)))
    np.testing.assert_allclose(wave_kernel_signature(pairs), 1)
    np.testing.assert_allclose(heat_kernel_signature(pairs), 1)


@pytest.mark.parametrize('part', PARTS)
@pytest.mark.parametrize(
    'points',
    [np.zeros((0, 3)), np.zeros((1, 3)), np.zeros((200, 3)), np.arange(300.0)[:, None] * [0.05, 0, 0]],
    ids=['empty', 'one', 'one place', 'line'],
)
def test_clouds_that_cannot_be_described(part, points):
    got = part().compute(cloud(points))
    width = 6 if part is SIHKS else 100
    assert got.values.shape == (len(points), width) and not got.valid.any() and not got.values.any()


def test_registry_presets_and_bad_numbers():
    built = DESCRIPTORS.build(dict(type='SIHKS', spacing=0.05, eigenpairs=100))
    assert isinstance(built, SIHKS) and built.settings.eigenpairs == 100
    assert isinstance(DESCRIPTORS.build(dict(type='HKS')), HKS) and isinstance(DESCRIPTORS.build(dict(type='WKS')), WKS)
    assert WKS.preset('indoor').settings.spacing == 0.04 and HKS.preset('lidar').settings.link == 0.8
    with pytest.raises(ValueError, match="HKS.preset: expected one of .'indoor', 'lidar'., got 'moon'"):
        HKS.preset('moon')
    with pytest.raises(ValueError, match='0 < spacing <= link'):
        HKS(spacing=0.05, link=0.04)
    with pytest.raises(ValueError, match='eigenpairs'):
        WKS(eigenpairs=2)
    with pytest.raises(ValueError, match='more than n_neighbors = 30, got 20'):
        SIHKS(min_points=20)


def test_threads_change_nothing():
    assert digest('SIHKS()', 1) == digest('SIHKS()', 3)


@pytest.mark.parametrize('part', PARTS)
def test_presets_are_shared(part):
    assert set(part.presets) == {'indoor', 'lidar'} and part.presets is HKS.presets
