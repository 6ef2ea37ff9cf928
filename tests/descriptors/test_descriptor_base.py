"""Region means, similarity, and the normals that descriptors work with."""

import numpy as np
import pytest

import rm3d_plugin.descriptors
from rm3d_plugin.descriptors import AdaptedPFH, cloud_normals, cosine_similarity, region_means
from rm3d_plugin.descriptors.base import virtual_viewpoint
from rm3d_plugin.structures import Descriptors, PointCloud, Regions

NAMES = 'AdaptedPFH PFH FPFH SHOT HKS WKS SIHKS VisualSimilarity VCCS SuperpointGraph'.split()


def test_cosine_worked_by_hand():
    first = np.array([[1.0, 0], [1, 1], [3, 4], [0, 0], [1, 0]])
    second = np.array([[2.0, 0], [1, 0], [-3, -4], [1, 1], [0, 5]])
    np.testing.assert_allclose(cosine_similarity(first, second), [1, np.sqrt(0.5), 0, 0, 0])
    np.testing.assert_array_equal(AdaptedPFH().similarity(first, second), cosine_similarity(first, second))
    assert cosine_similarity(np.zeros((0, 4)), np.zeros((0, 4))).shape == (0,)
    with pytest.raises(ValueError, match='two arrays'):
        cosine_similarity(first, second[:, :1])


def test_region_means_leave_invalid_points_out():
    values = np.float32([[1, 3], [3, 1], [0, 0], [4, 4], [0, 0], [9, 9]])
    valid = np.array([True, True, False, True, False, True])
    regions = Regions(np.array([0, 0, 0, 1, 2, -1]))
    means = region_means(Descriptors(values, valid), regions)
    np.testing.assert_allclose(means, [[2, 2], [4, 4], [0, 0]])
    np.testing.assert_allclose(
        region_means(Descriptors(values, valid), regions, histogram=True), [[0.5, 0.5], [0.5, 0.5], [0, 0]]
    )
    with pytest.raises(ValueError, match='6 descriptors for 2 points'):
        region_means(Descriptors(values, valid), Regions(np.array([0, 0])))


def test_given_normals_are_used():
    normals = np.float32([[1, 0, 0]] * 5)
    np.testing.assert_array_equal(cloud_normals(PointCloud(np.zeros((5, 3)), normals=normals), k=3), normals)


def test_estimates_turn_to_the_sensor():
    flat = np.random.default_rng(0).random((200, 3)) * [1, 1, 0]
    for side in (1, -1):
        got = cloud_normals(PointCloud(flat, sensor=(0.5, 0.5, 2.0 * side)), k=10)
        np.testing.assert_allclose(got, np.tile([0, 0, side], (200, 1)), atol=1e-6)
    assert len(np.unique(np.sign(cloud_normals(PointCloud(flat), k=10)[:, 2]))) == 1
    assert not cloud_normals(PointCloud(flat[:2]), k=10).any()


def test_the_virtual_viewpoint_moves_with_the_cloud():
    rng = np.random.default_rng(0)
    points = rng.random((500, 3)) ** 2 * [3, 2, 1]
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    view = virtual_viewpoint(points)
    np.testing.assert_allclose(virtual_viewpoint(points @ turn + 5), view @ turn + 5, atol=1e-9)
    assert np.linalg.norm(view - points.mean(axis=0)) == pytest.approx(np.sqrt(points.var(axis=0).sum()))
    assert virtual_viewpoint(np.zeros((0, 3))).tolist() == [0, 0, 0]


@pytest.mark.parametrize('name', NAMES)
def test_every_descriptor_has_presets(name):
    kind = getattr(rm3d_plugin.descriptors, name)
    assert set(kind.presets) == {'indoor', 'lidar'}
    for preset in kind.presets:
        assert isinstance(kind.preset(preset), kind)
    with pytest.raises(ValueError, match=rf"{name}\.preset: expected one of \['indoor', 'lidar'\], got 'moon'"):
        kind.preset('moon')
