"""The names under which prepared scenes are kept: another setting, other weights or another file is another name."""

import numpy as np
import pytest

from rm3d_plugin.descriptors import Descriptor
from rm3d_plugin.regions.geometry import SceneGeometry
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.storage import SceneCache
from rm3d_plugin.structures import Descriptors, PointCloud

CLOUD = PointCloud(np.random.default_rng(0).random((50, 3)) * [1, 1, 0.01])
GROWING = {'type': 'RegionGrowing', 'min_region': 1}


@pytest.fixture(autouse=True)
def learned():
    """A descriptor that reads its weights from a file, as a checkpoint would be read."""

    @DESCRIPTORS.register_module(force=True)
    class LearnedHeight(Descriptor):
        calls = 0

        def __init__(self, checkpoint):
            self.weights = {'w': np.load(checkpoint)}

        def compute(self, cloud):
            type(self).calls += 1
            return Descriptors(np.float32(cloud.xyz * self.weights['w']), np.ones(len(cloud), dtype=bool))

    yield LearnedHeight
    DESCRIPTORS.module_dict.pop('LearnedHeight')


def key(tmp_path, descriptor=None, oversegmenter=None, cloud=CLOUD, seeds=None, scene='a', **more):
    descriptor = descriptor or {'type': 'AdaptedPFH', 'radius': 0.5}
    return SceneGeometry(SceneCache(tmp_path), descriptor, oversegmenter or GROWING, **more).key(cloud, seeds, scene)


def test_settings_points_and_seeds(tmp_path):
    own = key(tmp_path)
    assert own == key(tmp_path) == key(tmp_path, {'type': 'AdaptedPFH', 'radius': 0.5, 'max_neighbors': 48}, scene='b')
    moved = PointCloud(CLOUD.xyz + 1)
    others = [
        key(tmp_path, {'type': 'AdaptedPFH', 'radius': 0.6}),
        key(tmp_path, {'type': 'SHOT', 'radius': 0.5}),
        key(tmp_path, oversegmenter=GROWING | {'zeta': 0.5}),
        key(tmp_path, graph_neighbors=4),
        key(tmp_path, max_gap=1.0),
        key(tmp_path, cloud=moved),
        key(tmp_path, cloud=PointCloud(CLOUD.xyz, intensity=CLOUD.xyz[:, 0])),
        key(tmp_path, seeds=np.array([3])),
    ]
    assert len({own, *others}) == len(others) + 1


def test_other_weights_under_the_same_name_are_described_anew(tmp_path, learned):
    made = []
    for weight in (1.0, 1.0, 2.0):
        np.save(tmp_path / 'weights.npy', np.full(3, weight))
        geometry = SceneGeometry(
            SceneCache(tmp_path / 'cache'), {'type': 'LearnedHeight', 'checkpoint': tmp_path / 'weights.npy'}, GROWING
        )
        name = geometry.key(CLOUD, None)
        scene = geometry.prepared(name, lambda: CLOUD, lambda: None, 'a')
        made.append((name, scene.graph.descriptors[0].tolist()))
    assert made[0] == made[1] and learned.calls == 2
    assert made[2][0] != made[0][0]
    np.testing.assert_allclose(made[2][1], 2 * np.array(made[0][1]), rtol=1e-6)


def test_precomputed_regions_of_each_scene(tmp_path):
    parts = {'type': 'Precomputed', 'files': str(tmp_path / '{scene}.npy')}
    for scene, regions in (('a', 2), ('b', 5)):
        np.save(tmp_path / f'{scene}.npy', np.arange(50) % regions)
    before = [key(tmp_path, oversegmenter=parts, scene=scene) for scene in 'ab']
    np.save(tmp_path / 'a.npy', np.arange(50) % 3)
    after = [key(tmp_path, oversegmenter=parts, scene=scene) for scene in 'ab']
    assert after[1] == before[1] and len({*before, *after}) == 3
    geometry = SceneGeometry(SceneCache(tmp_path / 'cache'), {'type': 'AdaptedPFH', 'radius': 0.5}, parts)
    counts = [
        len(geometry.prepared(n, lambda: CLOUD, lambda: None, s).regions) for s, n in zip('ab', after, strict=True)
    ]
    assert counts == [3, 5]
