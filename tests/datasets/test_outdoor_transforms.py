"""Transforms of streets: heights from the ground, crops by class, shape columns, and what is remembered."""

import pickle

import numpy as np
import pytest

from rm3d_plugin.datasets.transforms import (
    ClassCrop,
    ClearanceFeatures,
    HeightAboveGround,
    ShapeFeatures,
    class_center,
    clearance_columns,
    shape_columns,
)
from rm3d_plugin.datasets.transforms.recent import RecentArrays
from rm3d_plugin.ops.clearance import clearance
from rm3d_plugin.ops.geometric_features import geometric_features


def slope_with_pole(rng):
    """A street that climbs 10 %, and a pole of 3 m on it."""
    xy = rng.uniform(-15, 15, (4000, 2))
    street = np.column_stack([xy, 0.1 * xy[:, 0]])
    pole = np.column_stack([np.full((60, 2), 4.0), 0.4 + np.linspace(0.3, 3.0, 60)])
    return np.concatenate([street, pole]).astype(np.float32)


def item(points, seed=0, **more):
    return {'points': points, 'rng': np.random.default_rng(seed), **more}


def test_heights_are_above_the_ground_and_poles_stay_upright():
    points = np.column_stack([slope_with_pole(np.random.default_rng(0)), np.ones(4060, dtype=np.float32)])
    before = points.copy()
    level = HeightAboveGround()(item(points))['points']
    assert np.array_equal(points, before)
    assert np.abs(level[:4000, 2]).max() < 0.1
    assert np.allclose(level[4000:, 2], np.linspace(0.3, 3.0, 60), atol=0.1)
    assert np.array_equal(level[:, [0, 1, 3]], points[:, [0, 1, 3]])
    assert level.dtype == np.float32


@pytest.mark.parametrize('step', [HeightAboveGround(), ShapeFeatures(), ClearanceFeatures()])
def test_views_come_later(step):
    with pytest.raises(ValueError, match='AugmentedView behind it'):
        step(item(np.zeros((5, 3), dtype=np.float32), views=[]))


def test_boxes_do_not_fit_a_levelled_scene():
    with pytest.raises(ValueError, match='without boxes'):
        HeightAboveGround()(item(np.zeros((5, 3), dtype=np.float32), boxes=np.zeros((1, 7))))


def test_shape_columns_are_the_two_looks_side_by_side(tmp_path):
    xyz = slope_with_pole(np.random.default_rng(1))
    points = np.column_stack([xyz, np.full(len(xyz), 0.5, dtype=np.float32)])
    expected = np.concatenate([geometric_features(xyz, k).values for k in (8, 20)], axis=1)
    for cache in (None, tmp_path, tmp_path):  # made, stored, read
        out = ShapeFeatures((8, 20), cache)(item(points))['points']
        assert out.shape == (4060, 12) and out.dtype == np.float32
        assert np.array_equal(out[:, :4], points) and np.array_equal(out[:, 4:], expected)
    pole, street = expected[4020:4040], expected[:4000]
    assert pole[:, 0].mean() > 0.9 and np.median(street[:, 1]) > 0.5  # linear, planar
    assert len(list(tmp_path.glob('*.npz'))) == 1


def test_shape_columns_of_few_points():
    assert shape_columns(np.zeros((0, 3), dtype=np.float32)).shape == (0, 8)
    assert not shape_columns(np.ones((1, 3), dtype=np.float32)).any()
    with pytest.raises(ValueError, match='two numbers'):
        ShapeFeatures((8,))


def test_clearance_columns_are_a_narrow_and_a_wide_look():
    xyz = slope_with_pole(np.random.default_rng(1))
    points = np.column_stack([xyz, np.full(len(xyz), 0.5, dtype=np.float32)])
    out = ClearanceFeatures(0.4)(item(points))['points']
    assert out.shape == (4060, 16) and out.dtype == np.float32
    assert np.array_equal(out[:, :4], points)
    assert np.array_equal(out[:, 4:], np.concatenate([clearance(xyz, 0.4), clearance(xyz, 0.4, 1)], axis=1))
    assert clearance_columns(np.zeros((0, 3), dtype=np.float32)).shape == (0, 12)
    with pytest.raises(ValueError, match='cell: expected metres > 0, got 0'):
        ClearanceFeatures(0)


def test_each_class_is_as_likely():
    semantic = np.array([0] * 900 + [3] * 10 + [-1] * 90)
    rng = np.random.default_rng(0)
    drawn = semantic[[class_center(semantic, rng) for _ in range(400)]]
    assert set(drawn) == {0, 3} and 150 < (drawn == 3).sum() < 250
    free = semantic[[class_center(semantic, rng, classes=0.0) for _ in range(400)]]
    assert (free == 3).sum() < 15 and (free == -1).sum() > 15
    assert 0 <= class_center(np.full(5, -1), rng) < 5


def test_a_crop_is_an_upright_column_around_a_rare_class():
    xyz = slope_with_pole(np.random.default_rng(2))
    semantic = np.r_[np.zeros(4000, dtype=np.int64), np.ones(60, dtype=np.int64)]
    made = ClassCrop(500, classes=1.0)(
        item(xyz, seed=3, semantic=np.where(semantic == 1, 1, -1), is_annotated=semantic == 1)
    )
    assert len(made['points']) == len(made['semantic']) == len(made['is_annotated']) == 500
    assert (made['semantic'] == 1).sum() == 60  # the whole pole, from its foot to its top
    assert np.linalg.norm(made['points'][:, :2] - 4.0, axis=1).max() < 6.5
    whole = item(xyz[:100], semantic=semantic[:100])
    assert ClassCrop(100)(whole) is whole
    assert len(ClassCrop(50)(item(xyz[:100]))['points']) == 50  # a scan without labels is cropped anywhere


@pytest.mark.parametrize(
    'wrong', [{'max_points': 0}, {'max_points': 5, 'classes': 2}, {'max_points': 5, 'shape': 'ball'}]
)
def test_wrong_crops_are_told(wrong):
    with pytest.raises(ValueError, match='ClassCrop'):
        ClassCrop(**wrong)


def test_pipelines_that_compute_the_same_share_a_memory():
    one, two = RecentArrays.shared('heights of a test', 1), RecentArrays.shared('heights of a test', 3)
    assert one is two and one.size == 3 and RecentArrays.shared('others of a test', 3) is not one
    content = np.arange(3.0)
    made = one.get_or_make(content, lambda: np.ones(1))
    assert two.get_or_make(content, lambda: np.zeros(1)) is made
    assert HeightAboveGround(recent=2)._recent is HeightAboveGround(recent=1)._recent
    assert HeightAboveGround()._recent is not HeightAboveGround(cell=3.0)._recent


def test_the_recent_ones_are_remembered():
    recent, made = RecentArrays(2), []

    def get(number):
        def make():
            made.append(number)
            return np.array([number])

        return int(recent.get_or_make(np.array([number]), make)[0])

    assert [get(n) for n in (1, 2, 1, 3, 1, 2)] == [1, 2, 1, 3, 1, 2]
    assert made == [1, 2, 3, 2] and len(recent) == 2
    assert len(pickle.loads(pickle.dumps(recent))) == 0
    with pytest.raises(ValueError, match='size'):
        RecentArrays(0)
