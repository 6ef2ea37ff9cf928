import numpy as np
import pytest
import torch
from coloured_boxes import CLASSES, make_room, segmentor_config
from mmengine.dataset import pseudo_collate

from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import LabelStatistics, SceneError, SceneSample


def build(**changes):
    torch.manual_seed(0)
    return MODELS.build(segmentor_config(**changes))


def l_ins(**classes):
    kinds = ('ViewConsistency', 'InstanceOffsets', 'InstanceDice')
    return [dict(type='WeakSupervision', **classes), *(dict(type=kind) for kind in kinds)]


def losses_of(model, items):
    return model(**model.data_preprocessor(pseudo_collate(items), True), mode='loss')


def gradients(model, items):
    model.zero_grad()
    losses = losses_of(model, items)
    model.parse_losses(losses)[0].backward()
    return losses, {name: p.grad for name, p in model.named_parameters()}


def train(model, items, steps, rate=5e-3):
    batch = pseudo_collate(items)
    optimizer = torch.optim.Adam(model.parameters(), rate)
    for step in range(steps):
        loss, _ = model.parse_losses(model(**model.data_preprocessor(batch, True), mode='loss'))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        optimizer.param_groups[0]['lr'] = rate * (1 - step / steps)


def matched_at(sample, iou):
    """Precision and recall of the predicted instances at an overlap."""
    truth = sample.pts_instance_mask
    numbers = truth[truth >= 0].unique().tolist()
    hits = set()
    for mask, kind in zip(sample.pred_instance_masks, sample.pred_instance_labels.tolist(), strict=True):
        for number in numbers:
            own = truth == number
            same = int(sample.pts_semantic_mask[own][0]) == kind
            if same and (mask & own).sum() / (mask | own).sum() >= iou:
                hits.add(number)
    return len(hits) / max(len(sample.pred_instance_masks), 1), len(hits) / len(numbers)


def test_learns_a_tiny_world_and_its_instances():
    model = build()
    train(model, [make_room(seed, view=True) for seed in range(3)], 50)
    batch = pseudo_collate([make_room(seed) for seed in (100, 101)])  # rooms it has not seen
    for sample in model.eval()(**model.data_preprocessor(batch), mode='predict'):
        right = sample.pred_point_probs.argmax(dim=1) == sample.pts_semantic_mask
        assert right.float().mean() > 0.95
        assert matched_at(sample, 0.75) == (1.0, 1.0)
    seen = pseudo_collate([make_room(0)])
    (sample,) = model(**model.data_preprocessor(seen), mode='predict')
    spread, shifted = [], []
    for number in (5, 7, 9, 11):
        points = seen['inputs']['points'][0][sample.pts_instance_mask == number, :3]
        spread.append((points - points.mean(dim=0)).norm(dim=1).mean())
        shifted.append(
            (sample.pred_point_centers[sample.pts_instance_mask == number] - points.mean(dim=0)).norm(dim=1).mean()
        )
    assert sum(shifted) < 0.6 * sum(spread)  # offsets lead towards the centres


def test_losses_have_names_and_every_parameter_learns():
    model = build()
    losses, grads = gradients(model, [make_room(0, view=True), make_room(1, view=True)])
    assert sorted(losses) == ['loss_aug', 'loss_dice', 'loss_offset', 'loss_wsl']
    assert [name for name, grad in grads.items() if grad is None or not grad.abs().sum() > 0] == []
    plain = build(instance_head=None, losses=[dict(type='WeakSupervision'), None])
    assert sorted(losses_of(plain, [make_room(0, view=True)])) == ['loss_wsl']
    assert sorted(losses_of(build(instance_head=None), [make_room(0)])) == ['loss_wsl']  # no second view, no loss_aug


@pytest.mark.parametrize('balance', ['none', 'batch', 'frequency'])
def test_a_batch_without_labels_is_a_zero_loss_with_gradients(balance):
    model = build(losses=l_ins(balance=balance))
    item = make_room(0)
    item['data_samples'].pts_semantic_mask[:] = -1
    item['data_samples'].pts_instance_mask[:] = -1
    losses, grads = gradients(model, [item, {**item, 'data_samples': SceneSample()}])
    assert [losses[name].item() for name in sorted(losses)] == [0.0, 0.0, 0.0]
    assert all(grad is not None and torch.isfinite(grad).all() for grad in grads.values())


def test_what_is_hidden_changes_nothing():
    """Labels that the budget does not show, however noisy, leave loss and gradients the same bits."""
    generator = torch.Generator().manual_seed(0)
    kept = torch.rand(1700, generator=generator) < 0.02

    def item(noise):
        made = make_room(0, view=True)
        sample = made['data_samples']
        if noise:
            sample.pts_semantic_mask[~kept] = torch.randint(0, CLASSES, (int((~kept).sum()),), generator=generator)
            sample.pts_instance_mask[~kept] = torch.randint(0, 9, (int((~kept).sum()),), generator=generator)
        sample.set_metainfo({'annotation': sample.pts_semantic_mask.numpy().copy()})  # a metric's truth rides along
        sample.pts_semantic_mask[~kept], sample.pts_instance_mask[~kept] = -1, -1
        return made

    model = build()
    state = {name: value.clone() for name, value in model.state_dict().items()}
    clean = gradients(model, [item(noise=False)])
    model.load_state_dict(state)
    noisy = gradients(model, [item(noise=True)])
    assert all(torch.equal(clean[0][name], noisy[0][name]) for name in clean[0])
    assert all(torch.equal(clean[1][name], noisy[1][name]) for name in clean[1])


@pytest.mark.parametrize('checkpointing', [False, True])
def test_the_second_view_leaves_the_running_statistics_alone(checkpointing):
    backbone = dict(type='SparseUNet', voxel_size=0.1, widths=[16, 24], blocks=1, checkpointing=checkpointing)
    buffers = []
    for view in (False, True):
        model = build(backbone=backbone)
        gradients(model, [make_room(0, view=view)])
        buffers.append(dict(model.named_buffers()))
    assert all(torch.equal(buffers[0][name], buffers[1][name]) for name in buffers[0])
    assert buffers[1]['backbone.norm.norm.num_batches_tracked'] == 1


def test_a_scene_of_one_voxel_with_a_view_of_two_has_gradients():
    item = make_room(0)
    item['inputs']['points'] = item['inputs']['points'][:2].clone()
    item['inputs']['points'][:, :3] = 0.05
    apart = item['inputs']['points'] + torch.tensor([[0.0] * 6, [5.0] * 3 + [0.0] * 3])
    item['inputs']['views'] = [{'points': apart, 'point_ids': torch.arange(2)}]
    for name in ('pts_semantic_mask', 'pts_instance_mask', 'pts_is_annotated'):
        item['data_samples'].set_data({name: item['data_samples'].get(name)[:2]})
    _, grads = gradients(build(), [item])
    assert all(torch.isfinite(grad).all() for grad in grads.values() if grad is not None)


def test_a_class_without_any_label_is_fine():
    item = make_room(0)
    item['data_samples'].pts_semantic_mask[item['data_samples'].pts_semantic_mask == 2] = -1
    model = build(num_classes=7, losses=l_ins(balance='frequency'), thing_classes=[1, 2, 6])
    model.set_label_statistics(LabelStatistics(np.array([700, 500, 0, 0, 0, 0, 0])))
    assert all(torch.isfinite(value) for value in losses_of(model, [item]).values())
    (sample,) = model.eval()(**model.data_preprocessor(pseudo_collate([item])), mode='predict')
    assert sample.pred_point_probs.shape == (1700, 7)


def test_training_is_the_same_bits_again():
    states = []
    for _ in range(2):
        model = build()
        train(model, [make_room(0, view=True)], 3)
        states.append(model.state_dict())
    assert all(torch.equal(states[0][name], states[1][name]) for name in states[0])


def test_predictions_follow_the_contract():
    model = build().eval()
    items = [make_room(0, boxes=1, points=30, floor=20), make_room(1)]
    data = model.data_preprocessor(pseudo_collate(items))
    samples = model(**data, mode='predict')
    for sample, rows in zip(samples, (50, 1700), strict=True):
        assert sample.pred_point_probs.shape == (rows, CLASSES) and sample.pred_point_probs.dtype == torch.float32
        torch.testing.assert_close(sample.pred_point_probs.sum(dim=1), torch.ones(rows))
        assert sample.pred_point_centers.shape == (rows, 3)
        count = len(sample.pred_instance_labels)
        assert sample.pred_instance_masks.shape == (count, rows) and sample.pred_instance_masks.dtype == torch.bool
        assert sample.pred_instance_labels.dtype == torch.int64 and sample.pred_instance_scores.dtype == torch.float32
    fresh = model(data['inputs'], mode='predict')
    assert torch.equal(fresh[1].pred_point_probs, samples[1].pred_point_probs)
    output = model(**data)
    assert output.logits.shape == (1750, CLASSES) and output.offsets.shape == (1750, 3)


def test_what_is_not_asked_for_is_not_predicted():
    data = build().data_preprocessor(pseudo_collate([make_room(0)]))
    asked = build().eval()
    asked.predict_points = True
    points_only = asked(data['inputs'], mode='predict')[0]
    assert 'pred_point_centers' in points_only and 'pred_instance_masks' not in points_only
    assert 'pred_instance_masks' not in build(predict_instances=False).eval()(data['inputs'], mode='predict')[0]
    semantic = build(instance_head=None).eval()(data['inputs'], mode='predict')[0]
    assert 'pred_point_centers' not in semantic and 'pred_point_probs' in semantic


def test_bfloat16_forward():
    model = build()
    with torch.autocast('cpu', dtype=torch.bfloat16):
        losses = losses_of(model, [make_room(0, view=True)])
        model.parse_losses(losses)[0].backward()
        sample = model.eval()(**model.data_preprocessor(pseudo_collate([make_room(0)])), mode='predict')[0]
    assert all(value.dtype == torch.float32 and torch.isfinite(value) for value in losses.values())
    assert sample.pred_point_probs.dtype == torch.float32 and sample.pred_point_centers.dtype == torch.float32


def test_bad_settings_are_told():
    with pytest.raises(ValueError, match='thing_classes: expected classes 0..2'):
        build(thing_classes=[3])
    with pytest.raises(ValueError, match='InstanceOffsets reads offsets, which this RM3DSegmentor does not have'):
        build(instance_head=None, losses=l_ins())
    item = make_room(0)
    item['data_samples'].pts_semantic_mask[0] = 3
    with pytest.raises(SceneError, match='room_0: pts_semantic_mask: expected -1..2, got class 3'):
        losses_of(build(), [item])
