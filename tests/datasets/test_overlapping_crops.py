"""Two parts of a scan with known correspondences."""

import numpy as np
import pytest

from rm3d_plugin.datasets.transforms import AugmentedView, OverlappingCrops, overlapping_rows

STILL = dict(rot=(0, 1e-9), flip_prob=0.0, scale=(1, 1.0 + 1e-9), jitter=0.0, keep=(1.0, 1.0), channel_jitter=0.0)


def scene(count=400, seed=0):
    rng = np.random.default_rng(seed)
    points = np.c_[rng.uniform(0, 6, (count, 2)), rng.uniform(0, 2, (count, 1)), rng.random((count, 1))]
    return {'points': points.astype(np.float32), 'semantic': np.arange(count), 'rng': np.random.default_rng(seed + 1)}


def test_parts_overlap_as_asked():
    points = scene()['points']
    for seed in range(10):
        first, second = overlapping_rows(points, (0.4, 0.6), 0.5, np.random.default_rng(seed))
        assert 160 <= len(first) <= 240 and 160 <= len(second) <= 240
        assert len(np.intersect1d(first, second)) >= 0.5 * len(second)
    first, second = overlapping_rows(points, (0.1, 0.1), 1.0, np.random.default_rng(0))
    np.testing.assert_array_equal(first, second)  # no draw is contained in another


def test_ids_name_the_same_points():
    made = OverlappingCrops(share=(0.5, 0.6), overlap=0.3, view=STILL)(scene())
    (view,) = made['views']
    shared = view.point_ids >= 0
    assert 0 < shared.sum() < len(shared)
    np.testing.assert_allclose(made['points'][view.point_ids[shared]], view.points[shared], atol=1e-5)
    rows = {tuple(row) for row in made['points'].round(4).tolist()}
    assert not any(tuple(row) in rows for row in view.points[~shared].round(4).tolist())
    assert len(made['semantic']) == len(made['points'])


def test_a_view_of_a_part():
    (view,) = AugmentedView(**STILL | {'crop': (0.25, 0.25)})(scene())['views']
    points = scene()['points']
    np.testing.assert_allclose(points[view.point_ids], view.points, atol=1e-5)
    assert len(view.point_ids) == 100 and (np.diff(view.point_ids) > 0).all()
    inside = np.zeros(400, dtype=bool)
    inside[view.point_ids] = True
    middle = min(points[inside], key=lambda row: np.linalg.norm(points[inside][:, :2] - row[:2], axis=1).max())
    away = np.linalg.norm(points[:, :2] - middle[:2], axis=1)
    assert away[inside].max() < np.quantile(away, 0.35)  # one piece, not points here and there


def test_bad_shares():
    with pytest.raises(ValueError, match='shares in'):
        OverlappingCrops(share=(0.5, 1.2))
    with pytest.raises(ValueError, match='crop'):
        AugmentedView(crop=(0.0, 0.5))
