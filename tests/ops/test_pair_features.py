"""Pair histograms against the plain double loop, and cases worked by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.pair_features_slow import slow_histogram

from rm3d_plugin.ops.octree import Neighbors, Octree
from rm3d_plugin.ops.pair_features import pair_histograms


def directions(rng, count):
    normals = rng.normal(size=(count, 3))
    return (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)


def one_neighborhood(count):
    return Neighbors(np.arange(count, dtype=np.int32), np.array([0, count]), np.zeros(count))


def only_bin(points, normals):
    result = pair_histograms(np.float32(points), np.float32(normals), one_neighborhood(len(points)))
    (index,) = np.flatnonzero(result.values[0])
    return index % 5, index // 5 % 5, index // 25


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(3, 45), st.sampled_from([None, 0.7, 2.0]), st.integers(0, 9999), st.sampled_from([0.01, 1.0, 50.0]))
def test_equals_the_double_loop(count, span, seed, scale):
    rng = np.random.default_rng(seed)
    points = (scale * rng.random((count, 3))).astype(np.float32)
    normals = directions(rng, count)
    spans = None if span is None else np.array([scale * span])
    got = pair_histograms(points, normals, one_neighborhood(count), spans)
    want = slow_histogram(points, normals, None if span is None else scale * span)
    assert got.values.dtype == np.float32 and got.values.shape == (1, 125 if span is None else 625)
    assert got.pairs[0] == want.pairs == count * (count - 1) // 2
    moved = np.abs(got.values[0] - want.values).sum() / 2 * want.pairs
    assert moved <= want.doubtful + 1e-3
    assert want.doubtful <= max(2, 0.01 * want.pairs)


def test_exact_without_doubtful_pairs():
    """Ten clouds in which no pair is near an edge agree to the last pair."""
    rng = np.random.default_rng(5)
    agreed = 0
    while agreed < 10:
        points, normals = rng.random((20, 3)).astype(np.float32), directions(rng, 20)
        want = slow_histogram(points, normals)
        if want.doubtful == 0:
            got = pair_histograms(points, normals, one_neighborhood(20))
            np.testing.assert_array_equal(np.rint(got.values[0] * got.pairs[0]), np.rint(want.values * want.pairs))
            agreed += 1


def test_bins_worked_by_hand():
    s, c = np.sin(np.pi / 4), np.cos(np.pi / 4)
    line = [[0, 0, 0], [1, 0, 0], [2, 0, 0]]
    up = [[0, 0, 1]] * 3
    assert only_bin(line, up) == (2, 2, 2)  # theta = alpha = phi = 0
    assert only_bin(line, [[c, 0, s]] * 3) == (2, 2, 4)  # phi = cos 45 deg, the first point is the source
    assert only_bin([[0, 0, 0], [-1, 0, 0], [-2, 0, 0]], [[c, 0, s]] * 3) == (2, 2, 0)  # phi = -cos 45 deg
    # u = z, d = x, so v = d x u = -y and w = u x v = x; the triple of pairs is told apart by the two normals.
    two = [[0, 0, 0], [1, 0, 0], [1, 0, 0]]  # the pair of the two equal points has no feature
    assert only_bin(two, [[0, 0, 1], [0, 1, 0], [0, 1, 0]])[1] == 0  # alpha = v.n_t = -1
    assert only_bin(two, [[0, 0, 1], [0, -1, 0], [0, -1, 0]])[1] == 4  # alpha = 1
    assert only_bin(two, [[0, 0, 1], [0, s, c], [0, s, c]])[1] == 0  # alpha = -.707
    assert only_bin(two, [[0, 0.6, 0.8], [0, 0.6, 0.8], [0, 0.6, 0.8]]) == (2, 2, 2)
    # Source is the second point (its normal leans to the line): d = -x, u = (-.8, 0, .6), phi = .8;
    # v = d x u / |.| = y, w = u x v = (-.6, 0, -.8); n_t = z: theta = atan2(-.8, .6) = -53 deg.
    assert only_bin(two, [[0, 0, 1], [-0.8, 0, 0.6], [-0.8, 0, 0.6]]) == (1, 2, 4)
    assert only_bin(two, [[0, 0, 1], [0.8, 0, 0.6], [0.8, 0, 0.6]]) == (3, 2, 0)


def test_distance_bins_worked_by_hand():
    """Three points on a line at 0, 1 and 3 m: distances 1, 2, 3 of a span of 5 m fall to bins 1, 2, 3."""
    points = np.float32([[0, 0, 0], [1, 0, 0], [3, 0, 0]])
    normals = np.float32([[0, 0, 1]] * 3)
    for span, bins in ((5.0, [1, 2, 3]), (2.0, [2, 4, 4]), (100.0, [0, 0, 0])):
        got = pair_histograms(points, normals, one_neighborhood(3), np.array([span]))
        want = np.bincount(np.array(bins) * 125 + 62, minlength=625) / 3
        np.testing.assert_allclose(got.values[0], want, atol=1e-7)


def test_pairs_without_a_frame_are_left_out():
    up = [0, 0, 1]
    stacked = pair_histograms(  # one line along the normals, one point beside it
        np.float32([[0, 0, 0], [0, 0, 1], [1, 0, 0]]), np.float32([up] * 3), one_neighborhood(3)
    )
    assert stacked.pairs.tolist() == [2] and stacked.valid[0]
    assert stacked.values.sum() == pytest.approx(1)
    same = pair_histograms(np.zeros((5, 3), dtype=np.float32), np.float32([up] * 5), one_neighborhood(5))
    assert same.pairs.tolist() == [0] and not same.valid[0] and not same.values.any()


def test_points_without_a_normal_are_left_out():
    rng = np.random.default_rng(0)
    points, normals = rng.random((30, 3)).astype(np.float32), directions(rng, 30)
    holed = normals.copy()
    holed[3], holed[7] = 0, np.nan
    kept = np.delete(np.arange(30), [3, 7])
    got = pair_histograms(points, holed, one_neighborhood(30))
    want = pair_histograms(points[kept], normals[kept], one_neighborhood(28))
    np.testing.assert_array_equal(got.values, want.values)
    assert got.pairs.tolist() == [28 * 27 // 2]


def test_rows_of_many_sizes_over_several_blocks():
    rng = np.random.default_rng(0)
    points, normals = rng.random((1300, 3)).astype(np.float32), directions(rng, 1300)
    found = Octree(points).radius(points, 0.12)
    assert found.counts.min() < 3 < 16 < found.counts.max()
    got = pair_histograms(points, normals, found)
    np.testing.assert_array_equal(got.valid, found.counts >= 3)
    for row in range(0, 1300, 60):
        members = found.indices[found.offsets[row] : found.offsets[row + 1]]
        want = slow_histogram(points[members], normals[members])
        if len(members) >= 3:
            assert np.abs(got.values[row] - want.values).sum() / 2 * want.pairs <= want.doubtful + 1e-3
        else:
            assert not got.values[row].any() and got.pairs[row] == 0


def test_wide_float64_points_lose_nothing():
    rng = np.random.default_rng(2)
    points, normals = rng.integers(0, 1 << 20, (20, 3)) / (1 << 20), directions(rng, 20)
    near = pair_histograms(points, normals, one_neighborhood(20))
    far = pair_histograms(points + 4e6, normals, one_neighborhood(20))
    assert np.abs(near.values - far.values).max() <= 1.001 / near.pairs[0]


def test_empty_and_bad_input():
    none = Neighbors(np.zeros(0, dtype=np.int32), np.zeros(1, dtype=np.int64), np.zeros(0))
    assert pair_histograms(np.zeros((0, 3)), np.zeros((0, 3)), none).values.shape == (0, 125)
    with pytest.raises(ValueError, match='expected both'):
        pair_histograms(np.zeros((4, 3)), np.zeros((5, 3)), none)
    with pytest.raises(ValueError, match=r'spans: expected shape \(1,\)'):
        pair_histograms(np.zeros((4, 3)), np.zeros((4, 3)), one_neighborhood(4), np.ones(3))
