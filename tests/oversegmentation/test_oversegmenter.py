import numpy as np
import pytest

from rm3d_plugin.oversegmentation import Oversegmenter
from rm3d_plugin.oversegmentation.base import seeds_among
from rm3d_plugin.registry import OVERSEGMENTERS
from rm3d_plugin.structures import Descriptors, PointCloud


class Recorder(Oversegmenter):
    """One region a point; remembers what it was given."""

    def partition(self, cloud, descriptors, seeds=None):
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
    with pytest.raises(ValueError, match=r'expected shape \(5,\), got \(4,\)'):
        segmenter.segment(PointCloud(np.zeros((5, 3))), rows(PointCloud(np.zeros((5, 3)))))
