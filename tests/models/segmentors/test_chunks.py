import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.chunks_slow import grid_chunks_slow

from rm3d_plugin.models.segmentors.chunks import CORE_SHARE, average_rows, make_chunks


def cloud(count, seed=0, spread=(10.0, 6.0, 2.0)):
    return (np.random.default_rng(seed).normal(0, 1, (count, 3)) * spread).astype(np.float32)


def test_a_scene_that_fits_stays_whole():
    xyz = cloud(100)
    for options in ({}, {'max_points': 100}, {'max_points': 100, 'chunk_size': 1.0}, {'chunk_size': 1e4}):
        (chunk,) = make_chunks(xyz, **options)
        assert chunk.rows.tolist() == list(range(100)) and (chunk.weights == 1).all()
    assert make_chunks(xyz[:0], max_points=5) == [] and make_chunks(xyz[:0]) == []
    assert len(make_chunks(xyz[:1], max_points=1, chunk_size=0.1)) == 1


def test_columns_by_hand():
    xyz = np.array([[0.0, 0, 9], [0.9, 0, 0], [1.5, 0, 0], [3.9, 0, 0], [4.0, 0, 0]])
    first, second, third = make_chunks(xyz, chunk_size=2.0, margin=1.0)  # cells 0, 1 and 2 of [0, 2), [2, 4), [4, 6)
    assert first.rows.tolist() == [0, 1, 2] and first.weights.tolist() == [1, 1, 1]
    assert second.rows.tolist() == [3, 4] and second.weights == pytest.approx([1, 0.9])
    assert third.rows.tolist() == [3, 4] and third.weights == pytest.approx([0.9, 1])


@given(st.integers(0, 10**6), st.integers(1, 60), st.floats(0.5, 30), st.floats(0, 5))
@settings(derandomize=True, max_examples=40, deadline=None)
def test_columns_are_those_of_the_slow_twin(seed, count, size, margin):
    xyz = np.round(cloud(count, seed), 1)
    expected = grid_chunks_slow(xyz, size, margin)
    got = {}
    for chunk in make_chunks(xyz, chunk_size=size, margin=margin):
        weights = dict(zip(chunk.rows.tolist(), chunk.weights.tolist(), strict=True))
        (core,) = [core for core in expected if set(core) <= set(weights) and core not in got
                   and all(weights[row] == 1 for row in core) and set(weights) == set(expected[core])]  # fmt: skip
        got[core] = weights
    assert set(got) == set(expected)
    for core, weights in expected.items():
        assert got[core] == pytest.approx(weights, abs=1e-6)


@given(
    st.integers(0, 10**6),
    st.integers(1, 400),
    st.integers(1, 90),
    st.sampled_from([None, 0.5, 7.0]),
    st.sampled_from([0.0, 0.3, 50.0]),
    st.sampled_from([(10.0, 6.0, 2.0), (0.0, 0.0, 1.0), (1e-3, 0.0, 0.0), (1e5, 1e5, 1.0)]),
)
@settings(derandomize=True, max_examples=60, deadline=None)
def test_every_point_is_in_a_core_and_no_chunk_is_too_large(seed, count, most, size, margin, spread):
    chunks = make_chunks(cloud(count, seed, spread), max_points=most, chunk_size=size, margin=margin)
    assert max(len(chunk.rows) for chunk in chunks) <= most
    strongest = np.zeros(count)
    for chunk in chunks:
        assert (np.diff(chunk.rows) > 0).all() and (chunk.weights > 0).all() and (chunk.weights <= 1).all()
        strongest[chunk.rows] = np.maximum(strongest[chunk.rows], chunk.weights)
    assert (strongest == 1).all()
    assert len(chunks) <= max(1, 2 * np.ceil(count / max(1, int(CORE_SHARE * most)))) or size is not None


def test_full_margins_keep_the_nearest_points():
    xyz = np.c_[np.arange(100.0), np.zeros((100, 2))]
    first, second = make_chunks(xyz, max_points=70, margin=40.0)
    assert first.rows.tolist() == list(range(70)) and second.rows.tolist() == list(range(30, 100))
    assert first.weights[50] == pytest.approx(1 - 1 / 21)  # the first point left out is 21 m away


def test_duplicates_and_strays():
    xyz = np.zeros((1000, 3), dtype=np.float32)
    xyz[0] = 1e6
    chunks = make_chunks(xyz, max_points=100, chunk_size=5.0)
    assert sorted(row for chunk in chunks for row in chunk.rows[chunk.weights == 1])[:1] == [0]
    assert max(len(chunk.rows) for chunk in chunks) <= 100


def test_the_mean_of_a_pointwise_model_is_what_it_says_of_the_whole_scene():
    xyz = torch.from_numpy(cloud(5000))
    calls = []

    def predict(rows):
        calls.append(len(rows))
        return torch.stack([xyz[rows, 0].sin(), xyz[rows, 1] * xyz[rows, 2]], dim=1)

    chunks = make_chunks(xyz.numpy(), max_points=700, margin=2.0)
    whole = predict(torch.arange(5000))
    calls.clear()
    torch.testing.assert_close(average_rows(chunks, 5000, predict), whole, atol=1e-5, rtol=1e-6)
    assert len(calls) == len(chunks) > 8 and max(calls) <= 700
    one = make_chunks(xyz.numpy())
    assert torch.equal(average_rows(one, 5000, predict), whole)


def test_the_mean_is_weighted():
    chunks = make_chunks(np.array([[0.0, 0, 0], [0.5, 0, 0], [1.0, 0, 0]]), chunk_size=1.0, margin=1.0)
    assert [chunk.rows.tolist() for chunk in chunks] == [[0, 1, 2], [1, 2]]
    values = iter([torch.tensor([[2.0]] * 3), torch.tensor([[8.0]] * 2)])
    got = average_rows(chunks, 3, lambda rows: next(values))
    # point 1: weight 1 in its own chunk, 0.5 in the other; point 2: 0.5 (half a metre from the first core) and 1
    assert got[:, 0].tolist() == pytest.approx([2.0, (2 + 4) / 1.5, (1 + 8) / 1.5])
