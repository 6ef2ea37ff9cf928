"""What several steps share is what each would have found alone."""

import numpy as np
import pytest
from reference.neighbors_slow import slow_neighbors

from rm3d_plugin.ops import shared_octree
from rm3d_plugin.ops.normals import estimate_normals
from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.ops.shared_octree import nearest_of_each, octree_of, sharing_octree


def cloud(count=300):
    points = np.random.default_rng(0).uniform(0, 2, (count, 3)).astype(np.float32)
    points[-20:] = points[:20]  # ties
    return points


def gathered(points, k, chunk=64):
    indices, sq_dists = np.full((len(points), k), -7), np.zeros((len(points), k))
    for rows, near in nearest_of_each(points, k, chunk):
        indices[rows], sq_dists[rows] = near.indices, near.sq_dists
    return indices, sq_dists


@pytest.mark.parametrize('order', [(12, 5), (5, 12), (12, 12)])
def test_neighbours_are_the_same_shared_or_not(order):
    points = cloud()
    tree = Octree(points)
    with sharing_octree(points):
        for k in order:
            indices, sq_dists = gathered(points, k)
            want = tree.knn(points, k)
            np.testing.assert_array_equal(indices, want.indices)
            np.testing.assert_array_equal(sq_dists, want.sq_dists)
    slow = slow_neighbors(points, points, np.inf, 5)
    assert [set(row) for row in gathered(points, 5)[0]] == [set(map(int, members)) for members, _ in slow]


def test_fewer_points_than_neighbours():
    points = cloud(300)[:4]
    with sharing_octree(points):
        first, second = gathered(points, 9), gathered(points, 6)
    assert (first[0][:, 4:] == -1).all() and np.isinf(second[1][:, 4:]).all()
    np.testing.assert_array_equal(first[0][:, :6], second[0])


def test_only_this_very_array_shares(monkeypatch):
    points = cloud()
    with sharing_octree(points):
        assert octree_of(points) is octree_of(points) and octree_of(points.copy()) is not octree_of(points)
        want = estimate_normals(points, k=12, octree=Octree(points)).normals
        np.testing.assert_array_equal(estimate_normals(points, k=12).normals, want)
        monkeypatch.setattr(shared_octree.Octree, 'knn', None)  # nobody searches again
        np.testing.assert_array_equal(estimate_normals(points, k=12).normals, want)
    assert octree_of(points) is not octree_of(points)
