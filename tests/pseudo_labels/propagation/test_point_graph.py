import numpy as np
import pytest
from steps_scene import scene

from rm3d_plugin.pseudo_labels.propagation.channels import channel_groups
from rm3d_plugin.pseudo_labels.propagation.neighborhoods import neighborhoods
from rm3d_plugin.pseudo_labels.propagation.point_features import point_features
from rm3d_plugin.pseudo_labels.propagation.point_graph import FLOOR, fixed_graph, measured_graph, smoothed
from rm3d_plugin.structures import PointCloud


def measured(cloud):
    return measured_graph(cloud.xyz, neighborhoods(cloud.xyz), channel_groups(cloud))


def fixed(cloud):
    return fixed_graph(cloud, neighborhoods(cloud.xyz), channel_groups(cloud))


def features_of(xyz, channels=()):
    return np.concatenate(list(point_features(xyz, neighborhoods(xyz), list(channels))), axis=1)


@pytest.mark.parametrize('graph_of', [measured, fixed])
@pytest.mark.parametrize('colors', [True, False])
def test_weights_are_symmetric_positive_and_weak_between_classes(graph_of, colors):
    cloud, semantic = scene(colors=colors)
    weights = graph_of(cloud).weights
    assert abs(weights - weights.T).max() == 0.0
    edges = weights.tocoo()
    assert edges.data.min() >= FLOOR
    across = semantic[edges.coords[0]] != semantic[edges.coords[1]]
    assert edges.data[across].mean() < 0.3 * edges.data[~across].mean()


def test_weights_do_not_depend_on_the_unit_of_length():
    cloud, _ = scene()
    near = measured(cloud).weights.toarray()[:200]
    far = measured(PointCloud(64.0 * cloud.xyz, colors=cloud.colors)).weights.toarray()[:200]
    np.testing.assert_allclose(near, far, atol=1e-6)


@pytest.mark.parametrize('count', [0, 1, 2, 5])
def test_few_points(count):
    cloud = PointCloud(np.arange(3.0 * count).reshape(count, 3))
    for graph in (measured(cloud), fixed(cloud)):
        assert graph.weights.shape == (count, count)
        assert graph.weights.diagonal().sum() == 0.0
    assert features_of(cloud.xyz).shape == (count, features_of(scene()[0].xyz).shape[1])


def test_points_in_one_place():
    cloud = PointCloud(np.ones((40, 3)))
    for graph in (measured(cloud), fixed(cloud)):
        assert np.isfinite(graph.weights.data).all()
    assert np.isfinite(features_of(cloud.xyz)).all()


def test_smoothed_is_the_mean_of_the_nearest():
    cloud, _ = scene()
    near = neighborhoods(cloud.xyz)
    values = cloud.colors.astype(float)
    expected = np.stack([values[row[:9]].mean(axis=0) for row in near.nearest[:50]])
    np.testing.assert_allclose(smoothed(values, near.nearest)[:50], expected)


def test_features_are_finite_and_do_not_depend_on_where_the_scene_lies():
    cloud, _ = scene()
    channels = channel_groups(cloud)
    here = features_of(cloud.xyz, channels)
    assert np.isfinite(here).all()
    moved = cloud.xyz.astype(np.float64) + [256.0, -128.0, 64.0]
    there = features_of(moved, channels)
    assert here.shape == there.shape
    assert np.median(np.abs(here - there)) < 1e-4  # voxels are cut from the lowest corner: they move along


def test_constant_channels_are_left_out():
    assert channel_groups(PointCloud(np.zeros((3, 3)), colors=np.full((3, 3), 0.5), intensity=np.zeros(3))) == []
