"""Columns of learned descriptors: those of PointSIFT, then of Semantic, whatever the cloud."""

import numpy as np
import pytest

from rm3d_plugin.descriptors import PointSIFT, Semantic
from rm3d_plugin.pseudo_labels.propagation import prepare_cloud
from rm3d_plugin.pseudo_labels.propagation.learned_features import WIDTH, learned_features
from rm3d_plugin.structures import PointCloud


def columns(cloud):
    return np.concatenate(list(learned_features(cloud)), axis=1)


def bent_sheet(count=3000):
    xy = np.random.default_rng(0).uniform(0, 2, (count, 2))
    return np.c_[xy, np.maximum(xy[:, 0] - 1.0, 0.0)].astype(np.float32)


def test_they_are_those_of_the_descriptor_in_any_order_of_the_points():
    cloud = PointCloud(bent_sheet())
    found = columns(cloud)
    wanted = [PointSIFT().compute(cloud).values, Semantic().compute(cloud).values]
    assert np.array_equal(found, np.concatenate(wanted, axis=1))
    order = np.random.default_rng(1).permutation(len(cloud))
    assert np.allclose(columns(cloud.select(order)), found[order], atol=1e-5)
    found = found[:, : WIDTH // 2]  # of PointSIFT; Semantic knows heights, too
    flat, slope = found[cloud.xyz[:, 0] < 0.7].mean(axis=0), found[cloud.xyz[:, 0] > 1.3].mean(axis=0)
    crease = found[np.abs(cloud.xyz[:, 0] - 1.0) < 0.02].mean(axis=0)
    assert np.linalg.norm(crease - flat) > 2 * np.linalg.norm(slope - flat), 'the crease is told from both planes'


@pytest.mark.parametrize('count', [0, 1, 5])
def test_clouds_of_few_points_have_zeros_of_the_same_width(count):
    assert np.array_equal(columns(PointCloud(np.eye(8, 3, dtype=np.float32)[:count])), np.zeros((count, WIDTH)))


def test_a_dense_part_and_a_long_road_are_prepared():
    rng = np.random.default_rng(0)
    road = np.c_[np.linspace(10, 5000, 120_000), rng.uniform(0, 0.1, (120_000, 2))]
    cloud = PointCloud(np.r_[rng.uniform(0, 0.2, (150_000, 3)), road].astype(np.float32))
    scales = prepare_cloud(cloud).scales
    assert all(np.isfinite(scale.features).all() for scale in scales)
