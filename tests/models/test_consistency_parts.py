"""Prototypes, the bank of features, and the teacher's answers."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from rm3d_plugin.models import Teacher, View
from rm3d_plugin.models.consistency import MemoryBank, PrototypeBank, common_rows, group_means


def test_group_means_leave_out_rows_of_no_group_and_carry_gradients():
    features = torch.tensor([[1.0, 0.0], [3.0, 2.0], [5.0, 5.0]], requires_grad=True)
    found = group_means(features, torch.tensor([1, 1, -1]), 3)
    assert found.means.tolist() == [[0, 0], [2, 1], [0, 0]] and found.present.tolist() == [False, True, False]
    found.means.sum().backward()
    assert features.grad.tolist() == [[0.5, 0.5], [0.5, 0.5], [0, 0]]


def test_a_prototype_starts_as_its_first_mean_and_then_follows():
    bank = PrototypeBank(3, 2, momentum=0.9)
    bank.update(torch.tensor([[2.0, 0.0], [4.0, 0.0], [9.0, 9.0]]), torch.tensor([0, 0, -1]))
    assert bank.present[:, 0].tolist() == [True, False, False] and bank.values[0, 0].tolist() == [3.0, 0.0]
    bank.update(torch.tensor([[0.0, 3.0], [1.0, 1.0]]), torch.tensor([0, 2]))
    torch.testing.assert_close(bank.values[0, 0], torch.tensor([2.7, 0.3]))
    assert bank.values[2, 0].tolist() == [1.0, 1.0] and bank.present[:, 0].tolist() == [True, False, True]


def test_several_prototypes_a_class_and_the_nearest_counts():
    bank = PrototypeBank(2, 2, per_class=2)
    bank.update(torch.tensor([[2.0, 0.0], [0.0, 5.0]]), torch.tensor([0, 0]), torch.tensor([0, 1]))
    got = bank.similarity(torch.tensor([[1.0, 0.0], [1.0, 1.0]]))
    np.testing.assert_allclose(got[:, 0], [1.0, 2**-0.5], rtol=1e-5)
    assert (got[:, 1] == -torch.inf).all()
    assert set(bank.state_dict()) == {'values', 'present'}
    with pytest.raises(ValueError, match='momentum in'):
        PrototypeBank(2, 2, momentum=1.0)


def test_a_full_bank_forgets_the_oldest():
    bank = MemoryBank(2, 1, size=3)
    bank.put(torch.tensor([[1.0], [2.0], [9.0], [3.0]]), torch.tensor([0, 0, -1, 0]), most=2)
    held = bank.draw(10)
    assert sorted(held.features[:, 0].tolist()) == [1, 2] and held.classes.tolist() == [0, 0]
    bank.put(torch.tensor([[4.0], [5.0], [7.0]]), torch.tensor([0, 0, 1]), most=9)
    held = bank.draw(10)
    assert sorted(zip(held.classes.tolist(), held.features[:, 0].tolist(), strict=True)) == [
        (0, 2), (0, 4), (0, 5), (1, 7),
    ]  # fmt: skip
    assert len(bank.draw(2).classes) == 2 and len(MemoryBank(2, 1, 3).draw(5).classes) == 0


def test_points_that_the_first_view_lacks_are_not_common():
    ids = torch.tensor([-1, 4, -1, 2, 0])
    assert sorted(common_rows(ids, 9).tolist()) == [1, 3, 4]
    assert common_rows(torch.tensor([-1]), 9).tolist() == []


def test_a_teacher_is_asked_once_and_gives_no_gradient():
    weight, asked = torch.tensor(2.0, requires_grad=True), []

    def ask():
        asked.append(1)
        return SimpleNamespace(logits=weight * torch.ones(2, 2))

    teacher = Teacher(ask, lambda points, offsets: weight * points, lambda features: weight * features)
    assert teacher.outputs is teacher.outputs and len(asked) == 1 and not teacher.outputs.logits.requires_grad
    view = View(torch.ones(3, 4), torch.tensor([0, 3]), torch.arange(3), lambda points, offsets: points, lambda f: f)
    seen = teacher.view(view)
    assert seen.logits().tolist() == [[4.0] * 4] * 3 and not seen.logits().requires_grad
    assert seen.point_ids is view.point_ids
