import pytest
import torch

from rm3d_plugin.models.heads.batch_labels import BatchLabels, join_labels
from rm3d_plugin.models.heads.vote_targets import box_distances, known_share, proposal_targets, vote_targets
from rm3d_plugin.models.losses.votenet_loss import objectness_loss
from rm3d_plugin.structures import SceneError, SceneSample


def labels(semantic, instance, boxes=((0.0, 0, 0, 4, 2, 1, 0),), classes=(0,), box_offsets=(0, 1)):
    return BatchLabels(
        torch.tensor(boxes, dtype=torch.float32).reshape(-1, 7),
        torch.tensor(classes, dtype=torch.int64),
        torch.ones(len(classes), dtype=torch.bool),
        torch.tensor(box_offsets),
        torch.tensor(semantic),
        torch.tensor(instance),
    )


def targets_at(anchors, known, given, offsets=None, near=(0.5, 0.5), far=(1.0, 1.0)):
    anchors = torch.tensor(anchors, dtype=torch.float32)
    offsets = torch.tensor([0, len(anchors)]) if offsets is None else torch.tensor(offsets)
    distances = box_distances(anchors, offsets, given)
    return proposal_targets(
        distances, torch.tensor(known), given, torch.tensor(near), torch.tensor(far), torch.ones(2, 3), 12
    )


def test_votes_go_to_the_centre_and_objects_share_the_weight():
    given = labels([0, 0, 0, -1], [0, 0, 1, -1], [[0.0, 0, 0, 1, 1, 1, 0], [5.0, 0, 0, 1, 1, 1, 0]], [0, 0], [0, 2])
    xyz = torch.tensor([[1.0, 0, 0], [0, 1, 0], [5, 0, 2], [9, 9, 9]])
    got = vote_targets(xyz, given, balance=1.0)
    assert got.points.tolist() == [0, 1, 2]
    assert got.offsets.tolist() == [[-1, 0, 0], [0, -1, 0], [0, 0, -2]]
    assert got.weights.tolist() == pytest.approx([0.5, 0.5, 1.0])
    assert vote_targets(xyz, given, balance=0.0).weights.tolist() == pytest.approx([2 / 3] * 3)


def test_known_share_by_hand():
    given = labels([2, 2, -1, 0, 1], [-1, -1, -1, 0, -1])  # 2 = background; point 4 has a class but no box
    members = torch.tensor([[0, 1], [0, 2], [2, -1], [3, 0], [4, -1], [-1, -1]])
    assert known_share(members, given, 2, 0.0).tolist() == [1.0, 0.5, 0.0, 1.0, 0.0, 0.0]
    assert known_share(members, given, 2, 0.2).tolist() == pytest.approx([1.0, 0.6, 0.2, 1.0, 0.2, 0.0])


def test_near_far_and_between():
    got = targets_at([[0.4, 0, 0], [0.7, 0, 0], [3, 0, 0], [4, 0, 0]], [1.0, 1.0, 1.0, 0.25], labels([0], [0]))
    assert got.is_object.tolist() == [1, 0, 0, 0]
    assert got.weights.tolist() == [1.0, 0.0, 1.0, 0.25]
    assert (got.positives.tolist(), got.boxes.tolist()) == ([0], [0])


def test_thresholds_by_class():
    given = labels([0], [0], [[0.0, 0, 0, 1, 1, 1, 0], [2.0, 0, 0, 1, 1, 1, 0]], [0, 1], [0, 2])
    got = targets_at([[1.1, 0, 0], [0.6, 0, 0]], [1.0, 1.0], given, near=(1.0, 0.5), far=(2.0, 1.0))
    assert got.is_object.tolist() == [0, 1]  # nearer to the small one, too far for it; 1.1 m misses the large one
    assert got.weights.tolist() == [0.0, 1.0]
    assert got.boxes.tolist() == [0]


def test_boxes_of_other_scenes_do_not_count():
    got = targets_at([[0.0, 0, 0], [0.0, 0, 0]], [1.0, 1.0], labels([0], [0], box_offsets=(0, 0, 1)), (0, 1, 2))
    assert got.is_object.tolist() == [0, 1]


def test_no_box_at_all():
    got = targets_at([[0.0, 0, 0]], [0.5], labels([-1], [-1], (), (), (0, 0)))
    assert (got.is_object.tolist(), got.weights.tolist(), got.positives.tolist()) == ([0], [0.5], [])


def test_objectness_is_votenets_where_all_is_known_and_silent_where_nothing_is():
    logits, truth = torch.tensor([[0.0, 1.0], [2.0, 0.0], [0.0, 0.0]]), torch.tensor([1, 0, 0])
    each = torch.nn.functional.cross_entropy(logits, truth, weight=torch.tensor([0.2, 0.8]), reduction='none')
    assert float(objectness_loss(logits, truth, torch.ones(3))) == pytest.approx(float(each.mean()))
    assert float(objectness_loss(logits, truth, torch.tensor([1.0, 0.5, 0.0]))) == pytest.approx(
        float((each[0] + 0.5 * each[1]) / 1.5)
    )
    assert float(objectness_loss(logits, truth, torch.zeros(3))) == 0.0


def test_join_labels_shifts_instances_and_fills_what_is_absent():
    first = SceneSample(gt_bboxes_3d=torch.ones(2, 7), gt_labels_3d=torch.tensor([0, 1]))
    second = SceneSample(
        gt_bboxes_3d=torch.ones(1, 7),
        gt_labels_3d=torch.tensor([1]),
        gt_is_annotated=torch.tensor([False]),
        pts_semantic_mask=torch.tensor([1, -1]),
        pts_instance_mask=torch.tensor([0, -1]),
    )
    got = join_labels([first, second, SceneSample()], torch.tensor([0, 1, 3, 4]), torch.zeros(4, 3), 2)
    assert got.instance.tolist() == [-1, 2, -1, -1]
    assert got.semantic.tolist() == [-1, 1, -1, -1]
    assert got.box_is_annotated.tolist() == [True, True, False]
    assert got.box_offsets.tolist() == [0, 2, 3, 3]


def test_join_labels_names_the_bad_field():
    sample = SceneSample(metainfo={'scene_id': '000042'}, pts_instance_mask=torch.tensor([0]))
    with pytest.raises(SceneError, match='000042.*box 0 of 0'):
        join_labels([sample], torch.tensor([0, 1]), torch.zeros(1, 3), 2)
    with pytest.raises(SceneError, match='000042.*pts_instance_mask: expected 2 rows, got 1'):
        join_labels([sample], torch.tensor([0, 2]), torch.zeros(2, 3), 2)
