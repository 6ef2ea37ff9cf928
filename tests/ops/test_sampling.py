import numpy as np
import pytest
import torch

from rm3d_plugin.ops.sampling import _furthest_torch, furthest_point_sample, furthest_point_sample_batch


def slow_twin(xyz, count):
    chosen = [0]
    while len(chosen) < min(count, len(xyz)):
        gaps = [-1.0 if i in chosen else min(((p - xyz[j]) ** 2).sum() for j in chosen) for i, p in enumerate(xyz)]
        chosen.append(int(np.argmax(gaps)))
    return chosen[:count]


def test_line_by_hand():
    xyz = torch.tensor([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [10, 0, 0]])
    assert furthest_point_sample(xyz, 3).tolist() == [0, 3, 2]


@pytest.mark.parametrize('seed', range(3))
def test_equals_slow_twin_on_both_paths(seed):
    xyz = torch.from_numpy(np.random.default_rng(seed).normal(size=(60, 3)).astype(np.float32))
    want = slow_twin(xyz.double().numpy(), 20)
    assert furthest_point_sample(xyz, 20).tolist() == want
    assert _furthest_torch(xyz.double(), 20).tolist() == want


def test_duplicates_ties_and_bounds():
    same = torch.ones(5, 3)
    assert furthest_point_sample(same, 4).tolist() == [0, 1, 2, 3]
    assert _furthest_torch(same.double(), 4).tolist() == [0, 1, 2, 3]
    assert furthest_point_sample(same, 9).tolist() == [0, 1, 2, 3, 4]
    assert furthest_point_sample(same[:1], 3).tolist() == [0]
    assert furthest_point_sample(torch.zeros(0, 3), 3).tolist() == []
    assert furthest_point_sample(same, 0).tolist() == []


def test_bad_input():
    with pytest.raises(ValueError, match='NaN'):
        furthest_point_sample(torch.tensor([[0.0, float('nan'), 0.0]]), 1)
    with pytest.raises(ValueError, match='count'):
        furthest_point_sample(torch.zeros(2, 3), -1)


def test_batch_keeps_scenes_apart():
    xyz = torch.tensor([[0.0, 0, 0], [1, 0, 0], [5, 0, 0], [9, 0, 0], [9, 1, 0]])
    rows, offsets = furthest_point_sample_batch(xyz, torch.tensor([0, 3, 3, 5]), 2)
    assert rows.tolist() == [0, 2, 3, 4]
    assert offsets.tolist() == [0, 2, 2, 4]
