import numpy as np
import pytest
import torch
from coloured_boxes import make_room, segmentor_config
from mmengine.dataset import pseudo_collate

from rm3d_plugin.models.segmentors.scene_inference import (
    SceneInference,
    average_views,
    by_class_frequency,
    mix_regions,
    turn,
    view_matrices,
)
from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import LabelStatistics, SceneError


def build(**changes):
    torch.manual_seed(0)
    return MODELS.build(segmentor_config(**changes)).eval()


def predict(model, *items):
    return model(**model.data_preprocessor(pseudo_collate(list(items))), mode='predict')


def test_views_by_hand():
    assert np.array_equal(view_matrices(1), np.eye(3)[None])
    turned = view_matrices(4, 'both')
    assert turned.shape == (8, 3, 3)
    assert (turned[2] @ [1.0, 2.0, 3.0]).tolist() == [-1, -2, 3] and (turned[4] @ [1.0, 2.0, 3.0]).tolist() == [
        1,
        -2,
        3,
    ]
    np.testing.assert_allclose(turned @ turned.transpose(0, 2, 1), np.tile(np.eye(3), (8, 1, 1)), atol=1e-15)
    np.testing.assert_allclose(view_matrices(3)[1][:2, 0], [-0.5, 3**0.5 / 2], atol=1e-15)
    points = torch.tensor([[1.0, 2, 3, 0.5]])
    assert turn(points, np.eye(3)) is points
    assert turn(points, turned[1]).tolist() == [[-2, 1, 3, 0.5]]


def test_vectors_are_turned_back_and_scalars_averaged():
    points = torch.rand(50, 4)
    inference = SceneInference(tta_rotations=5, flip='both')

    def look(turned):
        def values(rows):  # height, and the way to the z axis: the same from every side; x is not
            xyz = turned[rows, :3]
            return torch.cat([xyz[:, 2:], xyz[:, :1], -xyz], dim=1)

        return values

    got = average_views(points, inference.views, inference.chunks(points[:, :3].numpy()), look, scalars=2)
    torch.testing.assert_close(got[:, 0], points[:, 2])
    torch.testing.assert_close(got[:, 1], torch.zeros(50), atol=1e-6, rtol=0)  # x over all directions
    torch.testing.assert_close(got[:, 2:], -points[:, :3])


def test_one_chunk_and_one_view_are_the_same_bits_as_the_batch():
    plain, items = build(), [make_room(0), make_room(1)]
    expected = predict(plain, *items)
    plain.inference = SceneInference(max_points=10**6, tta_rotations=1, chunk_size=1e3)
    for sample, other in zip(predict(plain, *items), expected, strict=True):
        assert torch.equal(sample.pred_point_probs, other.pred_point_probs)
    plain.inference = SceneInference(chunk_size=1e3)  # not known to be whole: through the chunks, which are one
    for item, other in zip(items, expected, strict=True):
        (sample,) = predict(plain, item)
        torch.testing.assert_close(sample.pred_point_probs, other.pred_point_probs, atol=1e-6, rtol=0)
        torch.testing.assert_close(sample.pred_point_centers, other.pred_point_centers, atol=1e-6, rtol=0)
        assert torch.equal(sample.pred_instance_masks, other.pred_instance_masks)


def test_a_network_without_context_says_the_same_in_chunks():
    """One level of voxels so small that no two points meet: what is said of a point depends on the point alone."""
    backbone = dict(type='SparseUNet', voxel_size=1e-3, widths=[8], blocks=1)
    proposals = dict(radius=0.15, cluster_points=5, min_points=5)
    model = build(backbone=backbone, instance_head=dict(proposals=proposals), thing_classes=[0, 1, 2])
    item = make_room(0)
    (expected,) = predict(model, item)
    model.inference = SceneInference(max_points=600, margin=0.5)
    (sample,) = predict(model, item)
    torch.testing.assert_close(sample.pred_point_probs, expected.pred_point_probs, atol=1e-5, rtol=0)
    torch.testing.assert_close(sample.pred_point_centers, expected.pred_point_centers, atol=1e-5, rtol=0)
    assert len(expected.pred_instance_masks) and sample.pred_instance_masks.shape[1] == 1700
    largest = expected.pred_instance_masks[expected.pred_instance_masks.sum(dim=1).argmax()]
    union = [(mask & largest).sum() / (mask | largest).sum() for mask in sample.pred_instance_masks]
    assert max(union) > 0.9  # cut by the chunks and stitched again


def test_small_scenes_in_chunks_and_views():
    model = build(inference=dict(max_points=3, tta_rotations=2, flip='both'))
    item = make_room(0)
    for count in (1, 2, 7):
        few = {**item, 'inputs': {'points': item['inputs']['points'][:count]}}
        (sample,) = predict(model, few)
        assert sample.pred_point_probs.shape == (count, 3) and torch.isfinite(sample.pred_point_probs).all()
        torch.testing.assert_close(sample.pred_point_probs.sum(dim=1), torch.ones(count))


def test_pseudo_labels_are_predicted_from_one_side():
    model, plain = build(inference=dict(tta_rotations=4)), build()
    model.predict_points = plain.predict_points = True
    (sample,), (other,) = predict(model, make_room(0)), predict(plain, make_room(0))
    torch.testing.assert_close(sample.pred_point_probs, other.pred_point_probs, atol=1e-6, rtol=0)


def test_the_first_angle_turns_every_view_and_is_the_same_as_a_turned_scene():
    np.testing.assert_allclose(view_matrices(2, 'none', 30.0)[0][:2, 0], [3**0.5 / 2, 0.5], atol=1e-15)
    np.testing.assert_allclose(view_matrices(2, 'none', 30.0)[1][:2, 0], [-(3**0.5) / 2, -0.5], atol=1e-15)
    item = make_room(0)
    turned_item = {**item, 'inputs': {'points': turn(item['inputs']['points'], view_matrices(1, 'none', 30.0)[0])}}
    model, plain = build(inference=dict(first_angle=30.0)), build()
    (sample,), (other,) = predict(model, item), predict(plain, turned_item)
    torch.testing.assert_close(sample.pred_point_probs, other.pred_point_probs, atol=1e-6, rtol=0)
    centers = turn(sample.pred_point_centers, view_matrices(1, 'none', 30.0)[0])  # found in the scene's own frame
    torch.testing.assert_close(centers, other.pred_point_centers, atol=1e-5, rtol=0)
    assert not torch.equal(predict(plain, item)[0].pred_point_probs, sample.pred_point_probs)
    model.predict_points = True  # the next labels come from the same side
    torch.testing.assert_close(predict(model, item)[0].pred_point_probs, sample.pred_point_probs)


def test_a_large_scene_is_never_held_by_the_network():
    seen, points = [], torch.rand(200_000, 3) * torch.tensor([80.0, 50.0, 3.0])
    inference = SceneInference(max_points=20_000)

    def look(turned):
        def values(rows):
            seen.append(len(rows))
            return turned[rows].cos()

        return values

    chunks = inference.chunks(points.numpy())
    got = average_views(points, inference.views, chunks, look, scalars=3)
    torch.testing.assert_close(got, points.cos(), atol=1e-6, rtol=0)
    assert max(seen) <= 20_000 and len(seen) == len(chunks) < 30


def test_points_are_drawn_towards_the_mean_of_their_region():
    probs, regions = torch.rand(60, 3), torch.from_numpy(np.random.default_rng(0).integers(-1, 5, 60))
    slow = probs.clone()
    for row, region in enumerate(regions.tolist()):
        if region >= 0:
            slow[row] = 0.3 * probs[row] + 0.7 * probs[regions == region].mean(dim=0)
    torch.testing.assert_close(mix_regions(probs, regions, 0.7), slow)
    assert torch.equal(mix_regions(probs, torch.full((60,), -1), 1.0), probs)
    assert mix_regions(probs[:0], regions[:0], 1.0).shape == (0, 3)


def test_regions_speak_at_test_time_and_not_for_pseudo_labels():
    model, plain, item = build(inference=dict(superpoint_smoothing=1.0)), build(), make_room(0)
    with pytest.raises(SceneError, match='room_0: inference.superpoint_smoothing wants pts_region'):
        predict(model, item)
    regions = torch.arange(len(item['inputs']['points'])) // 100
    item['data_samples'].pts_region = regions
    own = predict(plain, item)[0].pred_point_probs
    torch.testing.assert_close(predict(model, item)[0].pred_point_probs, mix_regions(own, regions, 1.0))
    model.predict_points = True
    torch.testing.assert_close(predict(model, item)[0].pred_point_probs, own)


def test_rare_classes_are_said_more_rarely_by_a_prior():
    model, plain, item = build(inference=dict(logit_adjustment=0.3)), build(), make_room(0)
    own = predict(plain, item)[0].pred_point_probs
    torch.testing.assert_close(predict(model, item)[0].pred_point_probs, own)  # nobody told any counts
    model.set_label_statistics(LabelStatistics(np.array([1000, 10, 0])))
    weighed = own.double() * torch.tensor([1000**0.3, 10**0.3, 1.0])
    expected = (weighed / weighed.sum(dim=1, keepdim=True)).float()
    torch.testing.assert_close(predict(model, item)[0].pred_point_probs, expected)
    torch.testing.assert_close(by_class_frequency(own, torch.tensor([1000.0, 10, 0]), 0.3), expected)
    model.predict_points = True
    torch.testing.assert_close(predict(model, item)[0].pred_point_probs, own)


@pytest.mark.parametrize(
    ('settings', 'told'),
    [
        (dict(tta_rotations=0), 'tta_rotations: expected a whole number from 1'),
        (dict(max_points=0), 'max_points: expected a whole number'),
        (dict(chunk_size=0.0), 'chunk_size: expected metres > 0'),
        (dict(margin=-1.0), 'margin >= 0'),
        (dict(logit_adjustment=-1.0), 'logit_adjustment: expected a number from 0, got -1.0'),
        (dict(superpoint_smoothing=1.5), 'superpoint_smoothing: expected a share from 0 to 1, got 1.5'),
        (dict(first_angle=float('nan')), 'first_angle: expected degrees, got nan'),
    ],
)
def test_bad_settings_are_told(settings, told):
    with pytest.raises(ValueError, match=told):
        build(inference=settings)
