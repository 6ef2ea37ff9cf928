import math
from types import SimpleNamespace

import pytest
import torch

from rm3d_plugin.baselines.twist.loss import TwistLoss
from rm3d_plugin.baselines.twist.pseudo import pooled, two_way_labels
from rm3d_plugin.models import Batch
from rm3d_plugin.models.heads import PointLabels
from rm3d_plugin.models.outputs import SegmentorOutput

PROBS = torch.tensor([[0.9, 0.1], [0.9, 0.1], [0.3, 0.7], [0.1, 0.9], [0.5, 0.5]])
MASKS = torch.tensor([[True, True, True, False, False], [False, False, True, True, False]])


def test_means_over_objects():
    wanted = torch.tensor([[0.7, 0.3], [0.2, 0.8], [0.0, 0.0]])
    masks = torch.cat([MASKS, torch.zeros(1, 5, dtype=torch.bool)])
    assert torch.allclose(pooled(PROBS, masks), wanted)
    assert pooled(PROBS, masks[:0]).shape == (0, 2)


def test_objects_correct_points_and_points_objects():
    object_probs = torch.tensor([[0.9, 0.1], [0.2, 0.8]])  # with the points: 0.8 and 0.8
    both = two_way_labels(PROBS, MASKS, object_probs, threshold=0.75)
    assert both.classes.tolist() == [0, 0, 0, 1, -1] and both.objects.tolist() == [0, 0, 0, 1, -1]
    unsure = torch.tensor([[0.5, 0.5], [0.2, 0.8]])  # 0.6: no object, and its points speak for themselves
    second = two_way_labels(PROBS, MASKS, unsure, threshold=0.75)
    assert second.classes.tolist() == [0, 0, 1, 1, -1] and second.objects.tolist() == [-1, -1, 1, 1, -1]
    none = two_way_labels(PROBS, MASKS[:0], unsure[:0], threshold=0.75)
    assert none.classes.tolist() == [0, 0, -1, 1, -1] and (none.objects == -1).all()


def made():
    """Two things a metre apart, four points each; a teacher that is sure of both, and one labelled point of each."""
    torch.manual_seed(0)
    xyz = torch.tensor([[x + 0.02 * i, 0.0, 0.0] for x in (0.0, 1.0) for i in range(4)])
    wise = SegmentorOutput(torch.randn(8, 4), torch.tensor([[9.0, 0.0]] * 4 + [[0.0, 9.0]] * 4), torch.zeros(8, 3))
    classes = torch.tensor([0, -1, -1, -1, 1, -1, -1, -1])
    instance = torch.tensor([0, -1, -1, -1, 1, -1, -1, -1])
    labels = PointLabels(classes, instance, torch.tensor([0, 0]), classes >= 0)
    own = SegmentorOutput(torch.randn(8, 4), torch.randn(8, 2), torch.randn(8, 3))
    batch = Batch(xyz, torch.tensor([0, 8]))
    rules = {'radius': 0.03, 'cluster_points': 2, 'min_points': 2, 'coordinates': 'shifted'}
    term = TwistLoss(num_classes=2, channels=4, thing_classes=[0, 1], proposals=rules, threshold=0.4)
    return batch, wise, own, labels, term


def test_without_a_teacher_the_classifier_learns_alone():
    batch, _, own, labels, term = made()
    found = term(batch, own, labels)
    wanted = torch.nn.functional.cross_entropy(term.classify(own.features[[0, 4]]), torch.tensor([0, 1]))
    assert list(found) == ['loss_object'] and found['loss_object'].item() == pytest.approx(wanted.item(), rel=1e-5)
    nothing = labels._replace(instance=torch.full((8,), -1), instance_scene=torch.zeros(0, dtype=torch.int64))
    assert term(batch, own, nothing)['loss_object'].item() == 0.0


def test_the_teachers_objects_teach_the_points_without_a_label():
    batch, wise, own, labels, term = made()
    term.classify.weight.data.zero_(), term.classify.bias.data.zero_()
    found = term(batch._replace(teacher=SimpleNamespace(outputs=wise)), own, labels)
    free = [1, 2, 3, 5, 6, 7]
    wanted = torch.nn.functional.cross_entropy(own.logits[free], torch.tensor([0] * 3 + [1] * 3))
    assert found['loss_pseudo'].item() == pytest.approx(wanted.item(), rel=1e-5)
    centres = torch.tensor([[0.03, 0.0, 0.0]] * 3 + [[1.03, 0.0, 0.0]] * 3)
    target = centres - batch.xyz[free]
    assert found['loss_pseudo_offset'].item() == pytest.approx(
        term.offset_loss(own.offsets[free], target).item(), rel=1e-4
    )
    assert math.isfinite(found['loss_object'].item())
