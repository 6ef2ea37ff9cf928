import numpy as np
import pytest

from rm3d_plugin.ops.color import rgb_to_lab
from rm3d_plugin.regions.features import region_colors, region_extents, region_features
from rm3d_plugin.structures import Descriptors, PointCloud, Regions


def test_lab_of_known_colours():
    """Published values (sRGB, D65)."""
    rgb = np.array([[1, 1, 1], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0.5]])
    lab = [
        [100, 0, 0],
        [0, 0, 0],
        [53.24, 80.09, 67.20],
        [87.73, -86.18, 83.18],
        [32.30, 79.19, -107.86],
        [53.39, 0, 0],
    ]
    np.testing.assert_allclose(rgb_to_lab(rgb), lab, atol=0.02)


def test_extents_follow_the_region_not_the_axes():
    rng = np.random.default_rng(0)
    size = np.array([2.0, 1.0, 0.5])
    box = rng.uniform(-0.5, 0.5, (4000, 3)) * size
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    xyz = np.concatenate([box @ rotation.T + 100.0, [[0, 0, 0], [0, 0, 3.0]], [[5.0, 5.0, 5.0]]])
    regions = Regions(np.repeat([0, 1, 2], [4000, 2, 1]))
    extents = region_extents(xyz, regions)
    np.testing.assert_allclose(extents[0], size, rtol=0.08)
    np.testing.assert_allclose(extents[1:], [[3, 0, 0], [0, 0, 0]], atol=1e-9)


def test_means_leave_out_what_is_not_described():
    normals = np.array([[0, 0, 1.0], [0, 0, -1.0], [1.0, 0, 0], [0, 1.0, 0]])
    cloud = PointCloud(
        np.array([[0, 0, 0], [2.0, 0, 0], [5.0, 5.0, 5.0], [9.0, 9.0, 9.0]]),
        intensity=np.array([0.2, 0.4, 0.9, 0.0]),
        normals=normals,
        curvature=np.array([0.1, 0.3, 0.05, 0.0]),
    )
    values = np.array([[1, 0], [0, 0], [0, 0], [7, 7]], dtype=np.float32)
    features = region_features(
        cloud, Descriptors(values, np.array([True, False, False, True])), Regions(np.array([0, 0, 1, -1]))
    )
    np.testing.assert_allclose(features.centroids, [[1, 0, 0], [5, 5, 5]])
    np.testing.assert_allclose(features.normals, [[0, 0, 1], [1, 0, 0]])
    np.testing.assert_allclose(features.curvatures, [0.2, 0.05], rtol=1e-6)
    np.testing.assert_allclose(features.descriptors, [[1, 0], [0, 0]])
    np.testing.assert_allclose(features.colors, [[0.3], [0.9]], rtol=1e-6)


def test_colour_goes_before_intensity():
    xyz, regions = np.zeros((2, 3)), Regions(np.array([0, 0]))
    both = PointCloud(xyz, colors=np.array([[1.0, 1.0, 1.0], [0.0, 0.0, 0.0]]), intensity=np.ones(2))
    np.testing.assert_allclose(region_colors(both, regions), [[50, 0, 0]], atol=1e-6)
    assert region_colors(PointCloud(xyz), regions) is None


def test_mean_normal_turns_with_the_scene():
    rng = np.random.default_rng(1)
    normals = np.array([0.6, 0.0, 0.8]) + rng.normal(0, 0.1, (30, 3))
    normals *= rng.choice([-1.0, 1.0], (30, 1)) / np.linalg.norm(normals, axis=1, keepdims=True)
    descriptors = Descriptors(np.ones((30, 1), dtype=np.float32), np.ones(30, dtype=bool))
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]

    def mean(turned):
        cloud = PointCloud(np.zeros((30, 3)), normals=turned, curvature=np.zeros(30))
        return region_features(cloud, descriptors, Regions(np.zeros(30, dtype=np.int64))).normals[0]

    np.testing.assert_allclose(mean(normals @ rotation.T), rotation @ mean(normals), atol=1e-6)
    assert np.linalg.norm(mean(normals)) == pytest.approx(1.0)
