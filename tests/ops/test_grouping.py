import pytest
import torch

from rm3d_plugin.ops.grouping import _ball_torch, ball_query, batch_index, gather_groups, group_max


def test_ball_by_hand():
    points = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0.5, 0, 0], [3, 0, 0]])
    queries = torch.tensor([[0.0, 0, 0], [3.0, 0, 0], [9.0, 0, 0]])
    want = [[0, 1, 2], [3, -1, -1], [-1, -1, -1]]
    assert ball_query(points, queries, 1.0, 3).tolist() == want  # exactly 1 m away is in
    assert ball_query(points, queries, 1.0, 2).tolist() == [row[:2] for row in want]
    assert ball_query(points, queries, 1.0, 5).tolist() == [[*row, -1, -1] for row in want]


def test_cpu_and_torch_paths_agree():
    generator = torch.Generator().manual_seed(0)
    points, queries = torch.rand(300, 3, generator=generator), torch.rand(50, 3, generator=generator)
    slow = [[j for j, p in enumerate(points.double()) if (p - q).square().sum() <= 0.04][:8] for q in queries.double()]
    want = [row + [-1] * (8 - len(row)) for row in slow]
    assert ball_query(points, queries, 0.2, 8).tolist() == want
    assert _ball_torch(points.double(), queries.double(), 0.2**2, 8, 0).tolist() == want


def test_scenes_do_not_mix_and_may_be_empty():
    points, queries = torch.zeros(4, 3), torch.zeros(3, 3)
    got = ball_query(points, queries, 1.0, 3, torch.tensor([0, 1, 1, 4]), torch.tensor([0, 1, 2, 3]))
    assert got.tolist() == [[0, -1, -1], [-1, -1, -1], [1, 2, 3]]


def test_bad_input():
    with pytest.raises(ValueError, match='radius'):
        ball_query(torch.zeros(1, 3), torch.zeros(1, 3), -1.0, 2)
    with pytest.raises(ValueError, match='scenes'):
        ball_query(torch.zeros(1, 3), torch.zeros(1, 3), 1.0, 2, torch.tensor([0, 1, 1]), None)


def test_batch_index():
    assert batch_index(torch.tensor([0, 2, 2, 3])).tolist() == [0, 0, 2]


def test_gather_and_max():
    values = torch.tensor([[1.0, -1.0], [2.0, -3.0]], requires_grad=True)
    index = torch.tensor([[0, 1], [1, -1], [-1, -1]])
    groups = gather_groups(values, index)
    assert groups.tolist() == [[[1, -1], [2, -3]], [[2, -3], [0, 0]], [[0, 0], [0, 0]]]
    pooled = group_max(groups, index)
    assert pooled.tolist() == [[2, -1], [2, -3], [0, 0]]  # the zero that fills row 1 does not win over -3
    pooled.sum().backward()
    assert values.grad.tolist() == [[0, 1], [2, 1]]
    assert gather_groups(torch.zeros(0, 2), torch.full((1, 3), -1)).tolist() == [[[0, 0]] * 3]
