import importlib.util
import sys

import numpy as np
import pytest
from reference.boundary_slow import slow_boundary
from reference.cut_pursuit_slow import best_chain, energy
from reference.rooms import make_room

from rm3d_plugin.descriptors import SuperpointGraph
from rm3d_plugin.oversegmentation import CutPursuit
from rm3d_plugin.oversegmentation.cut_pursuit import cut_pursuit, neighbor_graph
from rm3d_plugin.registry import OVERSEGMENTERS
from rm3d_plugin.structures import Descriptors, PointCloud, Regions

needs_solver = pytest.mark.skipif(
    importlib.util.find_spec('cut_pursuit_py') is None, reason='cut-pursuit-py is not installed'
)


def chain(count):
    return np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)


def described(values):
    return Descriptors(np.asarray(values, dtype=np.float32), np.ones(len(values), dtype=bool))


def test_graph_by_hand():
    xyz = np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0], [3.5, 0, 0]])
    graph = neighbor_graph(xyz, 1)
    assert graph.edges.tolist() == [[0, 1], [2, 3]]
    np.testing.assert_allclose(graph.weights, [1 / (1 + 1 / 0.75), 1 / (1 + 0.5 / 0.75)])
    assert sorted(graph.neighbors[1].tolist()) == [-1, 0]
    copies = neighbor_graph(np.zeros((5, 3)), 2).neighbors
    assert ((copies >= 0).sum(axis=1) == 2).all()
    same = neighbor_graph(np.zeros((3, 3)), 2)
    assert same.edges.tolist() == [[0, 1], [0, 2], [1, 2]] and same.weights.tolist() == [1, 1, 1]
    assert neighbor_graph(np.zeros((0, 3)), 10).edges.shape == (0, 2)
    assert neighbor_graph(np.zeros((1, 3)), 10).edges.shape == (0, 2)


def test_without_the_solver_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, 'cut_pursuit_py', None)
    cloud = PointCloud(np.eye(3))
    with pytest.raises(ImportError, match='pip install cut-pursuit-py'):
        CutPursuit().segment(cloud, described(np.eye(3)))


def test_wrong_input_is_named():
    with pytest.raises(ValueError, match='regularization > 0'):
        OVERSEGMENTERS.build(dict(type='CutPursuit', regularization=0))
    with pytest.raises(ValueError, match='NaN or infinite'):
        cut_pursuit(np.full((2, 1), np.nan), chain(2), np.ones(1))


@needs_solver
@pytest.mark.parametrize(('weight', 'parts'), [(4.9, 2), (5.1, 1)])
def test_a_step_is_cut_where_that_costs_less(weight, parts):
    # Ten zeros and ten ones: one part fits with 20 * 0.25 = 5, two parts fit exactly and pay one edge.
    features = np.repeat([0.0, 1.0], 10)[:, None]
    labels = cut_pursuit(features, chain(20), np.full(19, weight))
    assert len(np.unique(labels)) == parts
    assert len(set(labels[:10].tolist())) == len(set(labels[10:].tolist())) == 1


@needs_solver
@pytest.mark.parametrize('seed', range(5))
def test_close_to_the_least_energy(seed):
    rng = np.random.default_rng(seed)
    features = np.repeat(rng.uniform(0, 2, (3, 2)), 4, axis=0) + rng.normal(0, 0.1, (12, 2))
    weights = rng.uniform(0.2, 0.4, 11)
    best, _ = best_chain(features, weights)
    labels = cut_pursuit(features, chain(12), weights)
    assert best <= energy(features, chain(12), weights, labels) + 1e-9 < 1.2 * best


@needs_solver
def test_parts_are_connected():
    features = np.zeros((4, 1))
    assert cut_pursuit(features, np.array([[0, 1], [2, 3]]), np.ones(2)).tolist() == [0, 0, 1, 1]
    assert cut_pursuit(features, np.zeros((0, 2), dtype=int), np.ones(0)).tolist() == [0, 1, 2, 3]


@needs_solver
def test_a_room_and_more_regularization():
    xyz, objects = make_room(density=300)
    cloud = PointCloud(xyz)
    descriptors = SuperpointGraph(k=30).compute(cloud)
    fine = CutPursuit(regularization=0.03).segment(cloud, descriptors)
    np.testing.assert_array_equal(fine.labels, CutPursuit(regularization=0.03).segment(cloud, descriptors).labels)
    purity = sum(np.bincount(objects[fine.points_of(r)]).max() for r in range(len(fine))) / len(xyz)
    assert purity > 0.9 and fine.sizes.min() >= 20
    coarse = CutPursuit(regularization=0.3).segment(cloud, descriptors)
    assert 5 < len(coarse) < len(fine)
    assert CutPursuit(min_region=1).segment(cloud, descriptors).sizes.min() < 20


@needs_solver
def test_coordinates_may_count():
    # One feature everywhere: nothing to cut, unless the coordinates are features too.
    xyz = np.concatenate([np.random.default_rng(0).uniform(0, 1, (200, 3)), [[50.0, 0, 0]] * 5])
    cloud = PointCloud(xyz)
    flat = described(np.ones((205, 2)))
    assert len(CutPursuit(neighbors=30, min_region=1).segment(cloud, flat)) == 1
    labels = CutPursuit(neighbors=30, min_region=1, xyz_weight=0.2).segment(cloud, flat).labels
    assert not set(labels[:200]) & set(labels[200:])


@needs_solver
def test_empty_single_duplicates_and_not_valid_points():
    for count in (0, 1, 30):
        cloud = PointCloud(np.zeros((count, 3)))
        rows = Descriptors(np.zeros((count, 4), dtype=np.float32), np.zeros(count, dtype=bool))
        assert CutPursuit().segment(cloud, rows).labels.tolist() == [0] * count


@needs_solver
def test_keeps_to_true_boundaries():
    grid = np.stack(np.meshgrid(np.arange(12.0), np.arange(12.0)), axis=-1).reshape(-1, 2)
    xyz = np.c_[grid, np.zeros(144)]
    objects = (grid[:, 0] > 5).astype(int)
    features = np.stack([objects, 1 - objects], axis=1) + np.random.default_rng(0).normal(0, 0.1, (144, 2))
    regions = CutPursuit(regularization=0.3).segment(PointCloud(xyz), described(features))
    assert slow_boundary(xyz, objects, regions.labels) == (1.0, 1.0)
    assert isinstance(regions, Regions) and len(regions) == 2
