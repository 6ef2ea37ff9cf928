"""Columns that tell where in its scene a point lies."""

import numpy as np
import pytest

from rm3d_plugin.datasets.transforms import SinusoidalPosition, place_columns


def test_values_of_the_middle_and_of_a_quarter_wave():
    xyz = np.array([[10.0, 5, 0], [20, 5, 3], [0, 5, 1]], dtype=np.float32)  # median (10, 5)
    got = place_columns(xyz, (40.0, 20.0))
    assert got.shape == (3, 8) and got.dtype == np.float32
    np.testing.assert_allclose(got[0], [0.5] * 4 + [1.0] * 4, atol=1e-6)  # sines, then cosines, of x, y, x, y
    np.testing.assert_allclose(got[1], [1, 0.5, 0.5, 0.5, 0.5, 1, 0, 1], atol=1e-6)  # a quarter of 40 m, half of 20 m
    np.testing.assert_allclose(got[2, 0], 0.0, atol=1e-6)


def test_near_points_are_alike_far_ones_are_not():
    xyz = np.array([[0.0, 0, 0], [0.5, 0, 9], [30, 0, 0], [-30, 0, 0], [0, 50, 0]])
    got = place_columns(xyz)
    apart = np.linalg.norm(got - got[0], axis=1)
    assert apart[1] < 0.1 and (apart[2:] > 0.5).all()


def test_columns_stand_behind_those_there_are_and_stay_through_crops():
    rng = np.random.default_rng(0)
    points = rng.uniform(-50, 50, (200, 5)).astype(np.float32)
    step = SinusoidalPosition()
    out = step({'points': points, 'scene_id': 'a'})
    np.testing.assert_array_equal(out['points'][:, :5], points)
    np.testing.assert_array_equal(out['points'][:, 5:], place_columns(points[:, :3]))
    assert out['scene_id'] == 'a' and ((out['points'][:, 5:] >= 0) & (out['points'][:, 5:] <= 1)).all()


def test_an_empty_scene_and_what_cannot_be():
    assert SinusoidalPosition()({'points': np.zeros((0, 3), dtype=np.float32)})['points'].shape == (0, 11)
    with pytest.raises(ValueError, match='two lengths > 0'):
        SinusoidalPosition(wavelengths=[10.0])
    with pytest.raises(ValueError, match='AugmentedView behind it'):
        SinusoidalPosition()({'points': np.zeros((1, 3)), 'views': []})
