from types import SimpleNamespace

import pytest
import torch

from rm3d_plugin.models import Batch
from rm3d_plugin.models.heads import PointLabels
from rm3d_plugin.models.losses import ViewSupervision, labels_of_rows

CLASSES = torch.tensor([0, -1, 2, 1])
LABELS = PointLabels(
    CLASSES,
    torch.tensor([5, -1, 6, -1]),
    torch.tensor([0]),
    torch.tensor([True, False, False, True]),
    torch.tensor([3.0, 2.0, 1.0]),
    torch.tensor([1.0, 0.0, 0.5, 1.0]),
)


def test_labels_follow_the_points():
    found = labels_of_rows(LABELS, torch.tensor([2, -1, 0]))
    assert found.semantic.tolist() == [2, -1, 0] and found.instance.tolist() == [6, -1, 5]
    assert found.is_annotated.tolist() == [False, False, True] and found.confidence.tolist() == [0.5, 0.0, 1.0]
    assert found.class_counts is LABELS.class_counts
    assert labels_of_rows(LABELS._replace(confidence=None), torch.tensor([1])).confidence is None


def test_a_view_is_asked_of_the_labels_of_its_points():
    logits = torch.randn(3, 3, generator=torch.Generator().manual_seed(0))
    view = SimpleNamespace(features=logits, logits=lambda: logits, point_ids=torch.tensor([2, -1, 0]))
    term, batch = ViewSupervision(dict(type='WeakSupervision')), Batch(torch.zeros(4, 3), torch.tensor([0, 4]))
    first = SimpleNamespace(features=torch.zeros(4, 3), logits=torch.zeros(4, 3))
    assert term.needs == ('logits', 'semantic') and term(batch, first, LABELS) == {}
    got = term(batch._replace(views=(view,)), first, LABELS)
    wanted = torch.nn.functional.cross_entropy(logits[[0, 2]], torch.tensor([2, 0]))
    assert list(got) == ['loss_wsl_view'] and got['loss_wsl_view'].item() == pytest.approx(wanted.item(), rel=1e-5)
