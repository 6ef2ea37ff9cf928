"""Transforms keep points, labels and boxes in step; every number from the item's generator."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from rm3d_plugin.datasets.transforms import (
    AugmentedView,
    DropGround,
    GlobalRotScale,
    LabelledObjectPaste,
    LimitPoints,
    RandomFlipY,
    ViewSettings,
    augmented_view,
    flip_y,
    pack_scene,
    rotate_scale,
    select_points,
)
from rm3d_plugin.datasets.transforms.augmented_view import elastic_shift
from rm3d_plugin.datasets.transforms.geometric import wrap_yaw
from rm3d_plugin.datasets.transforms.paste import Places, is_free, labelled_objects, moved, paste, put_on_ground
from rm3d_plugin.label_budgets import BudgetError, check_objects
from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.registry import TRANSFORMS
from rm3d_plugin.structures import Boxes3D

BOX = np.array([5.0, 2, 0, 4, 2, 1.5, 0.3])


def item(n=40, boxes=None, seed=0):
    """n points, the first half in the first box."""
    rng = np.random.default_rng(seed)
    boxes = np.array([BOX]) if boxes is None else boxes
    xyz = rng.uniform(-20, 20, size=(n, 3))
    if len(boxes):
        xyz[: n // 2] = boxes[0, :3] + rng.uniform(-0.5, 0.5, size=(n // 2, 3))
    inside = points_in_boxes(xyz.astype(np.float32), boxes)
    return {
        'scene_id': 's',
        'index': 0,
        'num_points': n,
        'points': np.c_[xyz, rng.random(n)].astype(np.float32),
        'point_index': np.arange(n),
        'semantic': np.where(inside >= 0, 1, -1),
        'instance': inside,
        'is_annotated': inside >= 0,
        'boxes': boxes,
        'box_labels': np.ones(len(boxes), dtype=np.int64),
        'box_is_annotated': np.ones(len(boxes), dtype=bool),
        'rng': np.random.default_rng(seed + 100),
    }


# ---------------------------------------------------------------------- flips and turns


def test_flip_by_hand():
    points = np.array([[1, 2, 3, 0.5]], dtype=np.float32)
    moved = flip_y(points, BOX[None])
    assert moved.points.tolist() == [[1, -2, 3, 0.5]]
    assert moved.points.dtype == np.float32
    np.testing.assert_array_equal(moved.boxes, [[5, -2, 0, 4, 2, 1.5, -0.3]])
    assert points[0, 1] == 2  # the input stays


def test_flip_twice_is_nothing_bit_for_bit():
    results = item(boxes=np.random.default_rng(0).uniform(0.1, 3, size=(9, 7)))
    twice = flip_y(*flip_y(results['points'], results['boxes']))
    np.testing.assert_array_equal(twice.points, results['points'])
    np.testing.assert_array_equal(twice.boxes, results['boxes'])


def test_quarter_turn_by_hand():
    moved = rotate_scale(np.array([[1, 0, 2, 0.7]], np.float32), np.array([[1.0, 0, 2, 4, 2, 1, 3.0]]), np.pi / 2, 2.0)
    np.testing.assert_allclose(moved.points, [[0, 2, 4, 0.7]], atol=1e-6)
    np.testing.assert_allclose(moved.boxes, [[0, 2, 4, 8, 4, 2, 3.0 + np.pi / 2 - 2 * np.pi]], atol=1e-12)


@settings(derandomize=True, max_examples=60, deadline=None)
@given(st.floats(-7, 7), st.floats(0.5, 2), st.booleans(), st.floats(-np.pi, 3.14))
def test_points_stay_in_their_boxes_whatever_moves(angle, scale, flip, yaw):
    box = BOX.copy()
    box[6] = yaw
    # points on a shell just inside and just outside of every face, in float64
    unit = np.array([[s * (i == 0), s * (i == 1), s * (i == 2)] for i in range(3) for s in (-0.5, 0.5)])
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    shell = np.concatenate([(unit * box[3:6] * k) @ turn.T + box[:3] for k in (0.999, 1.001)])
    points, boxes = shell, box[None]
    if flip:
        points, boxes = flip_y(points, boxes)
    points, boxes = rotate_scale(points, boxes, angle, scale)
    assert points_in_boxes(points, boxes).tolist() == [0] * 6 + [-1] * 6
    assert -np.pi <= boxes[0, 6] < np.pi


def test_yaw_stays_in_its_interval():
    yaw = np.array([-np.pi, np.pi, 3 * np.pi, 0.1, np.nextafter(np.pi, 0), -4.0, 1e-300, np.nextafter(-np.pi, -4)])
    wrapped = wrap_yaw(yaw)
    assert ((wrapped >= -np.pi) & (wrapped < np.pi)).all()
    np.testing.assert_array_equal(wrapped[[0, 3, 4, 6]], yaw[[0, 3, 4, 6]])
    np.testing.assert_allclose(np.exp(1j * wrapped), np.exp(1j * yaw), atol=1e-12)


def test_flip_probability():
    assert RandomFlipY(0)(item())['boxes'][0, 1] == 2
    assert RandomFlipY(1)(item())['boxes'][0, 1] == -2
    flipped = sum(RandomFlipY(0.3)(item(seed=i))['boxes'][0, 1] == -2 for i in range(400))
    assert 90 < flipped < 150


def test_global_motion_stays_in_range_and_needs_no_boxes():
    for seed in range(20):
        start, moved = item(seed=seed), GlobalRotScale(rot=(0.1, 0.2), scale=(1.1, 1.2))(item(seed=seed))
        assert 0.3 + 0.1 <= moved['boxes'][0, 6] <= 0.3 + 0.2
        ratio = np.linalg.norm(moved['points'][:, :3], axis=1) / np.linalg.norm(start['points'][:, :3], axis=1)
        assert np.allclose(ratio, ratio[0], rtol=1e-5)
        assert 1.1 <= ratio[0] <= 1.2
    bare = {'points': item()['points'], 'rng': np.random.default_rng(0)}
    assert set(GlobalRotScale()(bare)) == {'points', 'rng'}


# ---------------------------------------------------------------------- fewer points


def test_limit_keeps_rows_together_in_order():
    start, kept = item(50), LimitPoints(20)(item(50))
    index = kept['point_index']
    assert len(index) == 20
    assert (np.diff(index) > 0).all()
    for name in ('points', 'semantic', 'instance', 'is_annotated'):
        np.testing.assert_array_equal(kept[name], start[name][index])
    assert kept['num_points'] == 50
    assert len(LimitPoints(50)(item(50))['points']) == 50


def test_maps_of_two_steps_compose():
    start = item(60)
    twice = LimitPoints(10)(LimitPoints(30)(start))
    np.testing.assert_array_equal(twice['points'], item(60)['points'][twice['point_index']])


def test_ground_goes_objects_stay():
    rng = np.random.default_rng(0)
    ground = np.c_[rng.uniform(-20, 20, size=(4000, 2)), rng.normal(0, 0.02, 4000)]
    post = np.c_[np.full((30, 2), 3.3), np.linspace(0.5, 2, 30)]
    xyz = np.concatenate([ground, post])
    results = {'points': np.c_[xyz, xyz[:, 0]].astype(np.float32), 'point_index': np.arange(len(xyz))}
    kept = DropGround()(results)
    assert kept['point_index'].tolist() == list(range(4000, 4030))
    np.testing.assert_allclose(kept['ground_height'], post[:, 2], atol=0.05)
    larger = GlobalRotScale(rot=(0.5, 0.5), scale=(1.1, 1.1))(kept | {'rng': rng})
    packed = pack_scene(larger | {'scene_id': 'a', 'num_points': len(xyz)})['data_samples']
    np.testing.assert_allclose(packed.pts_height.numpy(), 1.1 * post[:, 2], atol=0.06)
    np.testing.assert_array_equal(kept['points'], results['points'][4000:])


def test_a_scene_of_nothing_but_ground_keeps_it():
    rng = np.random.default_rng(0)
    results = {'points': np.c_[rng.uniform(-9, 9, size=(900, 2)), np.zeros(900), np.zeros(900)].astype(np.float32)}
    assert len(DropGround()(results)['points']) == 900


# ---------------------------------------------------------------------- second view


def test_the_view_maps_back_to_its_points_exactly():
    points = item(500)['points']
    still = ViewSettings(rot=(0.7, 0.7), flip_prob=0, scale=(1.1, 1.1), jitter=0, keep=(0.6, 0.6), channel_jitter=0)
    view = augmented_view(points, still, np.random.default_rng(1))
    assert len(view.point_ids) == 300
    assert (np.diff(view.point_ids) > 0).all()
    source = points[view.point_ids]
    np.testing.assert_array_equal(view.points[:, 3], source[:, 3])
    middle = 0.5 * (source[:, :3].min(axis=0) + source[:, :3].max(axis=0))
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    np.testing.assert_allclose(view.points[:, :3], 1.1 * (source[:, :3] - middle) @ turn.T + middle, atol=1e-4)
    mirrored = augmented_view(points, ViewSettings((0, 0), 1, (1, 1), 0, (1, 1), None, 0), np.random.default_rng(1))
    middle = 0.5 * (points[:, :3].min(axis=0) + points[:, :3].max(axis=0))
    np.testing.assert_allclose(mirrored.points[:, :2], 2 * middle[:2] - points[:, :2], atol=1e-4)
    np.testing.assert_allclose(mirrored.points[:, 2:], points[:, 2:], atol=1e-5)


@pytest.mark.parametrize('seed', range(8))
def test_the_view_keeps_to_the_ranges_of_the_method(seed):
    points = item(800, seed=seed)['points']
    view = augmented_view(points, ViewSettings(), np.random.default_rng(seed))
    assert 0.5 <= len(view.point_ids) / 800 <= 0.8
    rng = np.random.default_rng(0)
    a, b = rng.integers(0, len(view.point_ids), size=(2, 400))
    before = np.linalg.norm(points[view.point_ids[a], :3] - points[view.point_ids[b], :3], axis=1)
    after = np.linalg.norm(view.points[a, :3] - view.points[b, :3], axis=1)
    far = before > 1
    ratio = after[far] / before[far]
    assert 0.9 - 0.06 <= ratio.min() <= ratio.max() <= 1.1 + 0.06
    assert np.ptp(ratio) < 0.1  # one scale for all, up to jitter
    assert view.points.dtype == np.float32
    assert 0 <= view.points[:, 3].min() <= view.points[:, 3].max() <= 1


def test_jitter_is_small_and_bounded():
    points = np.zeros((20000, 3), np.float32)
    view = augmented_view(points, ViewSettings(keep=(1, 1)), np.random.default_rng(0))
    assert np.abs(view.points).max() <= 0.015 + 1e-6
    np.testing.assert_allclose(view.points.std(axis=0), 0.005, rtol=0.05)


def test_elastic_shifts_are_smooth_and_bounded():
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 10, size=(3000, 3))
    shift = elastic_shift(xyz, 1.0, 0.2, np.random.default_rng(1))
    assert 0.05 < np.abs(shift).max() <= 0.2
    near = elastic_shift(np.concatenate([xyz, xyz + 0.01]), 1.0, 0.2, np.random.default_rng(1))
    assert np.abs(near[:3000] - near[3000:]).max() < 0.02
    assert elastic_shift(np.zeros((0, 3)), 1.0, 0.2, rng).shape == (0, 3)
    assert np.isfinite(elastic_shift(np.ones((5, 3)), 1.0, 0.2, rng)).all()
    wide = np.array([[0.0, 0, 0], [1e4, 1e4, 10]])
    assert np.isfinite(elastic_shift(wide, 0.1, 0.2, rng)).all()  # no grid of 10^13 nodes


@pytest.mark.parametrize('count', [0, 1, 2])
def test_views_of_tiny_scenes(count):
    view = augmented_view(item(10)['points'][:count], ViewSettings(elastic=(1, 0.1)), np.random.default_rng(0))
    assert view.points.shape == (min(count, max(1, len(view.point_ids))), 4)
    assert len(view.point_ids) >= min(count, 1)


def test_nothing_moves_points_after_the_view_was_taken():
    seen = AugmentedView()(item())
    for step in (LimitPoints(3), RandomFlipY(1), GlobalRotScale()):
        with pytest.raises(ValueError, match='move AugmentedView behind'):
            step(seen)


def test_equal_generators_give_equal_views_and_the_scene_stays():
    one, two = AugmentedView(elastic=(1, 0.1))(item()), AugmentedView(elastic=(1, 0.1))(item())
    (first,), (second,) = one['views'], two['views']
    np.testing.assert_array_equal(first.points, second.points)
    np.testing.assert_array_equal(first.point_ids, second.point_ids)
    np.testing.assert_array_equal(one['points'], item()['points'])


def test_some_scenes_get_no_second_view():
    half = AugmentedView(prob=0.5)
    sizes = [len(half(item(6) | {'rng': np.random.default_rng(seed)})['views'][0].points) for seed in range(200)]
    assert 70 < sizes.count(0) < 130
    assert half(item(6) | {'rng': np.random.default_rng(sizes.index(0))})['views'][0].point_ids.shape == (0,)
    assert len(AugmentedView(prob=0.0)(item(6))['views'][0].points) == 0


def test_each_further_transform_appends_a_view():
    two = AugmentedView(keep=(0.5, 0.5))(AugmentedView(keep=(1, 1))(item(8)))
    assert [len(view.points) for view in two['views']] == [8, 4]
    alone = AugmentedView(keep=(1, 1))(item(8))
    np.testing.assert_array_equal(two['views'][0].points, alone['views'][0].points)
    packed = pack_scene(two)['inputs']['views']
    assert [view['points'].shape for view in packed] == [(8, 4), (4, 4)]
    np.testing.assert_array_equal(packed[1]['point_ids'], two['views'][1].point_ids)


@pytest.mark.parametrize(
    'options',
    [
        {'keep': (0.0, 0.5)},
        {'keep': (0.5, 1.5)},
        {'scale': (1.2, 0.9)},
        {'jitter': -1},
        {'elastic': (0, 1)},
        {'flip_prob': 2},
    ],
)
def test_wrong_settings_are_refused(options):
    with pytest.raises(ValueError, match='AugmentedView'):
        AugmentedView(**options)


# ---------------------------------------------------------------------- pasting objects

CAR = np.array([10.0, 0, -0.95, 4, 2, 1.5, 0.2])  # stands on the ground at -1.7


def street(boxes, annotated=None, seed=0, height=0.0):
    """Level ground 60 m ahead, 1.7 m under the sensor (``height`` lifts all), and 40 points on each box's roof."""
    rng = np.random.default_rng(seed)
    ground = np.c_[rng.uniform(0, 60, 6000), rng.uniform(-30, 30, 6000), np.full(6000, -1.7)]
    boxes = np.asarray(boxes, dtype=np.float64).reshape(-1, 7) + [0, 0, height, 0, 0, 0, 0]
    roofs = [np.c_[box[:2] + rng.uniform(-0.7, 0.7, size=(40, 2)), np.full(40, box[2] + 0.7)] for box in boxes]
    xyz = np.concatenate([ground + [0, 0, height], *roofs])
    inside = points_in_boxes(xyz, boxes)
    return {
        'scene_id': 's',
        'index': 0,
        'num_points': len(xyz),
        'points': np.c_[xyz, rng.random(len(xyz))].astype(np.float32),
        'point_index': np.arange(len(xyz)),
        'semantic': np.where(inside >= 0, 1, -1),
        'instance': inside,
        'is_annotated': inside >= 0,
        'boxes': boxes,
        'box_labels': np.ones(len(boxes), dtype=np.int64),
        'box_is_annotated': np.ones(len(boxes), dtype=bool) if annotated is None else np.array(annotated),
        'rng': np.random.default_rng(seed + 100),
    }


def test_only_annotated_boxes_are_objects_and_ground_is_no_part_of_them():
    results = street([CAR, CAR + [15, 5, 0, 0, 0, 0, 0]], annotated=[True, False])
    found = labelled_objects(results)
    assert len(found) == 1
    np.testing.assert_array_equal(found[0].box, CAR)
    np.testing.assert_array_equal(found[0].points, results['points'][6000:6040])
    assert labelled_objects(results, min_points=41) == []


def test_pasting_by_hand():
    target, box = street([]), np.array([40.0, 0, -1.0, 4, 2, 1.5, 0])  # 5 cm into the ground
    in_box = points_in_boxes(target['points'][:, :3], box[None]) >= 0
    assert in_box.any()
    source = labelled_objects(street([CAR]))[0]._replace(box=box)
    assert is_free(target, box)
    out = paste(target, source)
    assert len(out['points']) == 6000 - in_box.sum() + 40
    assert out['point_index'].tolist() == np.flatnonzero(~in_box).tolist() + [-1] * 40
    assert out['instance'][-40:].tolist() == [0] * 40
    assert out['semantic'][-40:].tolist() == [1] * 40
    assert out['is_annotated'][-40:].all()
    np.testing.assert_array_equal(out['boxes'], box[None])
    np.testing.assert_array_equal(out['points'][-40:], source.points)
    assert out['box_labels'].tolist() == [1]
    assert out['box_is_annotated'].tolist() == [True]
    assert not is_free(out, box)
    assert pack_scene(out)['data_samples'].point_index.dtype == torch.int64


def test_a_place_with_points_or_a_box_is_taken():
    target = street([])
    target['points'][7, :3] = [40, 0, -0.5]  # some object nobody labelled
    far = np.array([40.0, 0, -0.95, 4, 2, 1.5, 0])
    assert not is_free(target, far)
    boxed = street([far + [0, 1.9, 0, 0, 0, 0, 0]])
    assert not is_free(boxed, far)
    assert is_free(boxed, far - [0, 0.9, 0, 0, 0, 0, 0])


def test_a_moved_object_keeps_its_shape_and_turns_about_the_sensor():
    source = labelled_objects(street([CAR]))[0]
    for seed in range(30):
        new = moved(source, Places(), np.random.default_rng(seed))
        distance = np.hypot(*new.box[:2])
        assert 10 <= distance <= 20
        assert -0.7 <= np.arctan2(new.box[1], new.box[0]) <= 0.7
        np.testing.assert_array_equal(new.box[2:6], CAR[2:6])
        assert 1 <= len(new.points) <= 40
        assert (points_in_boxes(new.points[:, :3], new.box[None]) == 0).all()
        # the sensor sees it from the same side, or from the mirrored one
        seen = new.box[6] - np.arctan2(new.box[1], new.box[0])
        assert abs(seen) == pytest.approx(0.2, abs=1e-9)
    still = moved(source, Places(bearing=(0, 0), farther=1), np.random.default_rng(0))
    assert len(still.points) == 40
    thinned = [len(moved(source, Places((0, 0), 2, 20), np.random.default_rng(i)).points) for i in range(100)]
    assert 0.25 * 40 < np.mean(thinned) < 40


def test_objects_are_put_on_the_ground_of_the_scene():
    source = labelled_objects(street([CAR]))[0]
    scene = street([], height=2.5)
    placed = put_on_ground(source, scene['points'][:, :3], np.zeros(6000))
    np.testing.assert_allclose(placed.box - source.box, [0, 0, 2.5, 0, 0, 0, 0], atol=1e-6)
    np.testing.assert_allclose(placed.points[:, 2] - source.points[:, 2], 2.5, atol=1e-5)


def paste_world(reads):
    worlds = {0: street([]), 1: street([CAR], seed=1), 3: street([CAR + [12, 9, 0, 0, 0, 0, 0]], seed=3)}

    def raw(index):
        reads.append(index)
        return worlds[index]

    entries = {name: SimpleNamespace(true_boxes=count) for name, count in (('s', 0), ('t', 1), ('u', 0), ('v', 1))}
    return SimpleNamespace(
        labels='store',
        scene_ids=('s', 't', 'u', 'v', 'w'),
        classes=('Car', 'Pedestrian'),
        raw=raw,
        label_store=SimpleNamespace(scenes=lambda: entries),
    )


def test_objects_come_from_scenes_with_annotated_boxes_read_once():
    reads = []
    dataset, transform = paste_world(reads), LabelledObjectPaste(max_objects=4)
    out = transform(street([]) | {'dataset': dataset})
    assert reads == [1, 3]
    assert 1 <= len(out['boxes']) <= 4
    assert out['box_is_annotated'].all()
    assert set(out['box_labels'].tolist()) == {1}
    inside = points_in_boxes(out['points'][:, :3], out['boxes'])
    pasted = out['point_index'] == -1
    np.testing.assert_array_equal(inside[pasted], out['instance'][pasted])
    assert out['boxes'][:, 2] - out['boxes'][:, 5] / 2 == pytest.approx(-1.7, abs=0.1)
    again = transform(street([]) | {'dataset': dataset})
    fresh = LabelledObjectPaste(max_objects=4)(street([]) | {'dataset': dataset})
    for other in (again, fresh):  # an item does not depend on what was made before it
        np.testing.assert_array_equal(other['points'], out['points'])
        np.testing.assert_array_equal(other['boxes'], out['boxes'])
    assert reads == [1, 3, 1, 3]
    dataset.labels = 'truth'
    with pytest.raises(ValueError, match="needs a data set with labels='store'"):
        LabelledObjectPaste()(street([]) | {'dataset': dataset})


def test_accepted_objects_are_pasted_as_what_they_are_and_read_anew_each_round():
    reads, pseudo = [], CAR + [15, 5, 0, 0, 0, 0, 0]
    dataset, rounds = paste_world(reads), [1]
    worlds = {0: street([]), 1: street([CAR, pseudo], annotated=[True, False]), 2: street([]), 3: street([])}
    dataset.raw = lambda index: reads.append(index) or worlds[index]
    dataset.label_store.current_round = lambda: rounds[0]
    transform = LabelledObjectPaste(accepted=True)
    (found,) = transform.bank(dataset)
    assert [item.annotated for item in found] == [True, False] and reads == [0, 1, 2, 3]
    check_objects(found, [Boxes3D(CAR[None], np.array([1]))])
    with pytest.raises(BudgetError, match='expected one of the 1 boxes that the budget shows'):
        check_objects(found, [Boxes3D(pseudo[None], np.array([0]))])  # there, but of another class
    far = put_on_ground(found[1]._replace(box=CAR + [9, 9, 0, 0, 0, 0, 0]), np.zeros((1, 3)), np.zeros(1))
    assert paste(street([]), far)['box_is_annotated'].tolist() == [False]
    worlds[1] = street([CAR])
    assert len(transform.bank(dataset)[0]) == 2
    rounds[0] = 2
    assert len(transform.bank(dataset)[0]) == 1


def test_pasted_points_outlive_the_removal_of_ground():
    out = LabelledObjectPaste(max_objects=3)(street([]) | {'dataset': paste_world([])})
    kept = DropGround()(out)
    assert (kept['point_index'] == -1).sum() == (out['point_index'] == -1).sum() > 0
    assert len(kept['points']) < 500


# ---------------------------------------------------------------------- packing


def test_pack_names_types_and_values():
    results = AugmentedView()(item(6))
    packed = pack_scene(results)
    assert set(packed) == {'inputs', 'data_samples'}
    assert set(packed['inputs']) == {'points', 'views'} and packed['inputs']['points'].dtype == torch.float32
    (view,) = packed['inputs']['views']
    assert {name: tensor.dtype for name, tensor in view.items()} == {
        'points': torch.float32, 'point_ids': torch.int64,
    }  # fmt: skip
    sample = packed['data_samples']
    assert {name: (field.dtype, tuple(field.shape)) for name, field in sample.items()} == {
        'point_index': (torch.int64, (6,)),
        'gt_bboxes_3d': (torch.float32, (1, 7)),
        'gt_labels_3d': (torch.int64, (1,)),
        'gt_is_annotated': (torch.bool, (1,)),
        'pts_semantic_mask': (torch.int64, (6,)),
        'pts_instance_mask': (torch.int64, (6,)),
        'pts_is_annotated': (torch.bool, (6,)),
    }
    assert sample.metainfo == {'scene_id': 's', 'num_points': 6}
    np.testing.assert_array_equal(packed['inputs']['points'].numpy(), results['points'])
    np.testing.assert_array_equal(sample.pts_instance_mask.numpy(), results['instance'])


def test_pack_without_labels_and_without_boxes():
    bare = pack_scene({'scene_id': 's', 'num_points': 1, 'points': np.zeros((1, 4)), 'point_index': np.array([0])})
    assert bare['data_samples'].keys() == ['point_index']
    assert list(bare['inputs']) == ['points']
    none = pack_scene(item(4, boxes=np.zeros((0, 7))))['data_samples']
    assert none.gt_bboxes_3d.shape == (0, 7)


def test_every_transform_is_registered():
    for name in ('AugmentedView', 'DropGround', 'GlobalRotScale', 'LabelledObjectPaste', 'PackScene', 'RandomFlipY'):
        assert TRANSFORMS.build({'type': name})
    assert TRANSFORMS.build({'type': 'rm3d_plugin.LimitPoints', 'max_points': 3}).max_points == 3


def test_selecting_takes_masks_and_numbers():
    start = item(5)
    np.testing.assert_array_equal(select_points(start, np.array([3, 1]))['point_index'], [3, 1])
    np.testing.assert_array_equal(select_points(start, np.arange(5) > 2)['point_index'], [3, 4])
