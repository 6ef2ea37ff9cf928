"""Features of other programs are matched by place, whatever their order."""

import numpy as np
import pytest

from rm3d_plugin.descriptors import External
from rm3d_plugin.regions.geometry import SceneGeometry
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.storage import SceneCache
from rm3d_plugin.structures import PointCloud, SceneError

WORLD = np.random.default_rng(0).uniform(0, 3, (300, 3)) + np.array([4e5, 5e6, 100.0])
FEATURES = np.random.default_rng(1).normal(size=(300, 6))


@pytest.fixture
def files(tmp_path):
    """Features of scene `room` in another order, without its last 20 points."""
    order = np.random.default_rng(2).permutation(280)
    np.savez(tmp_path / 'room.npz', xyz=WORLD[order], features=FEATURES[order])
    np.save(tmp_path / 'room.npy', np.concatenate([WORLD[order], FEATURES[order]], axis=1))
    return tmp_path


@pytest.mark.parametrize('ending', ['npz', 'npy'])
def test_every_point_has_the_features_of_its_place(files, ending):
    cloud = PointCloud.from_world(WORLD)
    built = DESCRIPTORS.build({'type': 'External', 'files': f'{files}/{{scene}}.{ending}', 'max_distance': 1e-3})
    found = built.for_scene('room').compute(cloud)
    np.testing.assert_allclose(found.values[:280], FEATURES[:280], rtol=1e-6)
    assert found.valid.tolist() == [True] * 280 + [False] * 20 and not found.values[280:].any()
    part = built.for_scene('room').compute(cloud.select(np.arange(40, 90)))
    np.testing.assert_array_equal(part.values, found.values[40:90])


def test_geometry_is_made_again_when_the_features_change(files, tmp_path):
    cloud = PointCloud.from_world(WORLD)
    parts = {'type': 'External', 'files': f'{files}/{{scene}}.npz', 'max_distance': 9.0}, {'type': 'RegionGrowing'}
    geometry = SceneGeometry(SceneCache(tmp_path / 'cache'), *parts)
    before = geometry.key(cloud, None, 'room')
    assert geometry.prepared(before, lambda: cloud, lambda: None, 'room').graph.descriptors.shape[1] == 6
    assert geometry.key(cloud, None, 'room') == before != geometry.key(cloud, None, 'other')
    np.savez(files / 'room.npz', xyz=WORLD, features=FEATURES + 1.0)
    assert geometry.key(cloud, None, 'room') != before


def test_what_cannot_be_used_is_told_with_its_file(files):
    cloud, pattern = PointCloud.from_world(WORLD), f'{files}/{{scene}}.npz'
    with pytest.raises(ValueError, match=r'External.files: expected a path with \{scene\}'):
        External('features.npz')
    with pytest.raises(ValueError, match='above 0'):
        External(pattern, 0.0)
    with pytest.raises(SceneError, match='needs the name of the scene'):
        External(pattern).compute(cloud)
    for name, arrays, words in [
        ('none', None, "scene 'none' has no file"),
        ('far', {'xyz': WORLD + 50.0, 'features': FEATURES}, 'no place lies within'),
        ('short', {'xyz': WORLD[:9], 'features': FEATURES}, 'expected .npz with `xyz`'),
        ('empty', {'xyz': WORLD, 'features': FEATURES[:, :0]}, 'expected .npz with `xyz`'),
        ('nameless', {'features': FEATURES}, 'expected .npz with `xyz`'),
        ('nan', {'xyz': WORLD, 'features': np.where(FEATURES > 2, np.nan, FEATURES)}, 'NaN'),
        ('words', {'xyz': WORLD, 'features': np.full((300, 2), 'a')}, 'expected .npz with `xyz`'),
    ]:
        if arrays is not None:
            np.savez(files / f'{name}.npz', **arrays)
        with pytest.raises(SceneError, match=words):
            External(pattern).for_scene(name).compute(cloud)
    (files / 'cut.npz').write_bytes((files / 'room.npz').read_bytes()[:200])
    with pytest.raises(SceneError, match='cut.npz: expected .npz'):
        External(pattern).for_scene('cut').compute(cloud)
