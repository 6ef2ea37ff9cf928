import numpy as np
import pytest

from rm3d_plugin.ops.segment import (
    majority_of_counts,
    scatter_rows,
    segment_majority,
    segment_mean,
    segment_mean_axis,
    segment_sizes,
    segment_sum,
    segment_values,
)


def test_sum_mean_and_sizes_leave_out_minus_one():
    values = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0], [100.0, 100.0]], dtype=np.float32)
    labels = np.array([0, 2, 0, -1])
    np.testing.assert_array_equal(segment_sum(values, labels, 3), [[6, 8], [0, 0], [3, 4]])
    np.testing.assert_array_equal(segment_mean(values, labels, 3), [[3, 4], [0, 0], [3, 4]])
    np.testing.assert_array_equal(segment_sizes(labels, 3), [2, 0, 1])


def test_sum_of_nothing():
    assert segment_sum(np.zeros((0, 4)), np.zeros(0, dtype=np.int64), 0).shape == (0, 4)
    assert segment_mean_axis(np.zeros((0, 3)), np.zeros(0, dtype=np.int64), 0).shape == (0, 3)
    assert segment_majority(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), 2).tolist() == [-1, -1]


def test_majority_ties_go_to_the_lower_value():
    values = np.array([7, 3, 3, 7, 5, -1, 2])
    labels = np.array([0, 0, 0, 0, 1, 1, -1])
    assert segment_majority(values, labels, 3).tolist() == [3, 5, -1]


def test_majority_ties_go_to_the_more_frequent_value_first():
    values = np.array([0, 1, 1, 2, 0, 2, 0, 0, 1])
    labels = np.array([0, 0, 1, 1, 2, 2, 3, 3, 3])
    assert segment_majority(values, labels, 5).tolist() == [0, 1, 0, 0, -1]
    assert segment_majority(values, labels, 5, np.array([5, 9, 9])).tolist() == [1, 1, 2, 0, -1]
    with pytest.raises(ValueError, match='frequency of 2 values, but there is 2'):
        segment_majority(values, labels, 5, np.array([5, 9]))


def test_counted_classes_have_the_same_majority():
    rng = np.random.default_rng(0)
    values, labels, frequency = rng.integers(-1, 4, 300), rng.integers(-1, 60, 300), np.array([3, 8, 8, 1])
    used = (values >= 0) & (labels >= 0)
    counts = np.bincount(labels[used] * 4 + values[used], minlength=61 * 4).reshape(61, 4)
    found = majority_of_counts(counts, frequency)
    np.testing.assert_array_equal(found.classes, segment_majority(values, labels, 61, frequency))
    assert (np.sort(counts, axis=1)[:, -1] == np.sort(counts, axis=1)[:, -2])[counts.any(axis=1)].sum() > 5  # ties
    np.testing.assert_allclose(found.share, counts.max(axis=1) / np.maximum(counts.sum(axis=1), 1))
    assert found.classes[60] == -1 and found.share[60] == 0


def test_scatter_and_back():
    rows = np.array([[1.0, 2.0], [3.0, 4.0]], dtype=np.float32)
    out = scatter_rows(rows, np.array([2, 0]), 3, np.nan)
    np.testing.assert_array_equal(out, np.float32([[3, 4], [np.nan, np.nan], [1, 2]]))
    assert (
        out.dtype == np.float32 and scatter_rows(rows[:0], np.zeros(0, dtype=np.int64), 2, 0).tolist() == [[0, 0]] * 2
    )
    labels = np.array([1, -1, 0, 1])
    assert segment_values(np.array([5, 6]), labels, -1).tolist() == [6, -1, 5, 6]
    np.testing.assert_array_equal(segment_values(rows, labels, 0.0)[:, 0], [3, 0, 1, 3])
    assert segment_values(np.array([True]), np.array([0, -1]), False).tolist() == [True, False]


def test_mean_axis_does_not_depend_on_signs():
    rng = np.random.default_rng(0)
    normals = np.array([0.0, 0.6, 0.8]) + rng.normal(0, 0.1, (50, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    labels = np.zeros(50, dtype=np.int64)
    mean = normals.sum(axis=0) / np.linalg.norm(normals.sum(axis=0))
    np.testing.assert_allclose(segment_mean_axis(normals, labels, 1)[0], mean, atol=1e-12)
    signs = rng.choice([-1.0, 1.0], (50, 1))
    flipped = segment_mean_axis(normals * signs, labels, 1)[0]
    np.testing.assert_allclose(flipped, mean * signs[0, 0], atol=1e-12)


def test_mean_axis_passes_over_unknown_normals():
    normals = np.array([[0, 0, 0], [0, 0, -1.0], [0, 0, 1.0], [0, 0, 0]])
    axes = segment_mean_axis(normals, np.array([0, 0, 0, 1]), 2)
    np.testing.assert_allclose(axes, [[0, 0, -1], [0, 0, 0]])


def test_wrong_labels_are_named():
    with pytest.raises(ValueError, match=r'expected -1..1, got 0..2'):
        segment_sum(np.zeros((2, 1)), np.array([0, 2]), 2)
    with pytest.raises(ValueError, match='one a row'):
        segment_sum(np.zeros((2, 1)), np.array([0]), 2)
