"""Adapted and original PFH: PCL's values, invariances, presets (METHOD 3 and 11)."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.neighbors_slow import slow_neighbors
from reference.pair_features_slow import slow_histogram

from rm3d_plugin.descriptors import PFH, AdaptedPFH, adapted_pfh, original_pfh
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import PointCloud

GOLDEN = Path(__file__).resolve().parents[1] / 'golden'


def bumpy(count=1500, seed=0):
    """A wavy sheet with its exact normals."""
    rng = np.random.default_rng(seed)
    x, y = rng.random((2, count))
    z = 0.1 * np.sin(7 * x) * np.cos(5 * y)
    slope = np.stack(
        [-0.7 * np.cos(7 * x) * np.cos(5 * y), 0.5 * np.sin(7 * x) * np.sin(5 * y), np.ones(count)], axis=1
    )
    return np.stack([x, y, z], axis=1), slope / np.linalg.norm(slope, axis=1, keepdims=True)


def rotation(seed):
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return turn * np.sign(np.linalg.det(turn))


def cloud(points, normals=None, **more):
    return PointCloud(np.float32(points), normals=None if normals is None else np.float32(normals), **more)


def test_adapted_equals_pcl():
    """A pair of the largest neighbourhood that moves over an edge is 2.2e-4; rounding in PCL's sums is under 5e-5."""
    given_cloud = np.load(GOLDEN / 'cloud_2000.npz')
    expected = np.load(GOLDEN / 'pcl_descriptors.npz')['pfh125'] / 100
    got = AdaptedPFH(radius=0.1, max_neighbors=None).compute(cloud(given_cloud['points'], given_cloud['normals']))
    assert got.valid.sum() == 1999  # one point has a single neighbour
    np.testing.assert_allclose(got.values[got.valid], expected[got.valid], atol=5e-5)


@pytest.mark.parametrize('cap', [None, 20])
def test_adapted_equals_the_double_loop(cap):
    points, normals = (np.float32(a) for a in bumpy(600))
    got = adapted_pfh(points, normals, 0.11, cap)
    neighborhoods = slow_neighbors(points, points, 0.11, cap)
    for row in range(0, 600, 40):
        members = neighborhoods[row][0]
        want = slow_histogram(points[members], normals[members])
        assert got.pairs[row] == want.pairs > 0
        assert np.abs(got.values[row] - want.values).sum() / 2 * want.pairs <= want.doubtful + 1e-3


def test_original_equals_the_double_loop():
    points, normals = (np.float32(a) for a in bumpy(300))
    scaled, absolute = original_pfh(points, normals, k=15), original_pfh(points, normals, k=15, distance_span=0.2)
    for row in range(0, 300, 40):
        members, squares = slow_neighbors(points, points[row : row + 1], k=15)[0]
        for got, span in ((scaled, 2 * np.sqrt(squares[-1])), (absolute, 0.2)):
            want = slow_histogram(points[members], normals[members], span)
            assert np.abs(got.values[row] - want.values).sum() / 2 * want.pairs <= want.doubtful + 1e-3


def same_rows(first, second):
    """Rows are equal but for few pairs that rounding moved over an edge."""
    moved = np.abs(first.values - second.values).sum(axis=1) / 2
    return moved.mean() < 2e-3 and moved.max() < 0.05


@settings(max_examples=8, deadline=None, derandomize=True)
@given(st.integers(0, 10_000))
@pytest.mark.parametrize('part', [AdaptedPFH(radius=0.1), PFH(k=20), PFH(k=20, distance_span=0.2)])
def test_rotation_changes_nothing(part, seed):
    points, normals = bumpy(400)
    turn = rotation(seed)
    normals = normals + np.random.default_rng(1).normal(0, 0.05, normals.shape)  # no pair leans equally
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert same_rows(part.compute(cloud(points, normals)), part.compute(cloud(points @ turn, normals @ turn)))


def test_rotation_changes_nothing_with_estimated_normals():
    points, _ = bumpy(800)
    for sensor in (None, np.array([0.5, 0.5, 3.0])):
        turn = rotation(4)
        first = AdaptedPFH(radius=0.1).compute(cloud(points, sensor=sensor))
        turned = None if sensor is None else sensor @ turn
        second = AdaptedPFH(radius=0.1).compute(cloud(points @ turn, sensor=turned))
        moved = np.abs(first.values - second.values).sum(axis=1) / 2
        assert moved.mean() < 0.01 and np.median(moved) < 0.01


@settings(max_examples=15, deadline=None, derandomize=True)
@given(st.integers(0, 10_000))
def test_permuting_points_permutes_rows(seed):
    points, normals = (np.float32(a) for a in bumpy(300))
    order = np.random.default_rng(seed).permutation(300)
    for function in (lambda p, n: adapted_pfh(p, n, 0.12, 12), lambda p, n: original_pfh(p, n, 12)):
        np.testing.assert_array_equal(
            function(points, normals).values[order], function(points[order], normals[order]).values
        )


def test_rows_sum_to_one():
    points, normals = bumpy(500)
    for got in (AdaptedPFH(radius=0.1), PFH()):
        values = got.compute(cloud(points, normals)).values
        np.testing.assert_allclose(values.sum(axis=1), 1, atol=1e-5)
        assert (values >= 0).all()


@pytest.mark.parametrize('given_normals', [True, False])
def test_a_plane_fills_one_bin(given_normals):
    points = np.random.default_rng(0).random((400, 3)) * [1, 1, 0]
    normals = np.tile([0, 0, 1.0], (400, 1)) if given_normals else None
    got = AdaptedPFH(radius=0.15).compute(cloud(points, normals))
    assert got.valid.all()
    np.testing.assert_array_equal(got.values, np.eye(125, dtype=np.float32)[np.full(400, 62)])
    per_distance = PFH(k=20).compute(cloud(points, normals)).values.reshape(400, 5, 125)
    np.testing.assert_allclose(per_distance[:, :, 62].sum(axis=1), 1, atol=1e-6)


def test_scale():
    """Scaling by 3 with the radius leaves the adapted histogram; the original one only if distance is relative."""
    points, normals = bumpy(500)
    small, large = cloud(points, normals), cloud(3 * np.float32(points), normals)
    assert same_rows(AdaptedPFH(radius=0.1).compute(small), AdaptedPFH(radius=0.3).compute(large))
    assert same_rows(PFH(k=20).compute(small), PFH(k=20).compute(large))
    absolute = PFH(k=20, distance_span=0.2)
    assert np.abs(absolute.compute(small).values - absolute.compute(large).values).sum(axis=1).min() > 0.2


def test_the_nearest_are_kept_and_ties_go_to_the_lowest_number():
    """Six corners at one distance round a centre: a cap of four keeps the centre and the first three."""
    points = np.float32([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(7, 3))
    normals = np.float32(normals / np.linalg.norm(normals, axis=1, keepdims=True))
    want = slow_histogram(points[:4], normals[:4])
    np.testing.assert_allclose(adapted_pfh(points, normals, 1.0, 4).values[0], want.values, atol=1e-6)


def test_radius_grows_with_range():
    """Rows of points 1 m apart: at 30 m the radius is 3 m and holds seven points, near the sensor one."""
    line = np.stack([np.arange(60.0), np.zeros(60), np.zeros(60)], axis=1)
    part = AdaptedPFH(radius=0.5, range_growth=0.2, max_neighbors=None)
    got = part.compute(cloud(line, np.tile([0, 0, 1.0], (60, 1))))
    np.testing.assert_array_equal(got.valid, np.arange(60) >= 10)  # 0.5 * 0.2 * 10 = 1 m reaches both neighbours
    moved = part.compute(cloud(line, np.tile([0, 0, 1.0], (60, 1)), sensor=(59.0, 0.0, 0.0)))
    np.testing.assert_array_equal(moved.valid, np.arange(60) <= 49)


@pytest.mark.parametrize('part', [AdaptedPFH(radius=0.1), PFH(k=20)])
@pytest.mark.parametrize(
    'points',
    [np.zeros((0, 3)), np.zeros((1, 3)), np.array([[0.0, 0, 0], [0.05, 0, 0]]), np.zeros((40, 3))],
    ids=['empty', 'one', 'two', 'one place'],
)
def test_clouds_that_cannot_be_described(part, points):
    for normals in (None, np.tile([0, 0, 1.0], (len(points), 1))):
        got = part.compute(cloud(points, normals))
        assert len(got) == len(points) and not got.valid.any() and not got.values.any()


def test_isolated_points_are_not_valid():
    points, normals = bumpy(300)
    points = np.concatenate([points, [[9.0, 9, 9], [-9, 0, 0], [-9, 0.01, 0]]])
    normals = np.concatenate([normals, [[0, 0, 1.0]] * 3])
    got = AdaptedPFH(radius=0.15).compute(cloud(points, normals))
    assert got.valid[:300].all() and not got.valid[300:].any() and not got.values[300:].any()


def test_registry_presets_and_bad_numbers():
    built = DESCRIPTORS.build(dict(type='AdaptedPFH', radius=0.2))
    assert isinstance(built, AdaptedPFH) and built.radius == 0.2
    assert isinstance(DESCRIPTORS.build(dict(type='PFH', k=12)), PFH)
    assert AdaptedPFH.preset('indoor').radius == 0.1 and AdaptedPFH.preset('indoor').range_growth == 0
    assert AdaptedPFH.preset('lidar').range_growth > 0
    with pytest.raises(ValueError, match="one of .'indoor', 'lidar'., got 'moon'"):
        AdaptedPFH.preset('moon')
    with pytest.raises(ValueError, match='radius > 0'):
        AdaptedPFH(radius=0)
    with pytest.raises(ValueError, match='k >= 3'):
        PFH(k=2)


def test_threads_change_nothing():
    """The same digest of normals and descriptors from processes with one thread and with three."""
    code = (
        'import hashlib, numpy as np\n'
        'from rm3d_plugin.descriptors import PFH, AdaptedPFH\n'
        'from rm3d_plugin.structures import PointCloud\n'
        'c = PointCloud(np.random.default_rng(0).random((9000, 3)) * [1, 1, .05])\n'
        'a, b = AdaptedPFH(radius=.05).compute(c), PFH(k=12).compute(c)\n'
        'print(hashlib.sha256(a.values.tobytes() + b.values.tobytes()).hexdigest(), a.valid.sum())'
    )

    def digest(threads):
        environment = {**os.environ, 'NUMBA_NUM_THREADS': str(threads)}
        return subprocess.run(
            [sys.executable, '-c', code], env=environment, capture_output=True, text=True, check=True
        ).stdout

    assert digest(1) == digest(3)
