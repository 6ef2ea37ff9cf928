import math
from types import SimpleNamespace

import pytest
import torch

from rm3d_plugin.baselines.psd.losses import RelationLoss, relation_loss
from rm3d_plugin.models import Batch
from rm3d_plugin.models.heads import PointLabels


def slow_relation(cosines, classes):
    """Row by row, pair by pair."""
    pairs, precision, recall = [], [], []
    for i, row in enumerate(cosines):
        same = [float(kind == classes[i]) for kind in classes]
        pairs += [-math.log(said if is_same else 1 - said) for said, is_same in zip(row, same, strict=True)]
        shared = sum(said * is_same for said, is_same in zip(row, same, strict=True))
        precision.append(math.log(shared / sum(row)))
        recall.append(math.log(shared / sum(same)))
    count = len(cosines)
    return sum(pairs) / count**2 - sum(precision) / count - sum(recall) / count


def test_relations_by_hand():
    features = torch.tensor([[2.0, 0.0], [1.0, math.sqrt(3.0)], [0.0, -3.0]])  # 60 degrees, then 90 and 150 to the last
    low, high = 1e-4, 1 - 1e-4
    cosines = [[high, 0.5, low], [0.5, high, low], [low, low, high]]
    got = relation_loss(features, torch.tensor([0, 0, 1]))
    assert got.item() == pytest.approx(slow_relation(cosines, [0, 0, 1]), rel=1e-4)
    other = relation_loss(features, torch.tensor([0, 1, 1]))
    assert other.item() == pytest.approx(slow_relation(cosines, [0, 1, 1]), rel=1e-4) and other > got
    assert relation_loss(features[:0], torch.zeros(0, dtype=torch.int64)).item() == 0.0


def test_both_views_are_asked_of_their_labelled_points():
    torch.manual_seed(0)
    features, seen = torch.randn(5, 4, requires_grad=True), torch.randn(4, 4)
    classes = torch.tensor([0, -1, 1, 0, -1])
    nothing = torch.full_like(classes, -1)
    labels = PointLabels(classes, nothing, nothing[:0], classes >= 0)
    view = SimpleNamespace(features=seen, point_ids=torch.tensor([3, 1, -1, 0]))
    term = RelationLoss(channels=4)
    got = term(Batch(torch.zeros(5, 3), torch.tensor([0, 5]), (view,)), SimpleNamespace(features=features), labels)
    embedded = term.embed(features)
    wanted = relation_loss(embedded[[0, 2, 3]], torch.tensor([0, 1, 0]))
    assert got['loss_relation'].item() == pytest.approx(wanted.item(), rel=1e-5)
    wanted = relation_loss(term.embed(seen)[[0, 3]], torch.tensor([0, 0]))
    assert got['loss_relation_view'].item() == pytest.approx(wanted.item(), rel=1e-5)
    got['loss_relation'].backward()
    assert features.grad[[1, 4]].abs().sum() == 0 and torch.isfinite(features.grad).all()
