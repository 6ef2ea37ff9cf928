import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.chunks_slow import stitch_slow

from rm3d_plugin.models.segmentors.stitching import ChunkInstances, stitch_instances


def chunk(rows, *instances):
    """Instances as (points of the scene, class, score)."""
    rows = np.array(rows, dtype=np.int64)
    masks = np.array([np.isin(rows, points) for points, _, _ in instances], dtype=bool).reshape(-1, len(rows))
    labels = np.array([label for _, label, _ in instances], dtype=np.int64)
    return ChunkInstances(rows, masks, labels, np.array([score for _, _, score in instances], dtype=np.float32))


def listed(found):
    masks = found.masks
    points = [masks.indices[a:b].tolist() for a, b in zip(masks.offsets[:-1], masks.offsets[1:], strict=True)]
    return list(zip(points, found.labels.tolist(), found.scores.tolist(), strict=True))


def test_by_hand():
    left = chunk(range(0, 6), ([0, 1], 1, 0.5), ([2, 3, 4, 5], 2, 0.9), ([4, 5], 3, 0.2))
    right = chunk(range(4, 10), ([4, 5, 6, 7, 8, 9], 2, 0.6), ([4, 5], 1, 0.3))
    found = listed(stitch_instances([left, right], 10, 0.5))
    assert [(points, label) for points, label, _ in found] == [
        ([0, 1], 1),
        ([2, 3, 4, 5, 6, 7, 8, 9], 2),
        ([4, 5], 3),
        ([4, 5], 1),  # of another class than what lies there too
    ]
    assert [score for _, _, score in found] == pytest.approx([0.5, (4 * 0.9 + 6 * 0.6) / 10, 0.2, 0.3])


def test_what_touches_a_little_stays_apart():
    left, right = chunk(range(0, 8), ([2, 3, 4], 1, 1.0)), chunk(range(4, 12), ([4, 5, 6, 7], 1, 1.0))
    assert len(listed(stitch_instances([left, right], 12, 0.5))) == 2  # 1 of 4 points in the shared zone
    assert len(listed(stitch_instances([left, right], 12, 0.25))) == 1


def test_a_row_of_chunks_is_one_instance_and_nothing_is_nothing():
    row = [chunk(range(3 * k, 3 * k + 6), (list(range(3 * k, 3 * k + 6)), 0, 1.0)) for k in range(5)]
    ((points, label, score),) = listed(stitch_instances(row, 18, 1.0))
    assert points == list(range(18)) and (label, score) == (0, 1.0)
    assert listed(stitch_instances([], 5, 0.5)) == listed(stitch_instances([chunk([0, 1]), chunk([1])], 2, 0.5)) == []
    apart = [chunk([0, 1], ([0, 1], 0, 1.0)), chunk([2], ([2], 0, 1.0))]
    assert len(listed(stitch_instances(apart, 3, 0.5))) == 2


@given(st.integers(0, 10**6), st.sampled_from([0.2, 0.5, 0.8]))
@settings(derandomize=True, max_examples=50, deadline=None)
def test_stitching_is_that_of_the_slow_twin(seed, least):
    rng = np.random.default_rng(seed)
    chunks = []
    for first in range(0, 30, 10):
        rows = np.arange(first, first + 18)
        parts = [
            (rng.choice(rows, rng.integers(1, 12), replace=False), rng.integers(0, 2), rng.random())
            for _ in range(rng.integers(0, 4))
        ]
        chunks.append(chunk(rows, *parts))
    got, expected = listed(stitch_instances(chunks, 40, least)), stitch_slow(chunks, least)
    assert [part[:2] for part in got] == [part[:2] for part in expected]
    assert [part[2] for part in got] == pytest.approx([part[2] for part in expected], abs=1e-6)
