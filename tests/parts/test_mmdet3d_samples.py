"""Samples of mmdetection3d teach and score as our own do: the same numbers, or a message; never nothing."""

import numpy as np
import pytest
import torch
from mmengine.structures import InstanceData
from parts.layout import packed

from rm3d_plugin.evaluation import InstanceSegMetric, SemSegMetric
from rm3d_plugin.models.heads import join_labels, join_point_labels
from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import (
    Boxes3D,
    SceneError,
    SceneSample,
    box_rows,
    evaluated_fields,
    is_nested,
    sample_fields,
)

ROWS = torch.tensor([[1.0, 2.0, 3.0, 4.0, 2.0, 1.0, 0.6], [9.0, 0.0, 1.0, 1.0, 1.0, 2.0, 0.0]])
OFFSETS = torch.tensor([0, 2, 3])
XYZ = torch.tensor([[1.0, 2.0, 3.2], [9.2, 0.0, 0.2], [5.0, 5.0, 5.0]])


@pytest.mark.parametrize('kind', ['LiDARInstance3DBoxes', 'DepthInstance3DBoxes'])
def test_boxes_are_read_about_their_middle(layout, kind):
    boxes = getattr(layout, kind)(ROWS, origin=(0.5, 0.5, 0.5))
    assert boxes.tensor[0, 2] == 2.5  # of the bottom face
    np.testing.assert_allclose(box_rows(boxes), ROWS)
    np.testing.assert_allclose(Boxes3D(boxes, np.array([0, 1])).tensor, ROWS.double())
    moving = getattr(layout, kind)(torch.cat([ROWS, torch.ones(2, 2)], dim=1), box_dim=9, origin=(0.5, 0.5, 0.5))
    assert Boxes3D(moving, np.array([0, 1])).tensor.shape == (2, 7)
    assert len(Boxes3D(getattr(layout, kind)(torch.zeros(0, 7)), np.zeros(0, dtype=int))) == 0


def test_boxes_of_a_camera_are_refused(layout):
    with pytest.raises(ValueError, match=r'CameraInstance3DBoxes: expected boxes that turn about z; call convert_to'):
        Boxes3D(layout.CameraInstance3DBoxes(ROWS), np.array([0, 1]))


def test_fields_go_by_our_names(layout):
    boxes = layout.DepthInstance3DBoxes(ROWS, origin=(0.5, 0.5, 0.5))
    sample = packed(layout, 7, boxes, torch.tensor([2, 0]), pts_semantic_mask=torch.tensor([0, 1, 3]))
    fields = sample_fields(sample)
    assert is_nested(sample) and not is_nested(SceneSample(pts_semantic_mask=torch.tensor([1])))
    assert fields['scene_id'] == '7' and fields['gt_labels_3d'].tolist() == [2, 0]
    assert torch.equal(fields['gt_bboxes_3d'], ROWS) and fields['pts_semantic_mask'].tolist() == [0, 1, 3]
    assert 'pts_instance_mask' not in fields and 'eval_ann_info' not in fields
    assert sample_fields(sample.to_dict()).keys() == fields.keys()  # as metrics get it
    sample.set_metainfo({'lidar_path': '/data/points/scene0001_00.bin'})
    assert sample_fields(sample)['scene_id'] == 'scene0001_00'
    own = SceneSample(metainfo={'scene_id': 'a'}, pts_semantic_mask=torch.tensor([1]))
    assert sample_fields(own).keys() == {'scene_id', 'pts_semantic_mask'}


def test_the_truth_of_eval_ann_info_is_for_metrics_alone(layout):
    sample = packed(layout, 7, pts_semantic_mask=torch.tensor([0, 1]))
    boxes = layout.DepthInstance3DBoxes(ROWS, origin=(0.5, 0.5, 0.5))
    sample.eval_ann_info = {'pts_semantic_mask': np.array([1, 1]), 'gt_bboxes_3d': boxes, 'gt_labels_3d': np.array([1])}
    assert sample_fields(sample)['pts_semantic_mask'].tolist() == [0, 1] and 'gt_bboxes_3d' not in sample_fields(sample)
    truth = evaluated_fields(sample)
    assert truth['pts_semantic_mask'].tolist() == [1, 1] and torch.equal(truth['gt_bboxes_3d'], ROWS)


def test_point_labels_are_those_of_our_own_samples(layout):
    masks = [dict(pts_semantic_mask=torch.tensor([0, 3]), pts_instance_mask=torch.tensor([5, 6])), {}]
    nested = [packed(layout, i, **fields) for i, fields in enumerate(masks)]
    got = join_point_labels(nested, OFFSETS, 3, ignore_index=3)
    own = SceneSample(pts_semantic_mask=torch.tensor([0, -1]), pts_instance_mask=torch.tensor([5, -1]))
    expected = join_point_labels([own, SceneSample()], OFFSETS, 3)
    assert all(torch.equal(a, b) for a, b in zip(got, expected, strict=True) if a is not None)
    assert got.semantic.tolist() == [0, -1, -1] and got.instance.tolist() == [0, -1, -1]
    with pytest.raises(SceneError, match=r'expected -1..2, got class 3; .* as in mmdetection3d, give .*ignore_index'):
        join_point_labels(nested, OFFSETS, 3)


def test_points_in_the_boxes_of_a_scene_are_theirs(layout):
    boxes = layout.DepthInstance3DBoxes(ROWS, origin=(0.5, 0.5, 0.5))
    nested = packed(layout, 0, boxes, torch.tensor([1, 0]), pts_instance_mask=torch.tensor([17, 40]))
    own = SceneSample(
        gt_bboxes_3d=ROWS,
        gt_labels_3d=torch.tensor([1, 0]),
        pts_semantic_mask=torch.tensor([1, 0, 2]),
        pts_instance_mask=torch.tensor([0, 1, -1]),
    )
    got, expected = (join_labels([sample], torch.tensor([0, 3]), XYZ, 2) for sample in (nested, own))
    assert all(torch.equal(a, b) for a, b in zip(got[:-2], expected[:-2], strict=True))
    assert got.targets is None and got.fit_pairs is None  # without proposals


SEGMENTOR = dict(
    type='RM3DSegmentor',
    num_classes=3,
    ignore_index=3,
    inputs=dict(columns=['rgb']),
    backbone=dict(type='SparseUNet', voxel_size=0.2, widths=[8, 12], blocks=1),
    instance_head=dict(),
    thing_classes=[1],
)
DETECTOR = dict(
    type='RM3DVoteNet',
    num_classes=2,
    backbone=dict(type='SparseUNet', voxel_size=0.2, widths=[8, 12], blocks=1),
    vote_head=dict(num_seeds=64, num_proposals=8, hidden=16, radius=0.6),
)


def built(config):
    torch.manual_seed(0)
    return MODELS.build(config)


def scene(columns, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(300, columns, generator=generator) * torch.tensor([4.0, 4.0, 2.0] + [1.0] * (columns - 3))


def losses(model, points, samples):
    return model(**model.data_preprocessor({'inputs': {'points': points}, 'data_samples': samples}), mode='loss')


def test_the_segmentor_learns_from_both_alike(layout):
    points = [scene(6), scene(6, 1)]
    classes = [torch.arange(300) % 4, torch.arange(300) % 2]
    instances = [torch.arange(300) // 100, torch.arange(300) // 150]
    nested = [
        packed(layout, i, pts_semantic_mask=a, pts_instance_mask=b)
        for i, (a, b) in enumerate(zip(classes, instances, strict=True))
    ]
    own = [
        SceneSample(pts_semantic_mask=torch.where(a < 3, a, -1), pts_instance_mask=torch.where(a < 3, b, -1))
        for a, b in zip(classes, instances, strict=True)
    ]
    got, expected = losses(built(SEGMENTOR), points, nested), losses(built(SEGMENTOR), points, own)
    assert got.keys() == expected.keys() == {'loss_wsl', 'loss_offset', 'loss_dice'}
    for name in got:
        assert torch.equal(got[name], expected[name]) and got[name] != 0, name


def test_the_detector_learns_from_boxes_of_mmdetection3d(layout):
    points = scene(4)
    rows = torch.tensor([[1.0, 1.0, 1.0, 1.5, 1.5, 1.5, 0.0], [3.0, 3.0, 1.0, 1.0, 1.0, 1.0, 0.3]])
    boxes = layout.LiDARInstance3DBoxes(rows, origin=(0.5, 0.5, 0.5))
    got = losses(built(DETECTOR), [points], [packed(layout, 0, boxes, torch.tensor([0, 1]))])
    assert got['loss_vote'] > 0 and got['loss_wsl'] > 0 and got['loss_center'] > 0


@pytest.mark.parametrize(('config', 'columns'), [(SEGMENTOR, 6), (DETECTOR, 4)])
def test_a_batch_without_a_known_field_is_refused(layout, config, columns):
    points = [scene(columns)]
    foreign = SceneSample(gt_sem=torch.zeros(300))
    for sample in (packed(layout, 0), foreign, SceneSample()):
        with pytest.raises(SceneError, match='no sample of the batch has .*pts_semantic_mask.*nothing would be learnt'):
            losses(built(config), points, [sample])
    with pytest.raises(SceneError, match='it has gt_sem. Expected the fields of SceneSample, or gt_pts_seg'):
        losses(built(config), points, [foreign])
    with pytest.raises(ValueError, match='data_samples: expected 1, one a scene, got 0'):
        losses(built(config), points, None)


def test_one_sample_with_labels_is_enough(layout):
    points = [scene(6), scene(6, 1)]
    known = packed(layout, 0, pts_semantic_mask=torch.zeros(300, dtype=torch.int64))
    assert losses(built(SEGMENTOR), points, [known, packed(layout, 1)])['loss_wsl'] > 0


def test_points_may_come_as_another_preprocessor_leaves_them(layout):
    sample = packed(layout, 0, pts_semantic_mask=torch.arange(300) % 4)
    model = built(SEGMENTOR)
    joined = losses(model, [scene(6)], [sample])
    assert torch.equal(model({'points': [scene(6)]}, [sample], mode='loss')['loss_wsl'], joined['loss_wsl'])
    with pytest.raises(
        SceneError, match=r'inputs.points: expected a list of \(n, D\) tensors, one a scene, got Tensor'
    ):
        model({'points': scene(6)[None]}, [sample], mode='loss')


def test_predictions_lie_in_both_layouts(layout):
    sample = packed(layout, 0, pts_semantic_mask=torch.arange(300) % 4, pts_instance_mask=torch.arange(300))
    model = built(SEGMENTOR).eval()
    batch = model.data_preprocessor({'inputs': {'points': [scene(6)]}, 'data_samples': [sample]})
    (got,) = model(**batch, mode='predict')
    assert torch.equal(got.pred_pts_seg.pts_semantic_mask, got.pred_point_probs.argmax(1))
    assert got.pred_pts_seg.pts_instance_mask.shape == got.pred_instance_masks.shape
    detector = built(DETECTOR).eval()
    sample = packed(layout, 0)
    batch = detector.data_preprocessor({'inputs': {'points': [scene(4)]}, 'data_samples': [sample]})
    (got,) = detector(**batch, mode='predict')
    found = got.pred_instances_3d
    assert len(found.bboxes_3d) == len(found.labels_3d) == len(got.pred_bboxes_3d) > 0
    assert isinstance(found.bboxes_3d, layout.DepthInstance3DBoxes)
    np.testing.assert_allclose(box_rows(found.bboxes_3d), got.pred_bboxes_3d, atol=1e-6)


def test_metrics_read_predictions_and_truth_of_mmdetection3d(layout):
    truth, said = np.array([0, 0, 1, 1, 2]), torch.tensor([0, 1, 1, 1, 0])
    sample = packed(layout, 0)
    sample.eval_ann_info = {'pts_semantic_mask': truth}
    sample.pred_pts_seg = layout.PointData(pts_semantic_mask=said)
    own = SceneSample(pts_semantic_mask=torch.tensor([0, 0, 1, 1, -1]), pred_pts_semantic_mask=said)
    scores = []
    for meta, one in ((dict(classes=('a', 'b'), ignore_index=2), sample), (dict(classes=('a', 'b')), own)):
        metric = SemSegMetric()
        metric.dataset_meta = meta
        metric.process({}, [one.to_dict()])
        scores.append(metric.evaluate(1))
    assert scores[0] == scores[1] and scores[0]['IoU_b'] == pytest.approx(200 / 3)


def test_instance_metrics_read_them_too(layout):
    sample = packed(layout, 0)
    masks = torch.tensor([[1, 1, 0, 0], [0, 0, 1, 1]], dtype=torch.bool)
    sample.eval_ann_info = {'pts_semantic_mask': np.zeros(4, int), 'pts_instance_mask': np.array([0, 0, 1, 1])}
    sample.pred_pts_seg = layout.PointData(
        pts_instance_mask=masks, instance_labels=torch.tensor([0, 0]), instance_scores=torch.tensor([0.9, 0.8])
    )
    metric = InstanceSegMetric(classes=('a',), min_points=1)
    metric.process({}, [sample.to_dict()])
    assert metric.evaluate(1)['AP'] == 100


def test_predictions_of_other_models_are_read(layout):
    sample = packed(layout, 0)
    boxes = layout.LiDARInstance3DBoxes(ROWS, origin=(0.5, 0.5, 0.5))
    sample.pred_instances_3d = InstanceData(
        bboxes_3d=boxes, labels_3d=torch.tensor([0, 1]), scores_3d=torch.tensor([1.0, 0.5])
    )
    fields = evaluated_fields(sample.to_dict())
    assert torch.equal(fields['pred_bboxes_3d'], ROWS) and fields['pred_scores_3d'].tolist() == [1.0, 0.5]
