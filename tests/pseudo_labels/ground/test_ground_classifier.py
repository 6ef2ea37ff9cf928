"""Looks of level ground against sums over all neighbours, and streets whose ground few clicks name."""

from dataclasses import replace

import numpy as np
import pytest
from pseudo_labels import refreshing
from pseudo_labels.patches import make_patches

from rm3d_plugin.pseudo_labels import GroundRules, SegmentationRules
from rm3d_plugin.pseudo_labels.common.distance_prior import DECAY
from rm3d_plugin.pseudo_labels.common.sensor import IntensityByRange, range_normalised_intensity
from rm3d_plugin.pseudo_labels.ground import classifier as level_ground
from rm3d_plugin.pseudo_labels.ground.classifier import ALONG, PLANE_STEP, learn_ground
from rm3d_plugin.pseudo_labels.ground.features import CELL, SCALES, SIDES, ground_features
from rm3d_plugin.pseudo_labels.ground.labels import FAR, GroundLabels
from rm3d_plugin.regions import MergeRules
from rm3d_plugin.structures import PointCloud

ROAD, PAVEMENT, GRASS, POLE = range(4)
USUAL = IntensityByRange(np.array([5.0, 15.0]), np.array([0.4, 0.2]))
FIRST_SIDE = 3 + 3 * len(SCALES) + 3 + 1


def street(seed, points=3000, intensity=True, slope=0.03):
    """A road between kerbs, grass behind and a pole: brightness tells grass, height the pavement, both noisily."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform([-20, -12], [20, 12], (points, 2))
    kind = np.digitize(np.abs(xy[:, 1]), [4.0, 7.0])
    z = np.array([0.0, 0.12, 0.14])[kind] + rng.normal(0, np.array([0.01, 0.01, 0.05])[kind]) + slope * xy[:, 0] - 1.7
    ranges = np.linalg.norm(np.c_[xy, z], axis=1)
    bright = np.array([0.3, 0.36, 0.42])[kind] * (1 + 0.1 * rng.normal(size=points)) / (1 + ranges / 30)
    pole = np.c_[np.full(20, 5.0), np.full(20, 5.0), np.linspace(-1.4, 2, 20)]
    xyz, kind = np.concatenate([np.c_[xy, z], pole]), np.r_[kind, np.full(20, POLE)]
    bright = np.r_[bright, np.full(20, 0.3)]
    cloud = PointCloud(xyz.astype(np.float32), intensity=bright if intensity else None, sensor=(0.0, 0.0, 0.0))
    return cloud, kind != POLE, kind


def clicked(truth, rng, each=3):
    out = np.full(len(truth), -1)
    for c in np.unique(truth):
        rows = rng.choice(np.flatnonzero(truth == c), each, replace=False)
        out[rows] = c
    return out


def streets(count=16, **options):
    rng = np.random.default_rng(5)
    made = [street(seed, **options) for seed in range(count)]
    return [(cloud, level, clicked(truth, rng), truth) for cloud, level, truth in made]


def neighbours_slowly(xy, values, at, scale):
    """Sums of a truncated, normalised Gaussian over the cells of the grid."""
    low = xy.min(axis=0) - 1.0
    cells = ((xy - low) / CELL).astype(int)
    own = ((at - low) / CELL).astype(int)
    reach = int(2.5 * scale / CELL + 0.5)
    steps = np.arange(-reach, reach + 1)
    weights = np.exp(-((steps * CELL) ** 2) / (2 * scale**2))
    weights /= weights.sum()
    gap = cells - own
    near = (np.abs(gap) <= reach).all(axis=1)
    return (weights[gap[near, 0] + reach] * weights[gap[near, 1] + reach] * values[near]).sum()


@pytest.mark.parametrize('heading', [True, False])
def test_columns_as_by_hand(heading):
    cloud, level, _ = street(0, points=600, slope=0.0)
    rows, heights = ground_features(cloud, level, USUAL, heading)
    xyz = cloud.xyz[level].astype(float)
    assert rows.shape == (600, FIRST_SIDE + 4 * len(SIDES)) and np.isfinite(rows).all()
    ranges = np.linalg.norm(xyz, axis=1)
    bright = cloud.intensity[level] / np.interp(ranges, [5.0, 15.0], [0.4, 0.2]) - 1
    aside = np.abs(xyz[:, 1]) if heading else np.linalg.norm(xyz[:, :2], axis=1)
    np.testing.assert_allclose(rows[:, :3], np.c_[bright, np.log(ranges), np.minimum(aside, 30)], atol=1e-5)
    z = heights[level]
    column = 3
    for scale in SCALES:
        for i in (0, 77, 599):
            mass, one, high, squares, squared = (
                neighbours_slowly(xyz[:, :2], values, xyz[i, :2], scale)
                for values in (np.ones(600), bright, z, bright**2, z**2)
            )
            found = [one / mass, np.sqrt(max(squares / mass - (one / mass) ** 2, 0)), z[i] - high / mass]
            if scale in (0.5, 1.0, 2.0):
                found.append(min(np.sqrt(max(squared / mass - (high / mass) ** 2, 0)), 0.3))
            if scale == 0.5:
                found.append(np.log(mass + 1e-3))
            np.testing.assert_allclose(rows[i, column : column + len(found)], found, atol=2e-4)
        column += len(found)
    assert column == FIRST_SIDE


def test_the_sides_tell_on_which_side_of_a_kerb_a_point_lies():
    rng = np.random.default_rng(0)
    xy = rng.uniform([-10, -6], [10, 6], (20000, 2))
    z = np.where(np.abs(xy[:, 1]) > 4, 0.2, 0.0)  # kerbs 4 m to both sides
    cloud = PointCloud(np.c_[xy, z - 1.7].astype(np.float32), sensor=(0.0, 0.0, 0.0))
    rows, _ = ground_features(cloud, np.ones(20000, dtype=bool), USUAL, True)
    out, back = rows[:, FIRST_SIDE + 4 * 2], rows[:, FIRST_SIDE + 4 * 2 + 2]  # 2.5 m outward and back: heights
    by_the_kerb = (np.abs(xy[:, 1]) > 2.5) & (np.abs(xy[:, 1]) < 3)
    behind = (np.abs(xy[:, 1]) > 4.8) & (np.abs(xy[:, 1]) < 5.2)
    middle = np.abs(xy[:, 1]) < 0.5
    assert out[by_the_kerb] == pytest.approx(0.2, abs=0.02) and back[by_the_kerb] == pytest.approx(0.0, abs=0.02)
    assert back[behind] == pytest.approx(-0.2, abs=0.03)
    assert out[middle] == pytest.approx(0.0, abs=0.01) and back[middle] == pytest.approx(0.0, abs=0.01)


def test_heights_are_those_above_the_plane_of_most_points():
    cloud, level, _ = street(1, slope=0.1)
    heights = ground_features(cloud, level, USUAL, True).heights
    middle = np.abs(cloud.xyz[:, 1]) < 3
    tilt = np.polyfit(cloud.xyz[middle & level, 0], heights[middle & level], 1)[0]
    assert abs(tilt) < 0.005 and heights[~level].max() == pytest.approx(3.7 - 0.5, abs=0.15)


def test_range_normalised_intensity_by_range():
    cloud = PointCloud(
        np.c_[np.repeat([3.5, 12.5], 60), np.zeros((120, 2))].astype(np.float32),
        intensity=np.r_[np.full(60, 0.5), np.tile([0.1, 0.3], 30)],
        sensor=(0.0, 0.0, 0.0),
    )
    found = range_normalised_intensity([(cloud, np.ones(120, dtype=bool))] * 2)
    assert found.ranges.tolist() == [3.5, 12.5] and found.strengths == pytest.approx([0.5, 0.2])
    away = replace(cloud, sensor=(1.0, 0.0, 0.0))
    assert range_normalised_intensity([(away, np.ones(120, dtype=bool))]).ranges.tolist() == [2.5, 11.5]
    few = cloud.select(np.arange(40))
    assert len(range_normalised_intensity([(few, np.ones(40, dtype=bool))]).ranges) == 0
    assert len(range_normalised_intensity([(replace(cloud, intensity=None), np.ones(120, dtype=bool))]).ranges) == 0


@pytest.mark.parametrize(
    ('intensity', 'heading', 'least'), [(True, True, 0.9), (False, True, 0.85), (True, False, 0.75)]
)
def test_few_points_of_all_streets_name_the_ground_of_each(intensity, heading, least):
    made = streets(intensity=intensity)
    known = learn_ground(lambda: [scene[:3] for scene in made], heading)
    right = []
    for cloud, level, annotated, truth in made[:4]:
        found = known.labels(cloud, level, annotated, 4)
        assert (found.classes[~level] == -1).all() and (found.confidence[~level] == 0).all()
        right.append((found.classes == truth)[level].mean())
    assert np.mean(right) > least
    assert known.classes.classes.tolist() == [ROAD, PAVEMENT, GRASS]  # no pole is level


def test_places_count_as_by_hand():
    made = streets(12)
    known = learn_ground(lambda: [scene[:3] for scene in made], True)
    cloud, level, annotated, _ = made[3]
    annotated = np.where(annotated == GRASS, -1, annotated)  # nobody clicked grass in this scan
    found = known.labels(cloud, level, annotated, 4)
    features = ground_features(cloud, level, known.usual, True)
    said = known.classes.shares(features.rows, 4)
    said[:, :3] *= known.frequencies
    assert known.frequencies == pytest.approx([1 / 3, 1 / 4, 5 / 12], abs=0.04)  # of 24 m across
    where = np.c_[cloud.xyz[:, 0] * ALONG, cloud.xyz[:, 1], features.heights / PLANE_STEP]
    for i, row in list(enumerate(np.flatnonzero(level)))[::50]:
        worth = np.zeros(4)
        for c in (ROAD, PAVEMENT, POLE):
            gap = min(np.linalg.norm(where[row] - where[j]) for j in np.flatnonzero(annotated == c))
            worth[c] = said[i, c] * (1 + min(gap, FAR)) ** -DECAY
        assert found.classes[row] == worth.argmax()
        assert found.confidence[row] == pytest.approx(worth.max() / worth.sum(), rel=1e-4)
    nobody = known.labels(cloud, level, np.full(len(level), -1), 4)
    assert (nobody.classes == -1).all() and (nobody.confidence == 0).all()
    none = known.labels(cloud, np.zeros(len(level), dtype=bool), annotated, 4)
    assert (none.classes == -1).all()


def test_too_few_points_teach_nothing_and_too_many_are_thinned(monkeypatch):
    made = [scene[:3] for scene in streets(4)]
    assert learn_ground(lambda: made, True) is None  # 4 streets, 9 level points of each
    assert learn_ground(list, True) is None
    monkeypatch.setattr(level_ground, 'LEAST_EXAMPLES', 20)
    monkeypatch.setattr(level_ground, 'MOST_EXAMPLES', 5)
    assert len(learn_ground(lambda: made, True).classes.rows) == 3 * 5
    monkeypatch.setattr(level_ground, 'MOST_GATHERED', 31)
    assert len(learn_ground(lambda: made, True).classes.rows) == 3 * 5


def test_what_the_ground_is_overrules_regions_but_no_annotated_point():
    patches = make_patches(1, share=0.05)
    patches.graph.normals[::2] = [1.0, 0, 0]  # every second patch stands upright
    level = np.array(patches.regions.labels) % 2 == 1
    rules = SegmentationRules(MergeRules(gamma=0.6, rounds=4), ground=GroundRules(min_upright=0.9))
    told = GroundLabels(np.where(level, 2, -1), np.where(level, 0.7, 0.0))
    scene = refreshing.inputs(patches)
    labels = [refreshing.points(scene, rules, 0, patches.counts, (0,), ground=ground).labels for ground in (told, None)]
    known = patches.annotated.semantic >= 0
    assert (labels[0].semantic[level & ~known] == 2).all() and labels[0].confidence[level & ~known] == pytest.approx(
        0.7
    )
    assert (labels[0].semantic[known] == patches.annotated.semantic[known]).all()
    assert (labels[0].semantic[~level] == labels[1].semantic[~level]).all()
