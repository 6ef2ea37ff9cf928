import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.clustering_slow import slow_clusters, slow_mask_nms

from rm3d_plugin.ops.clustering import ball_clusters, cluster_masks, mask_iou, mask_nms, masks_of


def blob(center, count, radius, seed):
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return np.asarray(center) + direction * radius * rng.random((count, 1))


def test_blobs_5_cm_apart_separate_at_3_cm_and_join_at_6_cm():
    left, right = blob((0, 0, 0), 200, 0.01, 0), blob((0.07, 0, 0), 150, 0.01, 1)  # 5 cm between their surfaces
    points = np.concatenate([left, right])
    assert ball_clusters(points, 0.03).tolist() == [0] * 200 + [1] * 150
    assert ball_clusters(points, 0.061).tolist() == [0] * 350
    assert ball_clusters(points, 0.03, min_points=151).tolist() == [0] * 200 + [-1] * 150
    assert ball_clusters(points, 0.03, min_points=201).tolist() == [-1] * 350


def test_no_point_one_point_and_duplicates():
    assert ball_clusters(np.zeros((0, 3)), 0.1).shape == (0,)
    assert ball_clusters(np.zeros((1, 3)), 0.1).tolist() == [0]
    assert ball_clusters(np.zeros((1, 3)), 0.1, min_points=2).tolist() == [-1]
    assert ball_clusters(np.repeat([[5.0, 0, 0], [1, 1, 1]], 50, axis=0), 0.1).tolist() == [0] * 50 + [1] * 50


def test_the_radius_is_inclusive_and_exact():
    assert ball_clusters(np.array([[0.0, 0, 0], [0.25, 0, 0]]), 0.25).tolist() == [0, 0]
    assert ball_clusters(np.array([[0.0, 0, 0], [0.25, 0, 0]]), np.nextafter(0.25, 0)).tolist() == [0, 1]


def test_groups_do_not_connect_and_negative_ones_take_no_part():
    line = np.c_[np.arange(6) * 0.1, np.zeros((6, 2))]
    groups = np.array([2, 2, 0, -1, 0, 0])
    assert ball_clusters(line, 0.11, groups).tolist() == [0, 0, 1, -1, 2, 2]
    assert ball_clusters(line, 0.11, np.full(6, -1)).tolist() == [-1] * 6
    assert ball_clusters(line, 0.11, np.full(6, 7)).tolist() == [0] * 6


@settings(derandomize=True, deadline=None, max_examples=60)
@given(seed=st.integers(0, 10**6), count=st.integers(0, 120), radius=st.floats(0.02, 0.6), far=st.booleans())
def test_equals_a_search_over_all_pairs(seed, count, radius, far):
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 1, (count, 3)) * rng.choice([1.0, 1.0, 0.0], 3) + 1e5 * far
    if count:
        points[:: max(1, count // 5)] = points[0]  # duplicates
    if seed % 2:
        points = np.round(points, 1)  # distances that equal the radius
    groups = rng.integers(-1, 3, count)
    least = int(rng.integers(1, 4))
    assert (
        ball_clusters(points, radius, groups, least).tolist() == slow_clusters(points, radius, groups, least).tolist()
    )


def test_permuting_points_permutes_the_clusters():
    rng = np.random.default_rng(3)
    points, order = rng.uniform(0, 1, (500, 3)), rng.permutation(500)
    plain, shuffled = ball_clusters(points, 0.08), ball_clusters(points[order], 0.08)
    pairs = set(zip(plain[order].tolist(), shuffled.tolist(), strict=True))
    assert len(pairs) == len(np.unique(plain)) == len(np.unique(shuffled)) > 3


def test_bad_input_is_told():
    with pytest.raises(ValueError, match='1 of 2 rows are NaN'):
        ball_clusters(np.array([[0.0, 0, 0], [np.nan, 0, 0]]), 0.1)
    with pytest.raises(ValueError, match='radius: expected metres > 0'):
        ball_clusters(np.zeros((2, 3)), 0.0)
    with pytest.raises(ValueError, match='too small for a cloud'):
        ball_clusters(np.array([[0.0, 0, 0], [1e9, 1e9, 1e9]]), 0.01)
    with pytest.raises(ValueError, match='groups: expected shape'):
        ball_clusters(np.zeros((2, 3)), 0.1, np.zeros(3, dtype=int))


@pytest.mark.parametrize('kind', ['room', 'collapsed', 'sparse'])
def test_100k_points_take_well_under_a_second(kind):
    rng = np.random.default_rng(0)
    if kind == 'room':
        points = rng.uniform(0, 1, (100_000, 3)) * [5.0, 4.0, 0.01]
    elif kind == 'collapsed':  # what perfect offsets make of objects
        points = rng.uniform(0, 5, (20, 3))[rng.integers(0, 20, 100_000)] + rng.normal(0, 0.01, (100_000, 3))
    else:
        points = rng.uniform(0, 1, (100_000, 3)) * [8.0, 8.0, 3.0]
    groups = rng.integers(0, 3, len(points)) if kind == 'room' else None
    ball_clusters(points[:100], 0.03, groups if groups is None else groups[:100])
    start = time.thread_time()
    ball_clusters(points, 0.03, groups, 50)
    assert time.thread_time() - start < 1.0


def test_masks_of_clusters():
    masks = cluster_masks(np.array([1, -1, 0, 1, 0]))
    assert (masks.indices.tolist(), masks.offsets.tolist()) == ([2, 4, 0, 3], [0, 2, 4])
    assert cluster_masks(np.array([-1, -1])).offsets.tolist() == [0]
    assert cluster_masks(np.zeros(0, dtype=int)).sizes.tolist() == []


def test_mask_overlap_by_hand():
    masks = masks_of([np.array([0, 1, 2]), np.array([2, 3]), np.array([7])])
    assert mask_iou(masks, 8).tolist() == [[1.0, 0.25, 0.0], [0.25, 1.0, 0.0], [0.0, 0.0, 1.0]]


def test_mask_nms_by_hand():
    masks = masks_of([np.arange(0, 10), np.arange(5, 15), np.arange(0, 9), np.arange(20, 22)])
    assert mask_nms(masks, np.array([0.5, 0.9, 0.5, 0.1]), 30, 0.3).tolist() == [1, 2, 3]  # 5 of 15 > .3; 4 of 15
    assert mask_nms(masks, np.array([0.5, 0.5, 0.5, 0.5]), 30, 0.3).tolist() == [0, 3]  # ties to the first
    assert mask_nms(masks, np.array([0.5, 0.9, 0.5, 0.1]), 30, 1 / 3).tolist() == [1, 0, 3]  # exactly: not too much
    assert mask_nms(masks_of([]), np.zeros(0), 30, 0.3).tolist() == []


@settings(derandomize=True, deadline=None, max_examples=40)
@given(seed=st.integers(0, 10**6), count=st.integers(0, 12))
def test_mask_nms_equals_sets(seed, count):
    rng = np.random.default_rng(seed)
    sets = [set(np.flatnonzero(rng.random(20) < rng.uniform(0.1, 0.6)).tolist()) for _ in range(count)]
    scores = rng.integers(0, 4, count) / 4
    masks = masks_of([np.array(sorted(s), dtype=np.int64) for s in sets])
    assert mask_nms(masks, scores, 20, 0.3).tolist() == slow_mask_nms(sets, scores, 0.3)
