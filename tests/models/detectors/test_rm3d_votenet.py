import copy

import numpy as np
import pytest
import torch
from mmengine.dataset import pseudo_collate

from rm3d_plugin.models.consistency import common_rows
from rm3d_plugin.models.detectors.point_features import point_features
from rm3d_plugin.ops.boxes import points_in_boxes, rotated_iou_bev
from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import LabelStatistics, SceneSample


def build(config):
    torch.manual_seed(0)
    return MODELS.build(config)


def losses_of(model, items):
    return model(**model.data_preprocessor(pseudo_collate(items), True), mode='loss')


def test_point_features():
    got = point_features(torch.tensor([[30.0, 40.0, 1.0, 0.7]]), (-1.0, 3.0))
    assert got.tolist() == [[pytest.approx(0.7), 0.5, 1.0, 1.0]]
    with pytest.raises(ValueError, match='3 columns'):
        point_features(torch.zeros(1, 3), (0.0, 1.0))


def test_common_rows_are_random_but_fixed_and_leave_the_global_generator_alone():
    index = torch.arange(5000)
    state = torch.random.get_rng_state()
    rows = common_rows(index, 1000)
    assert torch.equal(state, torch.random.get_rng_state())
    assert torch.equal(rows, common_rows(index.clone(), 1000))
    assert len(rows.unique()) == 1000
    assert not torch.equal(rows, common_rows(index + 1, 1000))
    assert sorted(common_rows(index[:3], 1000).tolist()) == [0, 1, 2]


def test_overfits_a_tiny_world(world):
    model = build(world.config())
    items = [world.make_scene(seed, classes=(0, 1, 2)) for seed in range(2)]
    batch = pseudo_collate(items)
    optimizer = torch.optim.Adam(model.parameters(), 4e-3)
    for step in range(250):
        loss, _ = model.parse_losses(model(**model.data_preprocessor(batch, True), mode='loss'))
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 10.0)
        optimizer.step()
        optimizer.param_groups[0]['lr'] = 4e-3 * (1 - step / 250)
    ious = []
    for sample in model.eval()(**model.data_preprocessor(batch), mode='predict'):
        sure = sample.pred_scores_3d > 0.3
        iou = rotated_iou_bev(sample.gt_bboxes_3d.double().numpy(), sample.pred_bboxes_3d[sure].double().numpy())
        same = sample.gt_labels_3d[:, None] == sample.pred_labels_3d[sure][None]
        ious += (iou * same.numpy()).max(axis=1).tolist()
    assert len(ious) == 6
    assert sum(ious) / len(ious) > 0.5
    assert min(ious) > 0.1


def test_every_parameter_learns(world):
    model = build(world.config(head=dict(near=3.0, far=4.0)))
    loss, _ = model.parse_losses(losses_of(model, [world.make_scene(0, view=True)]))
    loss.backward()
    silent = [name for name, p in model.named_parameters() if p.grad is None or not p.grad.abs().sum() > 0]
    assert silent == []


def test_loss_names_and_switches(world):
    items = [world.make_scene(0, view=True)]
    names = set(losses_of(build(world.config()), items))
    assert names == {
        f'loss_{n}'
        for n in 'vote objectness center heading_bin heading size_class size class wsl aug dice scene_class'.split()
    }
    off = build(world.config(losses=[dict(type='VoteNetLoss'), None]))
    assert names - set(losses_of(off, items)) == {'loss_wsl', 'loss_aug', 'loss_dice', 'loss_scene_class'}
    mse = dict(type='ViewConsistency', loss=dict(type='MSEAugLoss', loss_weight=0.0))
    alone = losses_of(build(world.config(losses=[mse])), items)
    assert list(alone) == ['loss_aug'] and alone['loss_aug'].item() == 0.0


def test_axis_aligned(world):
    model = build(world.config(head=dict(heading_bins=1)))
    losses = losses_of(model, [world.make_scene(0)])
    assert float(losses['loss_heading_bin'].detach()) == 0.0
    (sample,) = model.eval()(**model.data_preprocessor(pseudo_collate([world.make_scene(0)])), mode='predict')
    assert (sample.pred_bboxes_3d[:, 6] == 0).all()


def nothing_known(item):
    sample = item['data_samples']
    sample.gt_bboxes_3d, sample.gt_labels_3d = torch.zeros(0, 7), torch.zeros(0, dtype=torch.int64)
    sample.gt_is_annotated = torch.zeros(0, dtype=torch.bool)
    sample.pts_semantic_mask.fill_(-1)
    sample.pts_instance_mask.fill_(-1)
    return item


def test_nothing_known_is_worth_nothing(world):
    model = build(world.config())
    loss, _ = model.parse_losses(losses_of(model, [nothing_known(world.make_scene(0))]))
    loss.backward()
    assert float(loss.detach()) == 0.0
    assert all(p.grad is None or (p.grad == 0).all() for p in model.parameters())


def test_unknown_points_count_as_background_with_their_weight_only(world):
    model = build(world.config(head=dict(unlabelled_weight=0.1)))
    losses = losses_of(model, [nothing_known(world.make_scene(0))])
    assert float(losses['loss_objectness'].detach()) > 0.0
    assert float(losses['loss_center'].detach()) == 0.0


@pytest.mark.parametrize('points', [0, 1])
def test_tiny_scenes(world, points):
    model = build(world.config())
    item = {'inputs': {'points': torch.zeros(points, 4)}, 'data_samples': SceneSample(gt_bboxes_3d=torch.zeros(0, 7))}
    loss, _ = model.parse_losses(losses_of(model, [item]))
    loss.backward()
    assert torch.isfinite(loss.detach())
    (sample,) = model.eval()(**model.data_preprocessor(pseudo_collate([item])), mode='predict')
    assert sample.pred_bboxes_3d.shape[1] == 7


def test_predicts_points_on_request_and_without_samples(world):
    model = build(world.config()).eval()
    model.predict_points = True
    items = [world.make_scene(0), world.make_scene(1, classes=(0,), floor=10)]
    inputs = model.data_preprocessor({'inputs': {'points': [i['inputs']['points'] for i in items]}})['inputs']
    samples = model(inputs, mode='predict')
    for item, sample in zip(items, samples, strict=True):
        n = len(item['inputs']['points'])
        assert sample.pred_point_probs.shape == (n, 4)
        assert torch.allclose(sample.pred_point_probs.sum(1), torch.ones(n))
        assert sample.pred_point_centers.shape == (n, 3)
        assert (sample.pred_scores_3d[:-1] >= sample.pred_scores_3d[1:]).all()
    alone = model(model.data_preprocessor(pseudo_collate(items[1:]))['inputs'], mode='predict')[0]
    assert torch.allclose(alone.pred_bboxes_3d, samples[1].pred_bboxes_3d, atol=1e-4)


def test_a_scene_of_the_batch_does_not_touch_another(world):
    model = build(world.config()).eval()
    items = [world.make_scene(0), world.make_scene(1)]
    together = model(**model.data_preprocessor(pseudo_collate(items)), mode='predict')
    for item, sample in zip(items, together, strict=True):
        (alone,) = model(**model.data_preprocessor(pseudo_collate([item])), mode='predict')
        assert torch.allclose(alone.pred_scores_3d, sample.pred_scores_3d, atol=1e-4)


def test_training_draws_no_global_randomness_and_repeats_bit_for_bit(world):
    model = build(world.config())
    twin = copy.deepcopy(model)
    items = [world.make_scene(0, view=True)]
    state = torch.random.get_rng_state()
    first, second = losses_of(model, items), losses_of(twin, items)
    assert torch.equal(state, torch.random.get_rng_state())
    assert all(torch.equal(first[name], second[name]) for name in first)


def test_size_templates_are_kept_in_the_checkpoint(world):
    model = build(world.config())
    model.set_label_statistics(LabelStatistics(np.array([1, 2, 3]), np.array([[5.0, 2.0, 1.0]] * 3)))
    model.set_label_statistics(LabelStatistics(np.array([1, 2, 3])))  # sizes unknown: those of before stay
    other = build(world.config())
    other.load_state_dict(model.state_dict())
    assert other.vote_head.mean_sizes.tolist() == [[5.0, 2.0, 1.0]] * 3
    with pytest.raises(ValueError, match='positive'):
        model.vote_head.set_mean_sizes(torch.zeros(3, 3))
    with pytest.raises(ValueError, match='VoteHead.near'):
        build(world.config(head=dict(near=[0.3, 0.6])))


def test_bad_mode(world):
    with pytest.raises((ValueError, TypeError), match='loss|Literal'):
        build(world.config())({}, mode='train')


def test_mean_shift_moves_proposals_to_where_votes_agree(world):
    head = build(world.config(head=dict(mean_shifts=1, radius=1.0))).vote_head
    votes = torch.tensor([[0.0, 0, 0], [0.3, 0, 0], [0.3, 0, 0], [9.0, 0, 0]])
    whole, one = torch.tensor([0, 4]), torch.tensor([0, 2])
    moved = head._shift(votes[[0, 3]], votes, torch.ones(4), one, whole)
    weight = 2 * torch.exp(torch.tensor(-0.5 * 0.9**2))
    assert moved[0].tolist() == pytest.approx([float(0.3 * weight / (1 + weight)), 0, 0], abs=1e-4)
    assert moved[1].tolist() == [9.0, 0, 0]
    unlit = head._shift(votes[:1], votes, torch.zeros(4), torch.tensor([0, 1]), whole)
    assert unlit[0].tolist() == pytest.approx([0.2, 0, 0])


def test_half_precision(world):
    model = build(world.config())
    with torch.autocast('cpu', dtype=torch.bfloat16):
        losses = losses_of(model, [world.make_scene(0, view=True)])
        loss, _ = model.parse_losses(losses)
    loss.backward()
    assert all(torch.isfinite(value.detach()) for value in losses.values())
    assert all(torch.isfinite(p.grad).all() for p in model.parameters() if p.grad is not None)
    batch = model.data_preprocessor(pseudo_collate([world.make_scene(0)]))
    with torch.autocast('cpu', dtype=torch.bfloat16):
        (sample,) = model.eval()(**batch, mode='predict')
    assert sample.pred_bboxes_3d.dtype == sample.pred_scores_3d.dtype == torch.float32


def test_with_the_sparse_unet(world):
    backbone = dict(type='SparseUNet', voxel_size=0.3, widths=[8, 16], blocks=1)
    model = build(world.config(backbone=backbone))
    losses = losses_of(model, [world.make_scene(0, view=True), world.make_scene(1, view=True)])
    loss, _ = model.parse_losses(losses)
    loss.backward()
    assert torch.isfinite(loss.detach())
    samples = model.eval()(**model.data_preprocessor(pseudo_collate([world.make_scene(0)])), mode='predict')
    assert samples[0].pred_bboxes_3d.isfinite().all()


def test_once_labels_judged_every_place_what_is_unknown_is_ignored(world):
    losses = [
        dict(type='VoteNetLoss'),
        dict(type='WeakSupervision', loss=dict(type='PointCrossEntropyLoss', unlabelled_weight=0.1)),
    ]
    model = build(world.config(head=dict(unlabelled_weight=0.1), losses=losses))
    names = ('loss_objectness', 'loss_wsl')

    def told(judged):
        model.set_label_statistics(LabelStatistics(np.array([1, 2, 3]), judged=judged))
        values = losses_of(model, [nothing_known(world.make_scene(0))])
        return [float(values[name].detach()) for name in names]

    first = told(False)
    assert min(first) > 0
    assert told(True) == [0.0, 0.0]
    assert told(False) == first


def test_predicted_boxes_stand_on_the_ground_where_it_is_known_and_that_is_asked(world):
    model = build(world.config() | {'on_ground': True, 'score_threshold': 0.0}).eval()
    item = world.make_scene(0)
    points = item['inputs']['points']

    def predicted():
        (sample,) = model(**model.data_preprocessor(pseudo_collate([copy.deepcopy(item)])), mode='predict')
        return sample.pred_bboxes_3d

    floating = predicted()
    item['data_samples'].pts_height = points[:, 2] + 5.0  # the ground is at -5 m
    standing = predicted()
    assert len(standing) and torch.allclose(standing[:, 2] - standing[:, 5] / 2, torch.tensor(-5.0), atol=1e-5)
    assert torch.equal(standing[:, [0, 1, 3, 4, 5, 6]], floating[:, [0, 1, 3, 4, 5, 6]])
    model.on_ground = False
    assert torch.equal(predicted(), floating)


def test_scores_ask_how_far_up_points_reach_where_that_is_asked(world):
    options = {'on_ground': True, 'score_threshold': 0.0}
    model = build(world.config() | options | {'score_by_height': True}).eval()
    item = world.make_scene(0)
    points = item['inputs']['points']

    def predicted():
        (sample,) = model(**model.data_preprocessor(pseudo_collate([copy.deepcopy(item)])), mode='predict')
        return sample.pred_bboxes_3d, sample.pred_scores_3d

    unknown = predicted()[1]  # nobody knows where the ground is
    height = (points[:, 2] - points[:, 2].min()).double().numpy()
    item['data_samples'].pts_height = torch.from_numpy(height).float()
    boxes, scores = predicted()
    model.score_by_height = False
    plain_boxes, plain = predicted()
    expected = []
    for box, score in zip(plain_boxes.double().numpy(), plain.tolist(), strict=True):
        held = np.sort(height[points_in_boxes(points[:, :3].double().numpy(), box[None]) >= 0])
        reach = held[-1] + np.diff(held, prepend=0.0).max() if len(held) else 0.0
        expected.append(score * min(reach / box[5], 1.0))
    assert scores.tolist() == pytest.approx(sorted(expected, reverse=True), abs=1e-5)
    assert torch.equal(plain, unknown) and 0 < sum(
        low < high for low, high in zip(expected, plain.tolist(), strict=True)
    )
    assert max(expected) > 0 and sorted(boxes[:, 0].tolist()) == sorted(plain_boxes[:, 0].tolist())
    with pytest.raises(ValueError, match=r'score_by_height: asks boxes that stand on the ground; set on_ground=True'):
        build(world.config() | {'score_by_height': True})
