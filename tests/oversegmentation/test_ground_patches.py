"""Ground becomes squares, the rest is grown."""

import numpy as np
import pytest

from rm3d_plugin.ops.ground import segment_ground
from rm3d_plugin.oversegmentation import GroundPatches, RegionGrowing
from rm3d_plugin.oversegmentation.ground_patches import square_patches
from rm3d_plugin.structures import Descriptors, PointCloud

GROW = {'type': 'RegionGrowing', 'min_region': 5, 'max_edge': 0.5}


def nothing(count):
    return Descriptors(np.zeros((count, 1), dtype=np.float32), np.zeros(count, dtype=bool))


def street(rng):
    """Flat ground of 20 m, a wall at its end, a post."""
    ground = np.column_stack([rng.uniform(0, 20, (6000, 2)), rng.normal(0, 0.005, 6000)])
    wall = np.column_stack([np.full(1500, 19.0), rng.uniform(2, 18, 1500), rng.uniform(0.5, 6, 1500)])
    post = np.column_stack([rng.normal(5, 0.02, (80, 2)), np.linspace(0.5, 4, 80)])
    return PointCloud(np.concatenate([ground, wall, post]).astype(np.float32))


def test_squares_are_aligned_to_zero():
    xyz = np.array([[-0.1, 0.1, 0], [0.1, 0.1, 9], [0.9, 0.9, -3], [2.1, 0.1, 0]])
    assert square_patches(xyz, 1.0).tolist() == [0, 1, 1, 2]
    assert square_patches(np.zeros((0, 3)), 1.0).shape == (0,)


def test_ground_in_squares_and_the_rest_as_by_itself():
    cloud = street(np.random.default_rng(0))
    labels = GroundPatches(5.0, GROW).segment(cloud, nothing(len(cloud))).labels
    ground = segment_ground(cloud.xyz).is_ground
    assert ground[:6000].mean() > 0.99 and not ground[6000:].any()
    assert len(np.unique(labels[ground])) == 16
    for label in np.unique(labels[ground]):
        assert np.ptp(cloud.xyz[labels == label, :2], axis=0).max() <= 5.0
    others = np.flatnonzero(~ground)
    alone = RegionGrowing(min_region=5, max_edge=0.5).segment(cloud.select(others), nothing(len(others))).labels
    pairs = np.unique(np.stack([labels[others], alone]), axis=1)
    assert len(pairs.T) == len(np.unique(alone))  # the same partition
    assert not np.intersect1d(labels[ground], labels[others]).size
    assert len(np.unique(labels[6000:7500])) <= 3


def test_seeds_and_empty_scenes():
    cloud = street(np.random.default_rng(1))
    seeds = np.array([10, 6100, len(cloud) - 1])
    labels = GroundPatches(5.0, GROW).segment(cloud, nothing(len(cloud)), seeds).labels
    assert (labels >= 0).all()
    empty = PointCloud(np.zeros((0, 3), dtype=np.float32))
    assert len(GroundPatches(1.0, GROW).segment(empty, nothing(0)).labels) == 0


def test_wrong_settings_are_told():
    with pytest.raises(ValueError, match='cell > 0'):
        GroundPatches(0.0, GROW)
    with pytest.raises(ValueError, match='ground=None'):
        GroundPatches(1.0, {**GROW, 'ground': {}})
