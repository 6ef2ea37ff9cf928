"""Neighbour search: equal to looking at every point and to scipy, whatever the cloud, the rules and the threads."""

import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.neighbors_slow import slow_neighbors
from scipy.spatial import cKDTree

from rm3d_plugin.ops.octree import Knn, Neighbors, Octree


def rows_of(found: Neighbors) -> list[tuple[np.ndarray, np.ndarray]]:
    spans = zip(found.offsets[:-1], found.offsets[1:], strict=True)
    return [(found.indices[a:b], found.sq_dists[a:b]) for a, b in spans]


def assert_rows(found: Neighbors, expected: list[tuple[np.ndarray, np.ndarray]]) -> None:
    assert found.indices.dtype == np.int32 and found.offsets.dtype == np.int64
    assert len(found) == len(expected)
    for (indices, squares), (want, want_squares) in zip(rows_of(found), expected, strict=True):
        np.testing.assert_array_equal(indices, want)
        np.testing.assert_array_equal(squares, want_squares)


def assert_knn(found: Knn, expected: list[tuple[np.ndarray, np.ndarray]], k: int) -> None:
    assert found.indices.shape == found.sq_dists.shape == (len(expected), k)
    for indices, squares, (want, want_squares) in zip(found.indices, found.sq_dists, expected, strict=True):
        n = len(want)
        np.testing.assert_array_equal(indices[:n], want)
        np.testing.assert_array_equal(squares[:n], want_squares)
        assert (indices[n:] == -1).all() and np.isinf(squares[n:]).all()


def clouds() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(3)
    uniform = rng.random((900, 3))
    plane = uniform * [1, 1, 0]
    return {
        'uniform': uniform,
        'float32': uniform.astype(np.float32),
        'plane': plane,
        'collinear': uniform * [0, 1, 0],
        'grid': np.stack(np.meshgrid(*[np.arange(9.0)] * 3), axis=-1).reshape(-1, 3) / 8,
        'duplicates': np.repeat(uniform[:30], 30, axis=0),
        'one place': np.repeat(uniform[:1], 70, axis=0),
        'two clusters a thousand kilometres apart': np.concatenate([uniform[:450], uniform[450:] + [1e6, -1e6, 1e6]]),
        'far from the origin': uniform + 1e6,
        'one point': uniform[:1],
        'two points': uniform[:2],
    }


@pytest.mark.parametrize('name', clouds())
def test_radius_hybrid_and_knn_equal_an_exhaustive_search(name):
    points = clouds()[name]
    rng = np.random.default_rng(0)
    queries = np.concatenate([points[::7], points[:50] + rng.normal(0, 0.1, (min(len(points), 50), 3))])
    tree = Octree(points, leaf_size=4)
    for radius in (0.0, 0.125, 0.25, 3.0):
        assert_rows(tree.radius(queries, radius), slow_neighbors(points, queries, radius))
        assert_rows(tree.radius(queries, radius, max_neighbors=7), slow_neighbors(points, queries, radius, 7))
    for k in (1, 5, 100):
        assert_knn(tree.knn(queries, k), slow_neighbors(points, queries, k=k), k)


@pytest.mark.parametrize('name', ['uniform', 'plane', 'duplicates', 'far from the origin', 'grid'])
def test_equals_scipy(name):
    points = clouds()[name]
    found = Octree(points).radius(points, 0.2)
    expected = cKDTree(points).query_ball_point(points, 0.2, return_sorted=True)
    for (indices, _), want in zip(rows_of(found), expected, strict=True):
        assert sorted(indices.tolist()) == want


def test_centimetres_over_a_thousand_kilometres():
    """Pairs 1 cm apart, each pair hundreds of kilometres from the next."""
    base = np.array([[0.0, 0.0, 0.0], [1e6, 0.0, 0.0], [1e6, 1e6, 300.0], [-1e6, 5e5, -20.0]])
    points = np.concatenate([base, base + [0.01, 0.0, 0.0]])
    found = Octree(points, leaf_size=1).radius(points, 0.011)
    assert [sorted(row.tolist()) for row, _ in rows_of(found)] == [[i % 4, i % 4 + 4] for i in range(8)]
    assert Octree(points).radius(points, 0.009).counts.tolist() == [1] * 8


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    st.integers(1, 60),
    st.integers(1, 8),
    st.floats(0, 4),
    st.tuples(st.booleans(), st.booleans(), st.booleans()),
    st.integers(0, 2**31),
)
def test_any_rules_and_leaf_size_give_the_same(count, leaf_size, radius, rules, seed):
    """Coordinates on a coarse grid, so that ties and points exactly on the ball are common."""
    points = np.random.default_rng(seed).integers(-4, 5, (count, 3)) / 2
    skip, stop, take = rules
    tree = Octree(points, leaf_size, skip_disjoint=skip, stop_inside=stop, take_contained=take)
    queries = np.concatenate([points, points + 0.25])
    assert_rows(tree.radius(queries, radius), slow_neighbors(points, queries, radius))
    assert_rows(tree.radius(queries, radius, 3), slow_neighbors(points, queries, radius, 3))


def test_visited_octants_fall_with_each_rule():
    points = np.random.default_rng(0).random((4000, 3))
    off = dict.fromkeys(('skip_disjoint', 'stop_inside', 'take_contained'), False)

    def visits(radius, **rules):
        return Octree(points, 8, **{**off, **rules}).radius(points[::10], radius).visits

    plain = visits(0.02)
    assert plain == 400 * len(Octree(points, 8)._tree[2])  # without a rule every octant is looked at
    assert visits(0.02, skip_disjoint=True) < 0.2 * plain
    assert visits(0.02, stop_inside=True) < 0.5 * plain
    assert visits(0.02, skip_disjoint=True, stop_inside=True) < visits(0.02, skip_disjoint=True)
    assert visits(0.6, take_contained=True) < 0.8 * plain
    assert visits(0.6, skip_disjoint=True, take_contained=True) < visits(0.6, skip_disjoint=True)


def test_a_radius_for_each_query():
    points = np.random.default_rng(1).random((500, 3))
    radii = np.linspace(0, 0.3, 500)
    tree = Octree(points)
    assert_rows(tree.radius(points, radii), slow_neighbors(points, points, radii))
    assert_rows(tree.hybrid(points, radii, 4), slow_neighbors(points, points, radii, 4))
    with pytest.raises(ValueError, match='500 .one a query., got shape .3'):
        tree.radius(points, radii[:3])


def test_unordered_rows_hold_the_same_points():
    points = np.random.default_rng(1).random((2000, 3))
    tree = Octree(points)
    ordered, free = tree.radius(points, 0.2), tree.radius(points, 0.2, ordered=False)
    np.testing.assert_array_equal(ordered.offsets, free.offsets)
    for (want, _), (indices, squares) in zip(rows_of(ordered), rows_of(free), strict=True):
        np.testing.assert_array_equal(np.sort(want), np.sort(indices))
        np.testing.assert_allclose(squares, ((points[indices] - points[want[0]]) ** 2).sum(axis=1), atol=1e-15)


def test_queries_come_back_in_their_order_over_several_blocks():
    points = np.random.default_rng(1).random((10_000, 3))
    tree = Octree(points)
    found = tree.knn(points, 1)  # the tree's own array: answered without sorting it again
    np.testing.assert_array_equal(found.indices[:, 0], np.arange(10_000))
    np.testing.assert_array_equal(tree.knn(points[::-1], 1).indices[:, 0], np.arange(10_000)[::-1])
    assert_rows(tree.radius(points, 0.0), [(np.array([i]), np.zeros(1)) for i in range(10_000)])


def test_nothing_to_find():
    empty = np.zeros((0, 3))
    tree = Octree(empty)
    assert len(tree) == 0
    assert tree.radius(np.ones((2, 3)), 1.0).offsets.tolist() == [0, 0, 0]
    assert tree.knn(np.ones((2, 3)), 3).indices.tolist() == [[-1] * 3] * 2
    assert tree.hybrid(empty, 1.0, 3).offsets.tolist() == [0]
    assert Octree(np.ones((4, 3))).radius(empty, 1.0).offsets.tolist() == [0]
    assert Octree(np.ones((4, 3))).knn(empty, 2).indices.shape == (0, 2)
    assert Octree(np.zeros((4, 3))).radius(np.array([[50.0, 0, 0]]), 1.0).offsets.tolist() == [0, 0]


@pytest.mark.parametrize(
    ('call', 'message'),
    [
        (lambda: Octree(np.zeros((4, 2))), r'points: expected shape \(N, 3\), got \(4, 2\)'),
        (lambda: Octree(np.array([[0, 0, np.nan]])), 'points: 1 of 1 rows are NaN'),
        (lambda: Octree(np.zeros((4, 3)), leaf_size=0), 'leaf_size: expected at least 1, got 0'),
        (lambda: Octree(np.zeros((4, 3))).radius(np.full((2, 3), np.inf), 1.0), 'queries: 2 of 2'),
        (lambda: Octree(np.zeros((4, 3))).radius(np.zeros((2, 3)), -1.0), 'a radius in metres, got -1'),
        (lambda: Octree(np.zeros((4, 3))).radius(np.zeros((2, 3)), np.nan), 'a radius in metres, got nan'),
        (lambda: Octree(np.zeros((4, 3))).radius(np.zeros((2, 3)), 1.0, 0), 'max_neighbors: expected at least 1'),
        (lambda: Octree(np.zeros((4, 3))).knn(np.zeros((2, 3)), 0), 'k: expected at least 1'),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_threads_change_nothing():
    """The same digest from processes with one thread and with three."""
    code = (
        'import hashlib, numpy as np\n'
        'from rm3d_plugin.ops.octree import Octree\n'
        'p = np.random.default_rng(0).random((9000, 3)); t = Octree(p)\n'
        'a, b, c = t.radius(p, .06, ordered=False), t.hybrid(p, .1, 9), t.knn(p, 8)\n'
        'parts = [a.indices, a.offsets, a.sq_dists, b.indices, b.offsets, c.indices, c.sq_dists]\n'
        "print(hashlib.sha256(b''.join(x.tobytes() for x in parts)).hexdigest(), a.visits, c.visits)"
    )

    def digest(threads):
        environment = {**os.environ, 'NUMBA_NUM_THREADS': str(threads)}
        return subprocess.run(
            [sys.executable, '-c', code], env=environment, capture_output=True, text=True, check=True
        ).stdout

    assert digest(1) == digest(3)


def test_around_meets_every_point_once_along_the_curve():
    points = np.random.default_rng(2).random((3000, 3))
    tree = Octree(points)
    for cap in (None, 5):
        expected = slow_neighbors(points, points, 0.1, cap)
        met = []
        for members, found in tree.around(0.1, cap, chunk=700):
            assert_rows(found, [expected[i] for i in members])
            met.append(members)
        np.testing.assert_array_equal(np.concatenate(met), tree.order)
    assert list(Octree(points[:0]).around(0.1)) == []


def test_groups_and_lone_queries_agree_where_density_changes():
    """A dense clump, a sparse halo and one far point: groups split, guesses fail, rows of hundreds are sorted."""
    rng = np.random.default_rng(5)
    points = np.concatenate([rng.normal(0, 0.01, (1500, 3)), rng.normal(0, 3.0, (500, 3)), [[500.0, 0, 0]]])
    tree, alone = Octree(points), Octree(points, group=False)
    for radius in (0.005, 0.03, 2.0):
        together, lone = tree.radius(points, radius), alone.radius(points, radius)
        np.testing.assert_array_equal(together.indices, lone.indices)
        np.testing.assert_array_equal(together.sq_dists, lone.sq_dists)
        assert together.visits < lone.visits
    assert_knn(tree.knn(points, 40), slow_neighbors(points, points, k=40), 40)
    radii = rng.random(len(points)) * 2
    assert_rows(tree.hybrid(points, radii, 20), slow_neighbors(points, points, radii, 20))


def test_many_queries_are_counted_before_they_are_written(monkeypatch):
    points = np.random.default_rng(6).random((2000, 3))
    want = Octree(points).radius(points, 0.15)
    monkeypatch.setattr('rm3d_plugin.ops.octree.HELD', 100)
    found = Octree(points).radius(points, 0.15)
    np.testing.assert_array_equal(found.offsets, want.offsets)
    np.testing.assert_array_equal(found.indices, want.indices)


def tree_of(points: np.ndarray, leaf_size: int = 4) -> tuple[np.ndarray, ...]:
    tree = Octree(points, leaf_size)
    return tuple(np.array(part) for part in tree._tree)


@pytest.mark.parametrize('name', clouds())
def test_parts_of_the_tree_hang_together(name, monkeypatch):
    """A tree built in many parts has the octants of one built whole; their numbers depend on no thread."""
    points = clouds()[name]
    if not len(points):
        return
    columns, order, nodes, boxes, cubes = tree_of(points)
    monkeypatch.setattr('rm3d_plugin.ops._octree_build.PART', 16)
    parts = []
    for threads in (1, 2):
        monkeypatch.setattr('numba.config.NUMBA_NUM_THREADS', threads)
        parts.append(tree_of(points))
    for one, two in zip(*parts, strict=True):
        np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(parts[0][0], columns)
    np.testing.assert_array_equal(parts[0][1], order)

    def rows(nodes, boxes, cubes):
        table = np.c_[nodes[:, [0, 1, 3, 4]], boxes, cubes]
        return table[np.lexsort(table.T[::-1])]

    np.testing.assert_array_equal(rows(*parts[0][2:]), rows(nodes, boxes, cubes))
    for _, _, found, _, _ in parts:
        for node, (start, stop, first, children, _) in enumerate(found):
            if children:
                below = found[first : first + children]
                assert first > node and below[0, 0] == start and below[-1, 1] == stop
                np.testing.assert_array_equal(below[1:, 0], below[:-1, 1])


def test_building_is_the_same_for_any_number_of_threads(monkeypatch):
    """More points than a block of each stage holds, of few different codes and of many."""
    rng = np.random.default_rng(8)
    for points in (rng.random((150_000, 3)), rng.integers(0, 6, (150_000, 3)).astype(np.float32)):
        trees = []
        for threads in (1, 3):
            monkeypatch.setattr('numba.config.NUMBA_NUM_THREADS', threads)
            trees.append(tree_of(points, 32))
        for one, other in zip(*trees, strict=True):
            np.testing.assert_array_equal(one, other)
