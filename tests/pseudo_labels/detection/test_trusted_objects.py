"""Which candidates become pseudo boxes: predicted boxes speak for them, and the best of each class are taken."""

import numpy as np
import pytest

from rm3d_plugin.pseudo_labels import ObjectRules
from rm3d_plugin.pseudo_labels.common.groups import GroupLabels
from rm3d_plugin.pseudo_labels.detection.objects import (
    NO_EVIDENCE,
    Evidence,
    ObjectContext,
    PointGroups,
    PointVotes,
    find_objects,
    most_boxes,
    score_limits,
)
from rm3d_plugin.pseudo_labels.detection.rules import AS_PRINTED
from rm3d_plugin.structures import Boxes3D

SIZES = np.array([[4.0, 1.6, 1.5], [0.8, 0.6, 1.7]])
CAR_AT, PERSON_AT = (10.0, 0.0), (8.0, 6.0)


def pillar(place, size, height, n=6):
    """Points that fill an upright block standing at z = 0."""
    axes = [np.linspace(-s / 2, s / 2, n) for s in size] + [np.linspace(0.0, height, n)]
    grid = np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1).reshape(-1, 3)
    return grid + [*place, 0.0]


def scene(person_height=1.7):
    """A car (group 0) and a person (group 1), both sure to .81."""
    car, person = pillar(CAR_AT, (4.0, 1.6), 1.5), pillar(PERSON_AT, (0.8, 0.6), person_height)
    xyz = np.concatenate([car, person])
    owner = np.repeat([0, 1], [len(car), len(person)])
    groups = GroupLabels(np.array([0, 1]), np.array([0.81, 0.81]), np.zeros(2, dtype=bool), np.full((2, 3), 1 / 3))
    return xyz, owner, groups


def find(rules, evidence=NO_EVIDENCE, person_height=1.7):
    xyz, owner, groups = scene(person_height)
    votes = PointVotes(owner, None)
    context = ObjectContext(xyz, SIZES, np.zeros(len(xyz)), (0.0, 0.0), votes, rules)
    return find_objects(context, PointGroups(owner, groups), Boxes3D.empty(), evidence=evidence), owner


def detections(*rows):
    """Predicted boxes from (class, place, score)."""
    boxes = [[*place, SIZES[c][2] / 2, *SIZES[c], 0.0] for c, place, _ in rows]
    return Boxes3D(np.array(boxes).reshape(-1, 7), np.array([c for c, _, _ in rows]), np.array([s for _, _, s in rows]))


def test_without_evidence_the_groups_speak_for_themselves():
    found, owner = find(ObjectRules())
    assert found.boxes.labels.tolist() == [0, 1]
    assert found.boxes.scores == pytest.approx([0.81, 0.81])
    assert not found.rejected.any()
    assert (found.point_box == owner).all()


def test_the_score_is_the_geometric_mean_with_the_best_box_of_the_class():
    boxes = detections((0, CAR_AT, 0.25), (0, (10.1, 0.0), 0.36), (0, PERSON_AT, 0.9), (1, (40.0, 0.0), 0.9))
    found, _ = find(ObjectRules(support_iou=0.2), Evidence(boxes, None))
    assert found.candidates.scores == pytest.approx([0.9 * 0.6, 0.0])  # sqrt(.81 * .36); no box of its class there


def test_a_candidate_under_its_limit_keeps_neither_box_nor_label():
    boxes = detections((0, CAR_AT, 0.36), (1, PERSON_AT, 0.04))
    found, owner = find(ObjectRules(support_iou=0.2), Evidence(boxes, np.array([0.5, 0.5])))
    assert found.boxes.labels.tolist() == [0]
    assert found.counts['doubtful_groups'] == 1
    assert (found.rejected == (owner == 1)).all()
    assert found.candidates.labels.tolist() == [0, 1]


def test_who_shows_too_little_is_no_object():
    rules = ObjectRules(seen_height=(0.0, 0.7))
    assert find(rules, person_height=1.3)[0].boxes.labels.tolist() == [0, 1]  # 1.3 > .7 * 1.7
    short, owner = find(rules, person_height=1.1)
    assert short.boxes.labels.tolist() == [0]
    assert short.counts['partial_groups'] == 1
    assert (short.rejected == (owner == 1)).all()
    assert find(ObjectRules(seen_length=(1.1, 0.0)))[0].boxes.labels.tolist() == [1]


def test_limits_take_the_best_share_of_each_class():
    scores = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.9])
    labels = np.array([0, 0, 0, 0, 0, 1])
    found = Boxes3D(np.tile([0.0, 0, 0, 1, 1, 1, 0], (6, 1)), labels, scores)
    limits = score_limits(found, 3, (0.4, 1.0), 1)
    assert limits == pytest.approx([0.4, 0.9, 0.0])  # two of five; the only one; none
    assert (scores[:5] >= limits[0]).sum() == 2
    assert score_limits(found, 3, (0.4, 1.0), 2)[0] == pytest.approx(0.1)
    assert score_limits(found, 3, (0.4, 1.0), 9)[0] == pytest.approx(0.1)  # the last number holds


def test_limits_take_no_more_than_are_allowed():
    scores = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.9])
    found = Boxes3D(np.tile([0.0, 0, 0, 1, 1, 1, 0], (6, 1)), np.array([0, 0, 0, 0, 0, 1]), scores)
    for most, kept in ((2.0, 2), (3.7, 3), (0.5, 1), (4.0, 4), (9.0, 5)):  # a class that had one keeps one
        limits = score_limits(found, 3, (1.0,), 2, np.array([most, np.inf, 1.0]))
        assert (scores[:5] >= limits[0]).sum() == kept and limits[1:].tolist() == [0.9, 0.0]
    assert score_limits(found, 3, (0.2,), 2, np.array([3.0, 3.0, 3.0]))[0] == 0.5  # the share is less


def test_a_score_of_nothing_is_no_object():
    found = Boxes3D(np.tile([0.0, 0, 0, 1, 1, 1, 0], (6, 1)), np.array([0] * 5 + [1]), np.array([0, 0, 0, 0, 0.2, 0.0]))
    assert score_limits(found, 2, (0.5,), 1).tolist() == [0.2, np.inf]


def test_a_class_grows_from_the_first_round_that_had_any():
    assert most_boxes([], np.array([1, 2]), 2.0).tolist() == [np.inf, np.inf]
    assert most_boxes([[4, 0], [20, 0], [9, 3], [9, 50]], np.array([1, 2]), 1.5).tolist() == [6.0, 4.5]
    assert most_boxes([[1, 0]], np.array([5, 5]), 2.0).tolist() == [10.0, np.inf], 'annotated boxes are objects, too'


def test_boxes_as_printed_hug_the_points_along_the_axes_of_the_scene():
    found, _ = find(AS_PRINTED, person_height=1.3)
    np.testing.assert_allclose(found.boxes.tensor[:, 3:], [[4.0, 1.6, 1.5, 0.0], [0.8, 0.6, 1.3, 0.0]], atol=1e-6)
    np.testing.assert_allclose(found.boxes.tensor[:, :3], [[*CAR_AT, 0.75], [*PERSON_AT, 0.65]], atol=1e-6)
    completed, _ = find(ObjectRules(), person_height=1.3)
    assert completed.boxes.tensor[1, 5] == pytest.approx(1.7)  # as people usually are


@pytest.mark.parametrize(
    ('field', 'value'), [('top_fraction', (0.0,)), ('top_fraction', ()), ('box', 'round'), ('gamma', 1.5)]
)
def test_bad_rules_are_named(field, value):
    with pytest.raises(ValueError, match=rf'ObjectRules\.{field}: expected'):
        ObjectRules(**{field: value})
