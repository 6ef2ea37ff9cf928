import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import region_gaps as twin
from scipy.spatial import cKDTree

from rm3d_plugin.regions.graph import (
    RegionGaps,
    build_region_graph,
    keep_nearest,
    regions_within,
    touching_regions,
)
from rm3d_plugin.structures import Descriptors, PointCloud, Regions, SceneError


def as_dict(near):
    return dict(zip(map(tuple, near.pairs.tolist()), near.gaps.tolist(), strict=True))


def blobs(seed, regions=12, n=300):
    """Points around random centres, some of them discarded."""
    rng = np.random.default_rng(seed)
    centre = rng.uniform(0, 3, (regions, 3))
    owner = rng.integers(0, regions, n)
    xyz = (centre[owner] + rng.normal(0, 0.15, (n, 3))).astype(np.float32)
    return xyz, Regions(np.where(rng.uniform(size=n) < 0.1, -1, owner))


def squares(x, labels=None):
    """4 x 4 points of 0.1 m spacing at each offset x, one region each."""
    side = np.stack(np.meshgrid(np.arange(4), np.arange(4), [0]), axis=-1).reshape(-1, 3) * 0.1
    xyz = np.concatenate([side + [offset, 0.0, 0.0] for offset in x])
    cloud = PointCloud(xyz, normals=np.tile([0, 0, 1.0], (len(xyz), 1)), curvature=np.zeros(len(xyz)))
    regions = Regions(np.repeat(np.arange(len(x)) if labels is None else labels, 16))
    return cloud, Descriptors(np.ones((len(xyz), 2), dtype=np.float32), np.ones(len(xyz), dtype=bool)), regions


@settings(max_examples=25, deadline=None, derandomize=True)
@given(seed=st.integers(0, 1000), max_gap=st.sampled_from([0.02, 0.2, 0.5, 3.0]))
def test_gaps_equal_all_pairs_of_points(seed, max_gap):
    xyz, regions = blobs(seed)
    near = regions_within(xyz, regions, max_gap)
    expected = twin.gaps(xyz, regions.labels, max_gap)
    assert as_dict(near) == pytest.approx(expected)
    assert near.pairs.tolist() == sorted(map(list, expected))


@pytest.mark.parametrize('neighbors', [1, 2, 5, 100])
def test_each_region_keeps_its_nearest(neighbors):
    xyz, regions = blobs(7, regions=20)
    near = regions_within(xyz, regions, 1.0)
    expected = twin.keep_nearest(as_dict(near), neighbors)
    assert list(map(tuple, keep_nearest(near, len(regions), neighbors).tolist())) == expected


def test_an_edge_stays_if_either_end_keeps_it():
    near = RegionGaps(np.array([[0, 1], [0, 2], [0, 3], [1, 2]]), np.array([0.1, 0.1, 0.3, 0.2]))
    # 0 keeps 1 (tie: lower number), 1 keeps 0, 2 keeps 0, 3 keeps 0.
    assert keep_nearest(near, 4, 1).tolist() == [[0, 1], [0, 2], [0, 3]]
    assert keep_nearest(RegionGaps(np.zeros((0, 2), dtype=np.int64), np.zeros(0)), 4, 1).shape == (0, 2)


def test_touching_regions_equal_the_nearest_neighbours_of_scipy():
    xyz, regions = blobs(3)
    kept = regions.labels >= 0
    points, labels = xyz[kept].astype(float), regions.labels[kept]
    distance, index = cKDTree(points).query(points, 16)
    expected = {}
    for i, j, d in zip(np.repeat(labels, 16), labels[index.ravel()], distance.ravel(), strict=True):
        if i != j:
            pair = (int(min(i, j)), int(max(i, j)))
            expected[pair] = min(d, expected.get(pair, np.inf))
    assert as_dict(touching_regions(xyz, regions)) == pytest.approx(expected)


def test_graph_of_squares_in_a_row():
    """Squares of 0.3 m; gaps 0.1, 0.5 and 0.2 m."""
    cloud, descriptors, regions = squares([0.0, 0.4, 1.2, 1.7])
    assert build_region_graph(cloud, descriptors, regions, max_gap=0.3).edges.tolist() == [[0, 1], [2, 3]]
    graph = build_region_graph(cloud, descriptors, regions, max_gap=0.6)
    assert graph.edges.tolist() == [[0, 1], [1, 2], [2, 3]]
    assert graph.sizes.tolist() == [16] * 4
    np.testing.assert_allclose(graph.extents, np.tile([0.3, 0.3, 0.0], (4, 1)), atol=1e-6)
    touching = build_region_graph(cloud, descriptors, regions)
    assert [0, 1] in touching.edges.tolist()


def test_discarded_points_are_no_bridge():
    cloud, descriptors, _ = squares([0.0, 0.4, 0.8])
    regions = Regions(np.repeat([0, -1, 1], 16))
    assert build_region_graph(cloud, descriptors, regions, max_gap=0.3).edges.tolist() == []
    assert build_region_graph(cloud, descriptors, regions, max_gap=0.6).edges.tolist() == [[0, 1]]


@pytest.mark.parametrize('labels', [[], [-1, -1], [0], [0, 0]])
@pytest.mark.parametrize('max_gap', [None, 0.5])
def test_nothing_one_and_copies(labels, max_gap):
    n = len(labels)
    cloud = PointCloud(np.zeros((n, 3)), normals=np.zeros((n, 3)), curvature=np.zeros(n))
    descriptors = Descriptors(np.zeros((n, 2), dtype=np.float32), np.zeros(n, dtype=bool))
    graph = build_region_graph(cloud, descriptors, Regions(np.array(labels, dtype=np.int64)), max_gap=max_gap)
    assert len(graph) == len({label for label in labels if label >= 0})
    assert graph.edges.shape == (0, 2)


def test_wide_coordinates_and_far_outliers():
    xyz = np.array([[0, 0, 0], [0.1, 0, 0], [50000.0, 0, 0], [50000.1, 0, 0]])
    near = regions_within(xyz, Regions(np.arange(4)), 0.2)
    assert near.pairs.tolist() == [[0, 1], [2, 3]]


def test_wrong_input_is_named():
    cloud, descriptors, regions = squares([0.0, 0.4])
    with pytest.raises(ValueError, match='max_gap > 0 or None, got 8, 0'):
        build_region_graph(cloud, descriptors, regions, max_gap=0.0)
    with pytest.raises(SceneError, match='normals and .curvature are needed'):
        build_region_graph(PointCloud(cloud.xyz), descriptors, regions)
    with pytest.raises(ValueError, match='32 points, 32 descriptors, 16 labels'):
        build_region_graph(cloud, descriptors, Regions(np.zeros(16, dtype=np.int64)))
