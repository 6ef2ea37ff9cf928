import torch

from rm3d_plugin.models.heads.batch_labels import BatchLabels
from rm3d_plugin.models.heads.scene_class_head import SceneClassHead, max_by_owner


def batch(is_annotated=(True, True, False)):
    return BatchLabels(
        torch.ones(3, 7), torch.tensor([0, 1, 1]), torch.tensor(is_annotated), torch.tensor([0, 2, 3]),
        torch.tensor([0, 0, 1, -1, 1]), torch.tensor([0, 0, 1, -1, 2]),
    )  # fmt: skip


def test_max_by_owner():
    values = torch.tensor([[1.0, -5.0], [-2.0, -3.0], [-7.0, -8.0], [9.0, 9.0]])
    pooled, present = max_by_owner(values, torch.tensor([0, 0, 2, -1]), 3)
    assert pooled.tolist() == [[1.0, -3.0], [0.0, 0.0], [-7.0, -8.0]]
    assert present.tolist() == [True, False, True]
    assert max_by_owner(values[:0], torch.zeros(0, dtype=torch.int64), 0)[0].shape == (0, 2)


def test_only_true_objects_count():
    head = SceneClassHead(2)
    with torch.no_grad():
        head.mix.weight.copy_(torch.tensor([[1.0, 0, 0], [0, 1.0, 0]]))
        head.mix.bias.zero_()
    logits = torch.tensor([[1.0, 0, 0], [3.0, -1, 0], [0.5, 4.0, 0], [99.0, 99, 0], [99.0, 99, 0]])
    got, truth = head(logits, batch())
    assert got.tolist() == [[3.0, 4.0]]  # max over points, then over the two true objects; scene 1 has none
    assert truth.tolist() == [[1.0, 1.0]]
    got, truth = head(logits, batch((True, False, False)))
    assert (got.tolist(), truth.tolist()) == ([[3.0, 0.0]], [[1.0, 0.0]])


def test_no_true_object_is_zero_with_gradient():
    head, logits = SceneClassHead(2), torch.zeros(5, 3, requires_grad=True)
    loss = head.loss(logits, batch((False, False, False)))['loss_scene_class']
    loss.backward()
    assert float(loss.detach()) == 0.0
    assert all(p.grad is not None and p.grad.abs().sum() == 0 for p in head.parameters())
