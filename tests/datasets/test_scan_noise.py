"""Thinned and noisy scans."""

import numpy as np
import pytest

from rm3d_plugin.datasets.transforms import PointNoise, RandomDownsample, noisy_points
from rm3d_plugin.registry import TRANSFORMS


def item(points, seed=0, **more):
    return {'points': points, 'rng': np.random.default_rng(seed), **more}


def numbered(count):
    points = np.arange(5 * count, dtype=np.float32).reshape(count, 5)
    points[:, 3:] = 0.5
    return points


def test_thinning_keeps_points_and_labels_in_step():
    points, shares = numbered(1000), []
    step = TRANSFORMS.build({'type': 'rm3d_plugin.RandomDownsample', 'keep': (0.2, 0.6)})
    for seed in range(40):
        out = step(item(points, seed, semantic=np.arange(1000), point_index=np.arange(1000)))
        rows = out['point_index']
        assert np.array_equal(out['points'], points[rows]) and np.array_equal(out['semantic'], rows)
        assert (np.diff(rows) > 0).all()
        shares.append(len(rows) / 1000)
    assert 0.2 <= min(shares) < 0.25 and 0.55 < max(shares) <= 0.6
    again = step(item(points, 39, semantic=np.arange(1000)))
    assert np.array_equal(again['semantic'], rows)


@pytest.mark.parametrize(('count', 'left'), [(0, 0), (1, 1), (3, 1)])
def test_thinning_leaves_a_point_where_there_is_one(count, left):
    assert len(RandomDownsample((0.1, 0.1))(item(numbered(count)))['points']) == left


def test_noise_has_the_deviation_asked_for():
    points = np.full((20000, 5), 0.5, dtype=np.float32)
    out = noisy_points(points, 0.02, 0.05, np.random.default_rng(1))
    assert out.dtype == np.float32 and np.array_equal(points, np.full((20000, 5), 0.5, dtype=np.float32))
    moved = out - points
    assert np.allclose(moved[:, :3].std(axis=0), 0.02, rtol=0.05) and np.abs(moved[:, :3]).max() <= 0.0601
    assert np.allclose(moved[:, 3:].std(axis=0), 0.05, rtol=0.05)
    shared = moved[:, 3:].mean(axis=0)  # the same for all points: far more than 0.05 / sqrt(20000)
    assert np.abs(shared).max() > 0.005


def test_noise_switched_off_and_columns_within_bounds():
    points = numbered(50)
    rng = np.random.default_rng(0)
    assert np.array_equal(noisy_points(points, 0.0, 0.0, rng), points)
    assert rng.random() == np.random.default_rng(0).random()  # no number was drawn
    wild = noisy_points(points, 0.0, 2.0, rng)
    assert np.array_equal(wild[:, :3], points[:, :3]) and wild[:, 3:].min() == 0.0 and wild[:, 3:].max() == 1.0
    assert PointNoise()(item(np.zeros((0, 3), dtype=np.float32)))['points'].shape == (0, 3)
    assert PointNoise()(item(np.ones((1, 3), dtype=np.float32)))['points'].shape == (1, 3)


def test_bad_settings_are_named():
    for keep in ((0.0, 1.0), (0.6, 0.5), (0.5, 1.1), (0.5,)):
        with pytest.raises(ValueError, match='keep: expected two shares'):
            RandomDownsample(keep)
    for bad in (-1.0, float('nan'), float('inf')):
        with pytest.raises(ValueError, match='deviations from 0'):
            PointNoise(jitter=bad)
        with pytest.raises(ValueError, match='deviations from 0'):
            PointNoise(columns=bad)


@pytest.mark.parametrize(('step', 'message'), [(RandomDownsample(), 'AugmentedView'), (PointNoise(), 'AugmentedView')])
def test_views_come_later(step, message):
    with pytest.raises(ValueError, match=message):
        step(item(numbered(3), views=[]))
