import tracemalloc

import numpy as np
import pytest
from reference.kitti_frames import frames, read_frame
from reference.rooms import make_room

from rm3d_plugin.descriptors import AdaptedPFH, Descriptor
from rm3d_plugin.oversegmentation import GroundPatches, Precomputed, RegionGrowing
from rm3d_plugin.regions.prepare import PreparedScene, prepare_scene
from rm3d_plugin.structures import Descriptors, PointCloud, Regions, SceneError


class Height(Descriptor):
    """Describes a point by its height, and remembers how many points it was given."""

    def compute(self, cloud):
        self.points = len(cloud)
        return Descriptors(cloud.xyz[:, 2:] + 1.0, np.ones(len(cloud), dtype=bool))


def street():
    """Ground with two boards of 100 points that stand 0.6 m apart."""
    rng = np.random.default_rng(0)
    ground = np.c_[rng.uniform(-10, 10, (3000, 2)), rng.normal(0, 0.01, 3000)]
    board = np.stack(np.meshgrid(np.arange(10), [0], np.arange(10)), axis=-1).reshape(-1, 3) * 0.1 + [0, 0, 0.5]
    xyz = np.concatenate([ground[:1000], board, ground[1000:], board + [0, 0.6, 0]])
    return PointCloud(xyz, intensity=rng.uniform(size=len(xyz)), sensor=(0.0, 0.0, 2.0))


def same(a, b):
    left, right = a.to_arrays(), b.to_arrays()
    assert set(left) == set(right)
    for name in left:
        assert left[name].dtype == right[name].dtype, name
        np.testing.assert_array_equal(left[name], right[name], err_msg=name)


def test_nothing_is_computed_for_ground():
    descriptor = Height()
    scene = prepare_scene(street(), descriptor, RegionGrowing(ground={}, max_edge=0.3), max_gap=0.7)
    assert descriptor.points == 200
    boards = np.r_[1000:1100, 3100:3200]
    assert scene.regions.labels[boards].tolist() == [0] * 100 + [1] * 100
    assert (np.delete(scene.regions.labels, boards) == -1).all()
    np.testing.assert_allclose(np.abs(scene.cloud.normals[boards]), np.tile([0, 1, 0], (200, 1)), atol=1e-3)
    assert not np.delete(scene.cloud.normals, boards, axis=0).any()
    assert scene.graph.edges.tolist() == [[0, 1]]
    np.testing.assert_allclose(scene.graph.extents, np.tile([0.9, 0.9, 0.0], (2, 1)), atol=1e-5)


def test_ground_stays_where_it_is_wanted():
    descriptor = Height()
    scene = prepare_scene(street(), descriptor, RegionGrowing())
    assert descriptor.points == len(scene.cloud)
    assert (scene.regions.labels >= 0).all()


def test_seeds_are_numbers_of_the_whole_cloud():
    cloud = street()
    first = prepare_scene(cloud, Height(), RegionGrowing(ground={}, max_edge=0.3), seeds=np.array([3150, 0]))
    assert len(first.regions) == 2
    with pytest.raises(ValueError, match='expected point numbers'):
        prepare_scene(cloud, Height(), RegionGrowing(), seeds=np.array([len(cloud)]))


def test_given_normals_and_labels_are_used():
    cloud = street()
    normals = np.tile([0.0, 0.0, -1.0], (len(cloud), 1)).astype(np.float32)
    given = PointCloud(cloud.xyz, normals=normals, curvature=np.full(len(cloud), 0.25))
    labels = np.full(len(cloud), -1)
    labels[[5, 7, 9]] = [3, 1, 3]
    scene = prepare_scene(given, Height(), Precomputed(labels))
    np.testing.assert_array_equal(scene.cloud.normals, normals)
    np.testing.assert_allclose(scene.graph.curvatures, 0.25)
    assert scene.graph.sizes.tolist() == [2, 1]


def test_arrays_survive_a_file_without_pickle(tmp_path):
    for cloud in (street(), PointCloud(make_room(density=100.0)[0], colors=None)):
        scene = prepare_scene(cloud, Height(), RegionGrowing())
        np.savez(tmp_path / 'scene.npz', **scene.to_arrays())
        with np.load(tmp_path / 'scene.npz', allow_pickle=False) as arrays:
            same(PreparedScene.from_arrays(dict(arrays)), scene)


def test_wrong_arrays_are_named():
    arrays = prepare_scene(street(), Height(), RegionGrowing()).to_arrays()
    del arrays['graph.sizes']
    with pytest.raises(SceneError, match=r"\['graph.sizes'\] missing"):
        PreparedScene.from_arrays(arrays)
    scene = prepare_scene(street(), Height(), RegionGrowing())
    with pytest.raises(ValueError, match='cover 2 of 3200'):
        PreparedScene(scene.cloud, Regions(np.array([0, 1])), scene.graph)
    with pytest.raises(ValueError, match='partition of 1'):
        PreparedScene(scene.cloud, Regions(np.zeros(3200, dtype=np.int64)), scene.graph)


@pytest.mark.filterwarnings('ignore:scene.*(no points|ground|described):UserWarning')
@pytest.mark.parametrize('n', [0, 1, 4])
@pytest.mark.parametrize('ground', [None, {}])
def test_very_few_points(n, ground):
    cloud = PointCloud(np.arange(3.0 * n).reshape(n, 3), sensor=(0.0, 0.0, 0.0))
    for max_gap in (None, 0.5):
        scene = prepare_scene(cloud, AdaptedPFH(), RegionGrowing(ground=ground), max_gap=max_gap)
        assert len(scene.cloud) == n
        same(PreparedScene.from_arrays(scene.to_arrays()), scene)


def test_same_result_twice_and_for_any_number_of_threads(monkeypatch):
    cloud = PointCloud(make_room(density=300.0)[0])
    scenes = []
    for threads in (1, 2):
        monkeypatch.setattr('numba.config.NUMBA_NUM_THREADS', threads)
        scenes.append(prepare_scene(cloud, AdaptedPFH(), RegionGrowing(), max_gap=0.1))
    same(*scenes)


def test_real_street(real_data):
    scan = read_frame(real_data, frames(real_data)[0])
    cloud = PointCloud(scan.xyz, intensity=scan.intensity, sensor=(0.0, 0.0, 0.0))
    scene = prepare_scene(cloud, AdaptedPFH.preset('lidar'), RegionGrowing.preset('lidar'), max_gap=0.6)
    assert len(scene.regions) > 20
    assert len(scene.graph.edges) > 20
    assert scene.graph.colors.shape == (len(scene.regions), 1)
    pedestrian = scene.regions.labels[(scan.instance == 0) & (scan.over_bottom > 0.25)]
    assert (pedestrian >= 0).mean() > 0.99


class Wide(Descriptor):
    """As many columns as AdaptedPFH has."""

    def compute(self, cloud):
        return Descriptors(np.ones((len(cloud), 125), dtype=np.float32), np.ones(len(cloud), dtype=bool))


def peak_of(points, segmenter):
    """Bytes that the preparation of a noisy plane takes, without the compiled kernels."""
    rng = np.random.default_rng(0)
    cloud = PointCloud(np.c_[rng.uniform(0, np.sqrt(points) / 30, (points, 2)), rng.normal(0, 0.005, points)])
    tracemalloc.start()
    scene = prepare_scene(cloud, Wide(), segmenter)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak, scene


@pytest.mark.parametrize(
    'segmenter',
    [RegionGrowing(), GroundPatches(1.0, {'type': 'RegionGrowing'}, {'max_height': 1e-4})],
    ids=['grown', 'patches'],
)
def test_memory_grows_by_the_descriptors_alone(segmenter):
    """500 bytes a point are descriptors; a second copy of them would take the sum over 1300."""
    peak_of(300, segmenter)
    (less, _), (more, scene) = (peak_of(points, segmenter) for points in (20_000, 40_000))
    assert (scene.regions.labels >= 0).all()
    assert (more - less) / 20_000 < 1000
