"""Instances of classes and votes, their boxes, and how far the three agree: by hand."""

import numpy as np
import pytest

from rm3d_plugin.pseudo_labels.detection.instances import (
    PredictedInstances,
    agreement,
    boxes_of_instances,
    predicted_instances,
)
from rm3d_plugin.pseudo_labels.detection.objects import ObjectContext, PointVotes
from rm3d_plugin.pseudo_labels.detection.rules import ObjectRules
from rm3d_plugin.structures import Boxes3D

SIZES = np.array([[4.0, 2.0, 1.5], [0.8, 0.6, 1.8], [np.nan, np.nan, np.nan]])
CARS = [np.array([x, 0.0, 0.5]) + np.linspace(-1.8, 1.8, 10)[:, None] * [1, 0, 0] for x in (10.0, 14.5)]
MAN = np.array([[20.0, 5.0, z] for z in (0.1, 0.6, 1.1, 1.6)])
GROUND = np.array([[12.0, 3.0, 0.0], [13.0, 3.0, 0.0]])
XYZ = np.concatenate([*CARS, MAN, GROUND])
CENTERS = np.concatenate(
    [np.tile([10.0, 0, 0.5], (10, 1)), np.tile([14.5, 0, 0.5], (10, 1)), np.tile([20.0, 5, 0.9], (4, 1)), GROUND]
)


def rows(classes, sure=0.7):
    out = np.full((len(classes), 4), (1 - sure) / 3)
    out[np.arange(len(classes)), classes] = sure
    return out


PROBS = rows(np.repeat([0, 1, 3], [20, 4, 2]))


def test_what_votes_for_one_place_is_one_instance():
    found = predicted_instances(PROBS, CENTERS, SIZES, min_points=4)
    assert found.point.tolist() == [0] * 10 + [1] * 10 + [2] * 4 + [-1] * 2
    assert found.labels.tolist() == [0, 0, 1] and found.scores.tolist() == pytest.approx([0.7] * 3)
    assert predicted_instances(PROBS, CENTERS, SIZES, min_points=5).labels.tolist() == [0, 0]
    unseen, votes = PROBS.copy(), CENTERS.copy()
    unseen[:4], votes[10:14] = np.nan, np.nan
    assert predicted_instances(unseen, votes, SIZES, 4).point.tolist()[:14] == [-1] * 4 + [0] * 6 + [-1] * 4


def test_votes_link_up_to_a_quarter_of_the_smaller_side_and_classes_without_a_size_have_none():
    chain = np.array([[0.0, 0, 0], [0.49, 0, 0], [0.98, 0, 0], [1.49, 0, 0]])
    found = predicted_instances(rows([0] * 4), chain, SIZES, min_points=1)
    assert found.point.tolist() == [0, 0, 0, 1]
    assert predicted_instances(rows([2] * 4), chain, SIZES, 1).labels.tolist() == []
    assert predicted_instances(rows([0, 1, 0, 1]), np.zeros((4, 3)), SIZES, 1).point.tolist() == [0, 1, 0, 1]


def test_boxes_around_instances_and_none_around_two_at_once():
    context = ObjectContext(
        XYZ, SIZES, None, (0.0, 0.0), PointVotes(np.full(len(XYZ), -1), None), ObjectRules(box='axis_aligned')
    )
    found = predicted_instances(PROBS, CENTERS, SIZES, 4)
    boxes = boxes_of_instances(context, found)
    assert boxes.tensor[:2, :2] == pytest.approx(np.array([[10, 0], [14.5, 0]]))
    assert boxes.tensor[:2, 3].tolist() == pytest.approx([3.6, 3.6]) and boxes.tensor[2, 5] == pytest.approx(1.5)
    assert boxes.labels.tolist() == [0, 0, 1] and boxes.scores.tolist() == pytest.approx([0.7] * 3)
    two_cars = np.where(found.point == 2, 1, np.minimum(found.point, 0))  # 8.1 m long
    both = PredictedInstances(two_cars, found.labels[[0, 2]], found.scores[:2])
    assert boxes_of_instances(context, both).labels.tolist() == [1]
    nothing = predicted_instances(PROBS[:0], CENTERS[:0], SIZES, 4)
    assert len(boxes_of_instances(context, nothing)) == 0


def test_how_far_they_agree():
    found = predicted_instances(PROBS, CENTERS, SIZES, 4)
    boxes = Boxes3D(
        np.array([[10.0, 0, 0.75, 4, 2, 1.5, 0], [16.0, 0, 0.75, 4, 2, 1.5, 0], [20.0, 5, 0.9, 0.8, 0.6, 1.8, 0]]),
        np.array([0, 0, 0]),  # the second holds 6 of 10 points, the third is of the wrong class
    )
    got = {kind: counts.tolist() for kind, counts in agreement(XYZ, PROBS, found, boxes).items()}
    assert got == {
        'boxes': [3, 0, 0],
        'boxes_with_instance': [2, 0, 0],
        'instances': [2, 1, 0],
        'instances_with_box': [2, 0, 0],
        'points_in_boxes': [10 + 6 + 4, 0, 0],
        'points_of_class': [10 + 6, 0, 0],
    }
    shifted = boxes.select(np.array([False, True, False]))
    shifted.tensor[0, 0] = 16.9  # 4 of 10
    less = agreement(XYZ, PROBS, found, shifted)
    assert less['boxes_with_instance'].tolist() == [0, 0, 0] and less['points_in_boxes'].tolist() == [4, 0, 0]
    assert agreement(XYZ, PROBS, found, Boxes3D.empty())['instances_with_box'].tolist() == [0, 0, 0]
