"""The open list of losses: what stands in it, what is refused, and a loss from another project."""

import numpy as np
import pytest
import torch
from mmengine.dataset import pseudo_collate
from mmengine.registry import MODELS as ROOT
from models.segmentors.coloured_boxes import make_room, segmentor_config
from torch import nn

from rm3d_plugin.models import LossTerm, PointModel
from rm3d_plugin.models.detectors import RM3DVoteNet
from rm3d_plugin.models.segmentors import RM3DSegmentor
from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import LabelStatistics

SEEN = []


@ROOT.register_module(name='SureLoss', force=True)
class SureLoss(LossTerm):
    """Of another project: predictions should be sure, in every view; a factor is learned."""

    needs = ('logits',)

    def __init__(self, weight=1.0):
        super().__init__()
        self.weight, self.scale = weight, nn.Parameter(torch.ones(1))

    def forward(self, batch, outputs, labels):
        SEEN.append((batch, outputs, labels))
        everywhere = [outputs.logits, *(view.logits() for view in batch.views)]
        each = [-(rows.softmax(1) * rows.log_softmax(1)).sum(1).mean() for rows in everywhere]
        return {'loss_entropy': self.weight * self.scale[0] * torch.stack(each).mean(), 'sure': (-each[0]).exp()}


@ROOT.register_module(name='NoTerm', force=True)
class NoTerm(nn.Module):
    """Not an entry of the list."""


def build(losses, **changes):
    torch.manual_seed(0)
    return MODELS.build(segmentor_config(losses=losses, **changes))


def losses_of(model, items):
    return model(**model.data_preprocessor(pseudo_collate(items), True), mode='loss')


def two_views(seed=0):
    item = make_room(seed, view=True)
    (view,) = item['inputs']['views']
    item['inputs']['views'].append({'points': view['points'][:300] + 0.1, 'point_ids': view['point_ids'][:300]})
    return item


def test_a_loss_of_another_project_is_one_entry():
    SEEN.clear()
    model = build([dict(type='WeakSupervision'), dict(type='SureLoss', weight=0.5)])
    losses = losses_of(model, [two_views(), two_views(1)])
    assert list(losses) == ['loss_wsl', 'loss_entropy', 'sure']
    ((batch, outputs, labels),) = SEEN
    assert batch.points.shape == (3400, 6) and [len(view.points) for view in batch.views] == [1700, 600]
    assert outputs.features.shape == (3400, 16) and outputs.logits.shape == (3400, 3)
    assert labels.semantic.shape == (3400,) and labels.class_counts.tolist() == [0, 0, 0]
    rows = [outputs.logits, *(model.classify(view.features) for view in batch.views)]
    probs = [row.detach().double().softmax(1).numpy() for row in rows]
    entropy = np.mean([-(p * np.log(p)).sum(axis=1).mean() for p in probs])
    assert losses['loss_entropy'].item() == pytest.approx(0.5 * entropy, rel=1e-5)
    total, told = model.parse_losses(losses)
    assert total.item() == pytest.approx(losses['loss_wsl'].item() + losses['loss_entropy'].item())
    total.backward()
    assert model.losses['SureLoss'].scale.grad.abs() > 0 and 'sure' in told
    assert 'losses.SureLoss.scale' in model.state_dict()


def test_the_detector_takes_the_same_loss(world):
    torch.manual_seed(0)
    model = MODELS.build(world.config(losses=[dict(type='SureLoss')]))
    item = world.make_scene(0, view=True)
    assert set(losses_of(model, [item])) == {'loss_entropy', 'sure'}


def test_a_view_is_computed_when_it_is_asked_for_and_once():
    calls = []
    for losses in ([dict(type='WeakSupervision')], [dict(type='ViewConsistency'), dict(type='SureLoss')]):
        model = build(losses)
        hook = model.backbone.register_forward_hook(lambda *_: calls.append(1))
        losses_of(model, [two_views()])
        hook.remove()
        calls.append('next')
    assert calls == [1, 'next', 1, 1, 1, 'next']  # the scene; the scene and each of its two views


def test_several_views_leave_the_running_statistics_alone():
    buffers = []
    for item in (make_room(0), two_views()):
        model = build([dict(type='ViewConsistency'), dict(type='WeakSupervision')])
        losses_of(model, [item])
        buffers.append(dict(model.backbone.named_buffers()))
    assert all(torch.equal(buffers[0][name], buffers[1][name]) for name in buffers[0])


def test_entries_that_are_none_are_left_out_and_order_stays():
    model = build([None, dict(type='ViewConsistency'), None, dict(type='WeakSupervision')], instance_head=None)
    assert list(model.losses) == ['ViewConsistency', 'WeakSupervision']
    assert list(losses_of(model, [make_room(0, view=True)])) == ['loss_aug', 'loss_wsl']
    assert losses_of(build([]), [make_room(0)]) == {}


def test_what_cannot_be_an_entry_is_told():
    with pytest.raises(TypeError, match='expected loss terms, called with .*, got NoTerm; wrap it'):
        build([dict(type='NoTerm')])
    with pytest.raises(TypeError, match="wrap it, say as dict.type='ViewConsistency'"):
        build([dict(type='JSAugLoss')])
    with pytest.raises(ValueError, match='InstanceDice reads offsets, which this RM3DSegmentor does not have'):
        build([dict(type='InstanceDice')], instance_head=None)
    with pytest.raises(ValueError, match='SceneClasses reads box_is_annotated, boxes, which'):
        build([dict(type='SceneClasses', num_classes=3)])


def test_a_detector_has_no_points_that_tell_whether_they_are_annotated(world):
    with pytest.raises(ValueError, match='WeakSupervision reads is_annotated, which this RM3DVoteNet'):
        MODELS.build(world.config(losses=[dict(type='WeakSupervision', pseudo_weight=0.5)]))


def test_two_entries_may_not_give_one_name():
    model = build([dict(type='SureLoss'), dict(type='SureLoss')])
    assert list(model.losses) == ['SureLoss', 'SureLoss_2']
    with pytest.raises(ValueError, match='SureLoss_2 and an entry before it both say loss_entropy, sure'):
        losses_of(model, [make_room(0)])


def test_statistics_of_the_labels_go_where_they_are_read(world):
    statistics = LabelStatistics(np.array([7, 0, 2]), np.array([[4.0, 2, 1.5], [1, 1, 2], [2, 1, 2]]))
    segmentor, detector = build([]), MODELS.build(world.config(losses=[]))
    for model in (segmentor, detector):
        model.set_label_statistics(statistics)
    assert segmentor.state_dict()['semantic_head.class_counts'].tolist() == [7, 0, 2]
    assert detector.state_dict()['vote_head.mean_sizes'].tolist() == [[4, 2, 1.5], [1, 1, 2], [2, 1, 2]]


@pytest.mark.parametrize('kind', [RM3DSegmentor, RM3DVoteNet])
def test_models_are_abstract_or_final(kind):
    assert kind.__final__ and kind.__mro__[1] is PointModel
    abstract = PointModel.__abstractmethods__
    shared = {name for name in vars(PointModel) if callable(getattr(PointModel, name)) and name not in abstract}
    assert set(vars(kind)) & (shared - {'__init__'}) == set()
