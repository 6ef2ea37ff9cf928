import numpy as np
import pytest
from reference.neighbors_slow import slow_neighbors

from rm3d_plugin.descriptors import SuperpointGraph
from rm3d_plugin.ops.geometric_features import geometric_features
from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.structures import PointCloud, SceneError


def slow_features(points, k):
    out = []
    for near, _ in slow_neighbors(points, points, k=k + 1):
        values, vectors = np.linalg.eigh(np.cov(points[near].astype(np.float64).T, bias=True))
        values = np.maximum(values, 0)
        s3, s2, s1 = np.sqrt(values)
        direction = np.abs(vectors) @ values
        out.append([(s1 - s2) / s1, (s2 - s3) / s1, s3 / s1, direction[2] / np.linalg.norm(direction)])
    return np.array(out)


def test_equals_the_slow_twin():
    rng = np.random.default_rng(0)
    points = (rng.normal(size=(300, 3)) * [3, 1, 0.2]).astype(np.float32)
    found = geometric_features(points, 20)
    assert found.valid.all()
    np.testing.assert_allclose(found.values, slow_features(points, 20), atol=1e-5)
    np.testing.assert_allclose(found.values[:, :3].sum(axis=1), 1, atol=1e-6)


def test_shapes_have_the_features_of_their_names():
    rng = np.random.default_rng(1)
    t = np.linspace(0, 1, 60)
    pole = np.c_[np.zeros((60, 2)), t]
    floor = np.c_[rng.uniform(0, 1, (400, 2)), np.zeros(400)]
    ball = rng.uniform(-1, 1, (4000, 3))
    np.testing.assert_allclose(geometric_features(pole, 10).values, np.tile([1, 0, 0, 1], (60, 1)), atol=1e-6)
    values = geometric_features(floor, 40).values
    assert (values[:, 2] < 1e-6).all() and (values[:, 3] < 1e-6).all() and np.median(values[:, 1]) > 0.7
    wall = geometric_features(floor[:, [0, 2, 1]], 40).values
    assert 0.5 < np.median(wall[:, 3]) < 0.9
    inner = (np.abs(ball) < 0.5).all(axis=1)
    assert np.median(geometric_features(ball, 40).values[inner, 2]) > 0.6


def test_far_from_the_origin_and_about_the_upright_axis_nothing_changes():
    rng = np.random.default_rng(2)
    points = rng.normal(size=(200, 3)) * [2, 1, 0.3]
    first = geometric_features(points, 15).values
    np.testing.assert_allclose(geometric_features(points + [4e5, 5e6, 100], 15).values, first, atol=1e-4)
    turned = points @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(geometric_features(turned, 15).values, first, atol=1e-6)


def test_few_and_equal_points_are_not_valid():
    for points in (np.zeros((0, 3)), np.zeros((1, 3)), np.eye(3)[:2], np.ones((60, 3))):
        found = geometric_features(points)
        assert found.values.shape == (len(points), 4) and not found.valid.any() and not found.values.any()


def test_wrong_input_is_named():
    with pytest.raises(ValueError, match='k: expected at least 1, got 0'):
        geometric_features(np.zeros((3, 3)), 0)
    with pytest.raises(ValueError, match='one of the 3 points, got one of 4'):
        geometric_features(np.zeros((3, 3)), octree=Octree(np.zeros((4, 3))))
    with pytest.raises(ValueError, match='NaN'):
        geometric_features(np.full((3, 3), np.nan))


def test_descriptor_doubles_verticality_and_appends_colours():
    rng = np.random.default_rng(3)
    xyz, colors = rng.normal(size=(100, 3)), rng.uniform(size=(100, 3)).astype(np.float32)
    features = geometric_features(PointCloud(xyz).xyz, 45).values
    values = SuperpointGraph().compute(PointCloud(xyz)).values
    np.testing.assert_array_equal(values, features * np.float32([1, 1, 1, 2]))
    values = SuperpointGraph(colors=True).compute(PointCloud(xyz, colors=colors)).values
    np.testing.assert_array_equal(values[:, 4:], colors)
    with pytest.raises(SceneError, match='PointCloud.colors is None'):
        SuperpointGraph(colors=True).compute(PointCloud(xyz))
    with pytest.raises(ValueError, match='k >= 2'):
        SuperpointGraph(k=1)
