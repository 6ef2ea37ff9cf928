import numpy as np
import pytest

from rm3d_plugin.oversegmentation import GroundPatches, Oversegmenter, Precomputed, RegionGrowing
from rm3d_plugin.oversegmentation.base import seeds_among
from rm3d_plugin.registry import OVERSEGMENTERS
from rm3d_plugin.structures import Descriptors, PointCloud, SceneError


class Recorder(Oversegmenter):
    """One region a point; remembers what it was given."""

    def partition(self, cloud, descriptors, seeds=None, scene=''):
        self.given = (cloud, descriptors, seeds)
        return np.arange(len(cloud))


def street():
    """Ground with a block 1 m above it in the middle of the list."""
    grid = np.stack(np.meshgrid(np.arange(0, 20, 0.5), np.arange(0, 20, 0.5)), axis=-1).reshape(-1, 2)
    ground = np.c_[grid, np.zeros(len(grid))]
    block = np.array([[5.0, 5.0, 1.0], [5.2, 5.0, 1.0], [5.0, 5.2, 1.0]])
    return PointCloud(np.concatenate([ground[:100], block, ground[100:]]))


def rows(cloud):
    return Descriptors(np.arange(len(cloud), dtype=np.float32)[:, None], np.ones(len(cloud), dtype=bool))


def test_ground_goes_first_and_labels_come_back_to_their_points():
    cloud = street()
    segmenter = Recorder(ground={})
    regions = segmenter.segment(cloud, rows(cloud), seeds=np.array([101, 3]))
    rest, descriptors, seeds = segmenter.given
    np.testing.assert_array_equal(rest.xyz, cloud.xyz[100:103])
    assert descriptors.values[:, 0].tolist() == [100, 101, 102]
    assert seeds.tolist() == [1]
    assert np.flatnonzero(regions.labels >= 0).tolist() == [100, 101, 102]
    assert regions.labels[100:103].tolist() == [0, 1, 2]


def test_ground_is_kept_by_default():
    cloud = street()
    assert not Recorder().find_ground(cloud).any()
    assert len(Recorder().segment(cloud, rows(cloud))) == len(cloud)


def test_wrong_input_is_named():
    cloud = street()
    with pytest.raises(ValueError, match='descriptors .one a point., got 3'):
        Recorder().segment(cloud, rows(PointCloud(np.zeros((3, 3)))))
    with pytest.raises(ValueError, match='expected point numbers 0..4, got 1..5'):
        seeds_among(np.array([1, 5]), np.arange(5), 5)
    assert seeds_among(None, np.arange(5), 5) is None


def test_precomputed_labels_pass_through():
    cloud = PointCloud(np.zeros((4, 3)))
    segmenter = OVERSEGMENTERS.build(dict(type='Precomputed', labels=[7, 7, -1, 2]))
    assert segmenter.segment(cloud, rows(cloud)).labels.tolist() == [0, 0, -1, 1]
    with pytest.raises(ValueError, match=r'expected shape \(5,\), one label a point, got \(4,\)'):
        segmenter.segment(PointCloud(np.zeros((5, 3))), rows(PointCloud(np.zeros((5, 3)))))


def test_precomputed_files_of_many_scenes(tmp_path):
    np.savez(tmp_path / 'a.npz', labels=np.array([4, 4, -1, 9]), xyz=np.zeros((4, 3)))
    np.savez(tmp_path / 'b.npz', labels=np.array([0.5]))
    cloud = PointCloud(np.zeros((4, 3)))
    segmenter = Precomputed(files=str(tmp_path / '{scene}.npz'))
    assert segmenter.segment(cloud, rows(cloud), scene='a').labels.tolist() == [0, 0, -1, 1]
    with pytest.raises(SceneError, match="scene 'c' has no file .*c.npz"):
        segmenter.segment(cloud, rows(cloud), scene='c')
    with pytest.raises(SceneError, match='b.npz: expected whole numbers'):
        segmenter.segment(cloud, rows(cloud), scene='b')
    np.save(tmp_path / 'a.npy', np.array([1, 1, 1]))
    with pytest.raises(ValueError, match=r'a.npy: expected shape \(4,\), one label a point, got \(3,\)'):
        Precomputed(files=str(tmp_path / '{scene}.npy')).segment(cloud, rows(cloud), scene='a')
    for labels, files in ((None, None), ([1], 'x/{scene}.npz')):
        with pytest.raises(ValueError, match='got both or neither'):
            Precomputed(labels, files)
    with pytest.raises(ValueError, match="path with {scene} in it, got 'x.npz'"):
        Precomputed(files='x.npz')


def test_settings_make_the_fingerprint():
    same, other = RegionGrowing(zeta=0.02), RegionGrowing(zeta=0.03)
    assert same.fingerprint() == RegionGrowing().fingerprint() != other.fingerprint()
    patches = [GroundPatches(1.0, {'type': 'RegionGrowing', 'zeta': zeta}).fingerprint() for zeta in (0.02, 0.03)]
    assert len({*patches, Precomputed([0, 1]).fingerprint(), Precomputed([1, 1]).fingerprint()}) == 4
