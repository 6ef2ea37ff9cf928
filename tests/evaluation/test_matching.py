"""Scores of matching, by hand and against slow twins."""

import math

import numpy as np
import pytest

from rm3d_plugin.descriptors import cosine_similarity
from rm3d_plugin.evaluation.functional.matching import (
    feature_match_recall,
    inlier_ratio,
    most_similar,
    motion_rmse,
    same_object_auc,
)


def test_most_similar_is_the_largest_cosine():
    rng = np.random.default_rng(0)
    queries, rows = rng.normal(size=(40, 7)).astype(np.float32), rng.normal(size=(60, 7)).astype(np.float32)
    slow = [int(np.argmax([q @ r / np.linalg.norm(r) for r in rows.astype(float)])) for q in queries.astype(float)]
    np.testing.assert_array_equal(most_similar(queries, rows), slow)
    np.testing.assert_array_equal(most_similar(100 * queries, 0.01 * rows), slow)


def test_nearly_parallel_rows_are_told_apart():
    rows = np.float32([[1, 1e-4 * i, 0] for i in range(50)])  # cosines differ by 1e-8 and less
    np.testing.assert_array_equal(most_similar(rows, rows), np.arange(50))
    np.testing.assert_array_equal(most_similar(rows[:2], rows[[0, 0, 1, 1]]), [0, 2])
    with pytest.raises(ValueError, match='most_similar'):
        most_similar(rows, rows[:, :2])


def test_shares_by_hand():
    true = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]])
    found = true + [[0.1, 0, 0], [0, 0.11, 0], [0, 0, -0.05], [5, 0, 0]]
    assert inlier_ratio(found, true, 0.1) == 0.5
    assert inlier_ratio(found[:0], true[:0], 0.1) == 0
    assert feature_match_recall([0.05, 0.051, 1.0]) == pytest.approx(2 / 3)  # 5 % itself is not enough
    assert math.isnan(feature_match_recall([]))


def test_rmse_of_a_shift_and_of_a_half_turn():
    shift, half = np.eye(4), np.diag([-1.0, -1, 1, 1])
    shift[:3, 3] = (0, 3, 4)
    xyz = np.array([[1.0, 0, 0], [0, 2, 7]])
    assert motion_rmse(xyz, shift, np.eye(4)) == pytest.approx(5)
    assert motion_rmse(xyz, half, np.eye(4)) == pytest.approx(np.sqrt((4 + 16) / 2))


def test_region_auc_by_hand():
    values = np.array([[1.0, 0], [1, 0.1], [0, 1], [0.1, 1], [1, 1]])
    objects = np.array([0, 0, 1, 1, -1])
    edges = np.array([[0, 1], [2, 3], [1, 2], [0, 4]])
    assert same_object_auc(values, objects, edges) == 1.0
    assert same_object_auc(values[[0, 2, 1, 3, 4]], objects, edges) == 0.5
    assert math.isnan(same_object_auc(values, objects, edges[:2]))
    far = np.array([[0, 1], [0, 2], [1, 3], [2, 3]])
    cosine = cosine_similarity(values[far[:, 0]], values[far[:, 1]])
    same = objects[far[:, 0]] == objects[far[:, 1]]
    slow = np.mean([float(a > b) + 0.5 * (a == b) for a in cosine[same] for b in cosine[~same]])
    assert same_object_auc(values, objects, far) == slow
