"""Scenes that cannot be described: masked, counted and told, whatever the descriptor and the over-segmenter."""

import warnings

import numpy as np
import pytest

from rm3d_plugin.descriptors import AdaptedPFH
from rm3d_plugin.oversegmentation import VCCS as Supervoxels
from rm3d_plugin.oversegmentation import CutPursuit, Precomputed, RegionGrowing
from rm3d_plugin.regions.prepare import PreparedScene, prepare_scene
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import PointCloud, SceneError

TYPES = ['AdaptedPFH', 'PFH', 'FPFH', 'SHOT', 'HKS', 'WKS', 'SIHKS', 'VisualSimilarity', 'VCCS', 'SuperpointGraph']


def clouds() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    wide = rng.uniform(0, 1e6, (150, 3))
    return {
        'empty': np.zeros((0, 3)),
        'one point': np.ones((1, 3)),
        'two points': np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0]]),
        'all equal': np.full((100, 3), 3.0),
        'far apart': np.arange(9.0).reshape(3, 3) ** 3,
        'a line': np.c_[np.linspace(0, 2, 200), np.zeros((200, 2))],
        'in threes': np.repeat(rng.uniform(0, 1, (60, 3)), 3, axis=0),
        'a million metres wide': wide,
        'a clump and strays': np.concatenate([wide[:40], rng.uniform(0, 0.5, (200, 3))]),
    }


CLOUDS = clouds()
NOTHING = ['empty', 'one point', 'two points', 'all equal']  # no neighbourhood has three points in two places


def solver(strength, dimension, values, weights, first, second, *_):
    """Stands in for the optional package: every point is a part of its own."""
    return np.arange(len(values))


def segmenters(points: int):
    return {
        'grown': RegionGrowing(),
        'grown over ground': RegionGrowing(ground={}),
        'supervoxels': Supervoxels(),
        'supervoxels by normals': Supervoxels(distance='pcl'),
        'cut pursuit': CutPursuit(),
        'precomputed': Precomputed(np.zeros(points, dtype=np.int64)),
    }


def cloud_of(name: str, colors: bool = False) -> PointCloud:
    xyz = CLOUDS[name]
    return PointCloud(xyz, colors=np.full((len(xyz), 3), 0.5) if colors else None)


@pytest.mark.parametrize('kind', TYPES)
@pytest.mark.parametrize('name', CLOUDS)
def test_what_cannot_be_described_is_masked(kind, name):
    for colors in (False, True):
        found = DESCRIPTORS.build({'type': kind}).compute(cloud_of(name, colors))
        assert len(found) == len(CLOUDS[name])
        assert np.isfinite(found.values).all()
        assert not found.values[~found.valid].any()
        if name in NOTHING:
            assert not found.valid.any()


@pytest.mark.parametrize('kind', TYPES)
def test_strays_change_nothing_for_the_others(kind):
    """A bowl beside points a million metres off has the rows it has alone."""
    rng = np.random.default_rng(1)
    sides = rng.uniform(0.01, 1, (1500, 2))
    clump = np.c_[sides, 0.3 * (sides**2).sum(axis=1)]
    strays = rng.uniform(1e3, 1e6, (40, 3))
    descriptor = DESCRIPTORS.build({'type': kind})
    viewpoint = (0.0, 0.0, 5.0)
    alone = descriptor.compute(PointCloud(clump, sensor=viewpoint))
    found = descriptor.compute(PointCloud(np.concatenate([clump, strays]), sensor=viewpoint))
    np.testing.assert_array_equal(found.valid[: len(clump)], alone.valid)
    assert alone.valid.mean() > 0.5
    np.testing.assert_allclose(found.values[: len(clump)], alone.values, atol=1e-5)


@pytest.mark.parametrize('which', segmenters(0))
@pytest.mark.parametrize('name', CLOUDS)
def test_every_oversegmenter_prepares_every_scene(which, name, monkeypatch):
    monkeypatch.setattr('rm3d_plugin.oversegmentation.cut_pursuit.load_solver', lambda: solver)
    cloud = cloud_of(name)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter('always')
        scene = prepare_scene(cloud, AdaptedPFH(), segmenters(len(cloud))[which], max_gap=0.5, name='scene0707_00')
    labels = scene.regions.labels
    assert labels.shape == (len(cloud),) and labels.min(initial=-1) >= -1
    assert which == 'grown over ground' or (labels >= 0).all()
    for values in PreparedScene.from_arrays(scene.to_arrays()).to_arrays().values():
        assert np.isfinite(values).all()
    assert len(told) > 0 or name in ('a line', 'a clump and strays')
    assert all('scene0707_00' in str(one.message) or 'segment_ground' in str(one.message) for one in told)


@pytest.mark.parametrize('kind', TYPES)
def test_the_warning_names_scene_count_and_descriptor(kind):
    descriptor, cloud = DESCRIPTORS.build({'type': kind}), cloud_of('all equal')
    with pytest.warns(UserWarning, match=f'scene0707_00: 100 of 100 points cannot be described by {kind} '):
        scene = prepare_scene(cloud, descriptor, RegionGrowing(), name='scene0707_00')
    assert len(scene.regions) == 1
    with pytest.warns(UserWarning, match='scene0000_00: the scene has no points'):
        assert len(prepare_scene(cloud_of('empty'), descriptor, RegionGrowing(), name='scene0000_00').regions) == 0


def test_a_scene_that_is_all_ground_is_told():
    floor = PointCloud(np.c_[np.random.default_rng(0).uniform(0, 5, (300, 2)), np.zeros(300)])
    with pytest.warns(UserWarning, match='floor: all 300 points are ground'):
        assert not prepare_scene(floor, AdaptedPFH(), RegionGrowing(ground={}), name='floor').regions.labels.max() >= 0


def test_few_points_that_are_not_described_are_not_worth_a_warning():
    rng = np.random.default_rng(0)
    xyz = np.concatenate([np.c_[rng.uniform(0, 0.5, (400, 2)), np.zeros(400)], [[9.0, 9.0, 9.0]]])
    scene = prepare_scene(PointCloud(xyz), AdaptedPFH(), RegionGrowing())
    assert len(scene.regions.labels) == 401


@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf])
def test_coordinates_that_are_not_finite_are_counted_and_refused(bad):
    xyz = np.zeros((5, 3))
    xyz[1, 2] = xyz[4, 0] = bad
    with pytest.raises(SceneError, match='2 of 5 points are NaN or infinite'):
        PointCloud(xyz)


@pytest.mark.parametrize('bad', [np.nan, np.inf])
@pytest.mark.parametrize('channel', ['colors', 'intensity', 'normals', 'curvature'])
def test_channels_that_are_not_finite_count_as_unknown(channel, bad):
    xyz = np.c_[np.random.default_rng(0).uniform(0, 0.5, (300, 2)), np.zeros(300)]
    given = {
        'colors': np.full((300, 3), 0.5),
        'intensity': np.full(300, 0.5),
        'normals': np.tile([0.0, 0.0, 1.0], (300, 1)),
        'curvature': np.zeros(300),
    }
    zeroed = {name: values.copy() for name, values in given.items()}
    given[channel][[3, 7]] = bad
    zeroed[channel][[3, 7]] = 0
    with pytest.warns(UserWarning, match=f'room: {channel} of 2 of 300 points are NaN or infinite and count as 0'):
        scene = prepare_scene(PointCloud(xyz, **given), AdaptedPFH(), RegionGrowing(), name='room')
    want = prepare_scene(PointCloud(xyz, **zeroed), AdaptedPFH(), RegionGrowing())
    for name, values in want.to_arrays().items():
        np.testing.assert_array_equal(scene.to_arrays()[name], values, err_msg=name)
