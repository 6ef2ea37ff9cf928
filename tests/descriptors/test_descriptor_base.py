"""Similarity, fingerprints, and the normals that descriptors work with."""

import numpy as np
import pytest

import rm3d_plugin.descriptors
from rm3d_plugin.descriptors import Descriptor, cloud_normals, cosine_similarity
from rm3d_plugin.descriptors.base import virtual_viewpoint
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import Descriptors, PointCloud

NAMES = 'AdaptedPFH PFH FPFH SHOT HKS WKS SIHKS VisualSimilarity VCCS SuperpointGraph'.split()


def test_cosine_worked_by_hand():
    first = np.array([[1.0, 0], [1, 1], [3, 4], [0, 0], [1, 0]])
    second = np.array([[2.0, 0], [1, 0], [-3, -4], [1, 1], [0, 5]])
    np.testing.assert_allclose(cosine_similarity(first, second), [1, np.sqrt(0.5), 0, 0, 0])
    assert cosine_similarity(np.zeros((0, 4)), np.zeros((0, 4))).shape == (0,)
    with pytest.raises(ValueError, match='two arrays'):
        cosine_similarity(first, second[:, :1])


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


@pytest.mark.parametrize('name', NAMES)
def test_settings_make_the_fingerprint(name):
    kind = getattr(rm3d_plugin.descriptors, name)
    assert kind().fingerprint() == kind().fingerprint() == DESCRIPTORS.build({'type': name}).fingerprint()
    indoor, lidar = kind.preset('indoor'), kind.preset('lidar')
    assert indoor.fingerprint() == kind(**kind.presets['indoor']).fingerprint()
    assert (indoor.fingerprint() == lidar.fingerprint()) == (kind.presets['indoor'] == kind.presets['lidar'])


def test_fingerprints_of_parts_inside_parts_and_of_kinds():
    vccs = rm3d_plugin.descriptors.VCCS
    assert vccs({'type': 'FPFH'}).fingerprint() == vccs().fingerprint()
    assert vccs({'type': 'FPFH', 'radius': 0.2}).fingerprint() != vccs().fingerprint()
    kinds = [getattr(rm3d_plugin.descriptors, name)().fingerprint() for name in NAMES]
    assert len(set(kinds)) == len(kinds)  # HKS, WKS and SIHKS have the same settings


class Learned(Descriptor):
    """Height times a learned number."""

    def __init__(self, weights, scale=1.0):
        self.weights, self.scale = weights, scale
        self._network = object()  # made of the weights

    def compute(self, cloud):
        values = np.float32(self.weights['w'][0] * self.scale * cloud.xyz[:, 2:3])
        return Descriptors(values, np.ones(len(cloud), dtype=bool))


class Newer(Learned):
    version = 2


def test_weights_and_version_are_in_the_fingerprint():
    same, other = Learned({'w': np.ones(1)}), Learned({'w': np.full(1, 2.0)})
    assert same.fingerprint() == Learned({'w': np.ones(1)}).fingerprint() != other.fingerprint()
    assert same.fingerprint() != Learned({'w': np.ones(1)}, scale=2.0).fingerprint()
    older = Newer({'w': np.ones(1)})
    newer = older.fingerprint()
    Newer.version = 3
    assert older.fingerprint() != newer
    with pytest.raises(
        TypeError, match=r'Learned.fingerprint: .*object has no stable content; .*keep weights as arrays'
    ):
        Learned(object()).fingerprint()
