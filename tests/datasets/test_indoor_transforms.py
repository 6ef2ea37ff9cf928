"""Indoor transforms keep points and labels in step, in order, and draw from the item's generator alone."""

import numpy as np
import pytest

from rm3d_plugin.datasets.transforms import (
    AugmentedView,
    ColorAutoContrast,
    ColorDrop,
    ColorJitter,
    ElasticDistortion,
    RandomCrop,
    ViewSettings,
    augmented_view,
    auto_contrast,
    crop_rows,
    elastic,
)
from rm3d_plugin.datasets.transforms.augmented_view import rgb_columns


def item(n=300, columns=6, seed=0, **more):
    rng = np.random.default_rng(seed)
    points = np.c_[rng.uniform(0, 5, (n, 3)), rng.uniform(0.2, 0.7, (n, columns - 3))].astype(np.float32)
    return {
        'points': points,
        'point_index': np.arange(n),
        'semantic': np.arange(n) % 4 - 1,
        'instance': np.arange(n) % 7,
        'is_annotated': np.arange(n) % 2 == 0,
        'rng': np.random.default_rng(seed + 1),
    } | more


ALL = [
    RandomCrop(100),
    RandomCrop(100, 'column'),
    RandomCrop(100, 'box', labelled=1.0),
    ElasticDistortion(prob=1.0),
    ColorAutoContrast(1.0),
    ColorJitter(prob=1.0),
    ColorDrop(1.0),
]


# ---------------------------------------------------------------------- all of them


@pytest.mark.parametrize('step', ALL, ids=lambda step: type(step).__name__)
@pytest.mark.parametrize('columns', [3, 4, 6, 7])
@pytest.mark.parametrize('n', [0, 1, 2, 300])
def test_rows_stay_aligned_and_ordered(step, columns, n):
    made = item(n, columns)
    before = made['points'].copy()
    out = step(made)
    index = out['point_index']
    assert (np.diff(index) > 0).all() and len(index) == (min(n, 100) if type(step) is RandomCrop else n)
    assert (out['semantic'] == index % 4 - 1).all() and (out['instance'] == index % 7).all()
    assert (out['is_annotated'] == (index % 2 == 0)).all()
    assert out['points'].dtype == np.float32 and out['points'].shape == (len(index), columns)
    assert np.isfinite(out['points']).all()
    assert np.array_equal(made['points'], before)  # the scene that came in stays as it is
    changed = rgb_columns(out['points']) if type(step).__name__.startswith('Color') else None
    same = [c for c in range(columns) if changed is None or c not in range(changed.start, changed.stop)]
    if type(step) is ElasticDistortion:
        same = list(range(3, columns))
    assert np.array_equal(out['points'][:, same], before[index][:, same])


@pytest.mark.parametrize('step', ALL, ids=lambda step: type(step).__name__)
def test_the_same_generator_gives_the_same_bits(step):
    assert step(item())['points'].tobytes() == step(item())['points'].tobytes()


# ---------------------------------------------------------------------- crops


def test_crop_shapes_by_hand():
    xyz = np.array([[0.0, 0, 0], [0, 0, 5], [0.5, 0.5, 0], [0.6, 0, 0], [0.6, 0, 0]])
    center = np.zeros(3)
    assert crop_rows(xyz, center, 3, 'sphere').tolist() == [0, 3, 4]
    assert crop_rows(xyz, center, 3, 'column').tolist() == [0, 1, 3]  # seen from above; .6 < .707; ties by row
    assert crop_rows(xyz, center, 3, 'box').tolist() == [0, 1, 2]  # .5 < .6 along the axes
    assert crop_rows(xyz, center, 9, 'box').tolist() == [0, 1, 2, 3, 4]


def test_a_crop_lies_around_a_labelled_point():
    semantic = np.full(300, -1)
    semantic[17] = 2
    for seed in range(5):
        out = RandomCrop(20, labelled=1.0)(item(semantic=semantic, rng=np.random.default_rng(seed)))
        assert 17 in out['point_index']
    anywhere = RandomCrop(20, labelled=0.0)
    crops = [anywhere(item(semantic=semantic, rng=np.random.default_rng(seed))) for seed in range(20)]
    assert not all(17 in crop['point_index'] for crop in crops)
    assert len(RandomCrop(20, labelled=1.0)(item(semantic=np.full(300, -1)))['points']) == 20
    assert RandomCrop(300)(small := item()) is small


def test_a_crop_after_the_second_view_is_refused():
    with pytest.raises(ValueError, match='AugmentedView'):
        RandomCrop(10)(AugmentedView()(item()))


# ---------------------------------------------------------------------- shapes


def test_elastic_shifts_are_bounded_and_smooth():
    made = item(2000)
    out = elastic(made['points'], ((0.5, 0.1), (2.0, 0.3)), np.random.default_rng(0))
    shift = out[:, :3] - made['points'][:, :3]
    assert 0.1 < np.abs(shift).max() <= 0.4 + 1e-6
    twin = np.repeat(made['points'][:1], 3, axis=0)
    assert np.ptp(elastic(np.r_[made['points'], twin], ((0.5, 0.1),), np.random.default_rng(0))[-3:], axis=0).max() == 0


def test_boxes_are_not_warped():
    with pytest.raises(ValueError, match='without boxes'):
        ElasticDistortion()(item(boxes=np.ones((1, 7))))
    assert len(ElasticDistortion()(item(boxes=np.zeros((0, 7))))['points']) == 300
    assert ElasticDistortion(prob=0.0)(made := item()) is made


# ---------------------------------------------------------------------- colours


def test_auto_contrast_by_hand():
    colors = np.array([[0.2, 0.5, 0.0], [0.4, 0.5, 0.5], [0.6, 0.5, 1.0]])
    full = auto_contrast(colors, 1.0, 0.0, 1.0)
    assert full == pytest.approx(np.array([[0.0, 0.5, 0], [0.5, 0.5, 0.5], [1.0, 0.5, 1]]))  # a flat channel stays
    assert auto_contrast(colors, 0.5, 0.0, 1.0) == pytest.approx((colors + full) / 2)
    assert auto_contrast(colors, 0.0) == pytest.approx(colors)
    assert auto_contrast(colors[:0], 1.0).shape == (0, 3)


def test_colours_change_as_told_and_stay_in_range():
    made = item(5000, 7)
    grey = ColorDrop(1.0)(made)['points']
    assert (grey[:, 4:] == 0.5).all() and np.array_equal(grey[:, :4], made['points'][:, :4])
    shifted = ColorJitter(shift=0.1, noise=0.0, prob=1.0)(made)['points'][:, 4:] - made['points'][:, 4:]
    assert np.ptp(shifted, axis=0).max() < 1e-6 and 0 < np.abs(shifted).max() <= 0.1
    noisy = ColorJitter(shift=0.0, noise=0.05, prob=1.0)(made)['points'][:, 4:] - made['points'][:, 4:]
    assert noisy.std() == pytest.approx(0.05, rel=0.05)
    wild = ColorJitter(shift=1.0, noise=1.0, prob=1.0)(made)['points'][:, 4:]
    assert wild.min() == 0.0 and wild.max() == 1.0


def test_bad_settings_are_told():
    with pytest.raises(ValueError, match='RandomCrop'):
        RandomCrop(0)
    with pytest.raises(ValueError, match='ElasticDistortion'):
        ElasticDistortion(((0.2, 0.0),))
    with pytest.raises(ValueError, match='ColorDrop'):
        ColorDrop(2.0)
    with pytest.raises(ValueError, match='ColorJitter'):
        ColorJitter(shift=2.0)


# ---------------------------------------------------------------------- what the second view gained


def test_a_view_may_have_several_waves():
    points = item(500)['points']
    still = dict(rot=(0.0, 0.0), flip_prob=0.0, scale=(1.0, 1.0), jitter=0.0, keep=(1.0, 1.0), channel_jitter=0.0)
    view = augmented_view(points, ViewSettings(**still, elastic=((0.5, 0.1), (2.0, 0.3))), np.random.default_rng(0))
    shift = np.abs(view.points[:, :3] - points[:, :3])
    assert 0.1 < shift.max() <= 0.4 + 1e-5 and np.array_equal(view.points[:, 3:], points[:, 3:])
    assert ViewSettings(elastic=[0.3, 0.1]).waves == ([0.3, 0.1],)  # as a config gives it
    assert ViewSettings(elastic=[[0.3, 0.1], [1.0, 0.2]]).waves == ([0.3, 0.1], [1.0, 0.2])
    assert ViewSettings().waves == ()
    with pytest.raises(ValueError, match='elastic'):
        ViewSettings(elastic=((0.3, 0.1), (0.0, 1.0)))


def test_a_view_may_have_noisy_or_no_colours():
    points = item(4000, 7)['points']
    still = dict(keep=(1.0, 1.0), channel_jitter=0.0)
    noisy = augmented_view(points, ViewSettings(**still, channel_noise=0.05), np.random.default_rng(0)).points
    assert (noisy[:, 3:] - points[:, 3:]).std() == pytest.approx(0.05, rel=0.05)
    grey = augmented_view(points, ViewSettings(**still, color_drop=1.0), np.random.default_rng(0)).points
    assert (grey[:, 4:] == 0.5).all() and np.array_equal(grey[:, 3], points[:, 3])
    with pytest.raises(ValueError, match='share'):
        ViewSettings(color_drop=1.5)


def test_what_is_switched_off_draws_no_numbers():
    """A view with the new settings off uses the generator as before them, so detection keeps its bits."""
    first, second = np.random.default_rng(0), np.random.default_rng(0)
    points = item(50, 4)['points']
    augmented_view(points, ViewSettings(), first)
    kept = round(second.uniform(0.5, 0.8) * 50)
    second.choice(50, size=kept, replace=False)
    second.uniform(), second.random(2), second.uniform(), second.standard_normal((kept, 3)), second.normal(size=(2, 1))
    assert first.random() == second.random()
