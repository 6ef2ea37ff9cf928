"""Rigid motions between matched points, against known motions and scipy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rm3d_plugin.ops.rigid_fit import move, ransac_rigid, rigid_fit


def motion_of(seed):
    motion = np.eye(4)
    motion[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    motion[:3, 3] = np.random.default_rng(seed).normal(size=3)
    return motion


def test_a_quarter_turn_by_hand():
    quarter = np.array([[0.0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    np.testing.assert_allclose(move(quarter, np.array([[1.0, 0, 0]])), [[1, 3, 3]])
    np.testing.assert_allclose(
        move(np.stack([quarter, np.eye(4)]), np.array([[1.0, 0, 0]])), [[[1, 3, 3]], [[1, 0, 0]]]
    )


def test_fit_finds_the_motion_of_a_batch_and_is_scipys():
    rng, true = np.random.default_rng(0), np.stack([motion_of(1), motion_of(2)])
    xyz = rng.normal(size=(2, 6, 3))
    after = np.stack([move(motion, points) for motion, points in zip(true, xyz, strict=True)])
    np.testing.assert_allclose(rigid_fit(xyz, after), true, atol=1e-12)
    noisy = after[0] + 0.1 * rng.normal(size=(6, 3))
    mean = xyz[0].mean(axis=0)
    theirs = Rotation.align_vectors(noisy - noisy.mean(axis=0), xyz[0] - mean)[0].as_matrix()
    ours = rigid_fit(xyz[0], noisy)
    np.testing.assert_allclose(ours[:3, :3], theirs, atol=1e-9)
    np.testing.assert_allclose(ours[:3, 3], noisy.mean(axis=0) - theirs @ mean, atol=1e-9)


def test_no_mirror():
    xyz = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    found = rigid_fit(xyz, xyz * [1, 1, -1])[:3, :3]
    assert np.linalg.det(found) == pytest.approx(1)
    with pytest.raises(ValueError, match='3 or more'):
        rigid_fit(xyz[:2], xyz[:2])


def test_ransac_among_nine_wrong_matches_of_ten():
    rng, true = np.random.default_rng(3), motion_of(4)
    source = rng.uniform(-3, 3, (300, 3))
    target = move(true, source)
    target[30:] = rng.uniform(-3, 3, (270, 3))
    found = ransac_rigid(source, target, 0.1, np.random.default_rng(0))
    np.testing.assert_allclose(found, true, atol=0.02)
    np.testing.assert_array_equal(found, ransac_rigid(source, target, 0.1, np.random.default_rng(0)))


def test_ransac_where_no_triple_fits():
    source = np.eye(3)
    found = ransac_rigid(source, 5 * source, 0.1, np.random.default_rng(0), trials=10)
    np.testing.assert_allclose(found, rigid_fit(source, 5 * source))
    with pytest.raises(ValueError, match='3 matches or more'):
        ransac_rigid(source[:2], source[:2], 0.1, np.random.default_rng(0))
