"""Predicted boxes that become pseudo boxes: limits and steps by hand."""

from dataclasses import replace

import numpy as np
import pytest

from rm3d_plugin.pseudo_labels import TeacherRules
from rm3d_plugin.pseudo_labels.detection.boxes import has_usual_size, size_ranges
from rm3d_plugin.pseudo_labels.detection.teacher import (
    BoxLimits,
    Shown,
    ask_annotated,
    box_limits,
    boxes_above,
    columns_of,
    expected_from_whole,
    joined_shown,
    lower_mean,
    most_expected,
    teacher_candidates,
    teacher_objects,
)
from rm3d_plugin.structures import Boxes3D

SIZES = np.repeat([[[4.0, 2.0, 1.5]], [[0.8, 0.6, 1.8]]], 2, axis=1)
NOTHING = joined_shown([])


def boxes(rows, labels, scores):
    return Boxes3D(np.array(rows, dtype=float).reshape(-1, 7), np.array(labels), np.array(scores, dtype=float))


def car(x, y=0.0, length=4.0):
    return [x, y, 0.75, length, 2.0, 1.5, 0.0]


def cloud_in(rows, each=8):
    """Points of each box, on a line through its middle."""
    along = np.linspace(-0.3, 0.3, each)
    return np.concatenate([np.c_[row[0] + along, np.full(each, row[1]), np.full(each, row[2])] for row in rows])


def slow_lower_mean(scores):
    """All splits, one by one."""
    s = sorted(scores)
    cost = [np.var(s[:k]) * k + np.var(s[k:]) * (len(s) - k) for k in range(1, len(s))]
    return float(np.mean(s[: int(np.argmin(cost)) + 1]))


@pytest.mark.parametrize('seed', range(5))
def test_scores_fall_into_two_where_the_squares_are_least(seed):
    scores = np.random.default_rng(seed).beta(0.5, 0.7, size=17)
    assert lower_mean(scores) == pytest.approx(slow_lower_mean(scores))
    assert lower_mean(scores[:1]) == 0.0 and lower_mean(scores[:0]) == 0.0


def test_each_step_says_what_it_cost():
    given = [car(10), car(10.5), car(20), car(30, length=7.0), car(40), car(50)]
    xyz = np.concatenate([cloud_in([given[0], given[2], given[3], given[5]]), cloud_in([given[4]], each=3)])
    background = np.zeros(len(xyz), dtype=bool)
    background[-11:-3] = True  # the points in the box at 50
    predicted = boxes(given, [0] * 6, [0.9, 0.8, 0.7, 0.6, 0.5, 0.4])
    known = boxes([car(20.2)], [0], [1.0])
    got = teacher_candidates(xyz, background, predicted, NOTHING, known, SIZES, TeacherRules())
    assert got.boxes.tensor[:, 0].tolist() == [10.0]
    cost = {
        'found': 6,
        'size': 1,
        'looks': 0,
        'points': 2,
        'collision': 2,
        'above': 0,
    }  # a second box at 10, and the annotated one at 20
    assert {step: lost.tolist() for step, lost in got.steps.items()} == {step: [n, 0] for step, n in cost.items()}


def test_an_object_ends_with_its_box():
    given = [car(10), car(20), car(30)]
    over = [[row[0], row[1], 1.5 + 0.5, *row[3:5], 1.0, 0.0] for row in given]
    far_above = cloud_in([[20.0, 0.0, 2.6, 4.0, 2.0, 0.1, 0.0]])
    xyz = np.concatenate([cloud_in(given, each=19), cloud_in(over[:1], each=2), cloud_in(over[2:], each=1), far_above])
    predicted, nowhere = boxes(given, [0] * 3, [0.9, 0.8, 0.7]), np.zeros(len(xyz), dtype=bool)
    nothing = Boxes3D.empty()
    got = teacher_candidates(xyz, nowhere, predicted, NOTHING, nothing, SIZES, TeacherRules())
    assert got.boxes.tensor[:, 0].tolist() == [20.0, 30.0], '19 of 20 is enough, 19 of 21 is not'
    assert got.steps['above'].tolist() == [1, 0]
    free = teacher_candidates(xyz, nowhere, predicted, NOTHING, nothing, SIZES, TeacherRules(free_above=0.0))
    assert len(free.boxes) == 3


def test_what_has_no_height_of_a_class_is_background():
    """Boxes of a pedestrian's size: a person, a bollard, something as high as a car, few beams, and a pole."""
    tops = (1.75, 1.0, 1.5, 1.3, 2.0)  # metres that the points of each reach; their gaps are .1 m, of the fourth .55
    people = [[10.0 * (row + 1), 0.0, 1.1, 0.8, 0.6, 2.0, 0.0] for row in range(5)]
    rows = [np.arange(top, 0.1, -0.55 if row == 3 else -0.1) for row, top in enumerate(tops)]
    xyz = np.concatenate([np.c_[np.tile(box[:2], (len(z), 1)), z] for box, z in zip(people, rows, strict=True)])
    owner = np.repeat(np.arange(5), [len(z) for z in rows])
    nowhere, nothing = np.zeros(len(xyz), dtype=bool), Boxes3D.empty()
    given = (xyz, nowhere, boxes(people, [1] * 5, [0.9] * 5), NOTHING, nothing, SIZES)
    got = teacher_candidates(*given, TeacherRules(min_points=3, top=0.95, seen_height=0.85), xyz[:, 2])
    assert got.boxes.tensor[:, 0].tolist() == [10.0, 40.0]  # each says that it is 2 m high
    assert got.steps['low'].tolist() == [0, 2] and got.steps['high'].tolist() == [0, 1]
    assert got.empty.tolist() == np.isin(owner, [1, 4]).tolist()  # a car might be as high as the third
    lower = teacher_candidates(*given, TeacherRules(min_points=3, top=0.95), xyz[:, 2])  # nobody asks what they say
    assert lower.boxes.tensor[:, 0].tolist() == [10.0, 20.0, 30.0, 40.0]
    assert lower.empty.tolist() == (owner == 4).tolist()  # what is a candidate is no background
    for rules, height in ((TeacherRules(min_points=3, top=0.0), xyz[:, 2]), (TeacherRules(min_points=3), None)):
        unasked = teacher_candidates(*given, rules, height)
        assert len(unasked.boxes) == 5 and not unasked.empty.any() and not np.any(unasked.steps.get('low', 0))


RANGES = np.array([[[4.0, 2.0, 1.4], [4.0, 2.0, 1.6]], [[0.8, 0.6, 1.7], [0.8, 0.6, 1.7]]])  # cars, pedestrians


def test_a_box_is_looked_at_up_to_the_tallest_of_its_class():
    rows = np.array([[10.0, 0, 0.6, 4.0, 2.0, 1.2, 0.0], [20.0, 0, 1.0, 4.0, 2.0, 2.0, 0.0]])
    given = boxes(rows, [0, 0], [0.9, 0.8])
    columns = columns_of(given, RANGES, 0.8)
    assert (columns[:, 2] + columns[:, 5] / 2).tolist() == pytest.approx([2.0, 2.0])  # 1.6 m over .8
    assert (columns[:, 2] - columns[:, 5] / 2).tolist() == pytest.approx([0.0, 0.0])
    assert columns_of(given, RANGES, 0.0).tolist() == given.tensor.tolist()
    above = boxes_above(columns)
    assert (above[:, 2] - above[:, 5] / 2).tolist() == pytest.approx([2.0, 2.0]) and above[:, 5].tolist() == [1.0, 1.0]


def test_cars_that_are_predicted_too_low_pass_and_make_no_background():
    """A car of 1.5 m in a box of 1.1 m, one whose points go on in leaves, and something of .9 m."""
    rows = np.array([[x, 0, 0.55, 4.0, 2.0, 1.1, 0.0] for x in (10.0, 20.0, 30.0)])
    tops = ([0.3, 0.6, 0.9, 1.05, 1.3, 1.5], [0.3, 0.6, 0.9, 1.05, 2.0, 2.2], [0.2, 0.3, 0.4, 0.5, 0.6, 0.65])
    xyz = np.array([[box[0], 0.0, z] for box, up in zip(rows, tops, strict=True) for z in up])
    given = (xyz, np.zeros(18, dtype=bool), boxes(rows, [0] * 3, [0.9, 0.8, 0.7]), NOTHING, Boxes3D.empty(), RANGES)
    rules = TeacherRules(min_points=3, top=0.95, seen_height=0.85)
    got = teacher_candidates(*given, rules, xyz[:, 2])
    assert got.boxes.tensor[:, 0].tolist() == [10.0] and got.steps['above'].tolist() == [1, 0]
    assert got.steps['low'].tolist() == [1, 0] and got.empty.tolist() == [False] * 12 + [True] * 6
    asked = teacher_candidates(*given, TeacherRules(min_points=3, top=0.95, lowest=1.0), xyz[:, 2])
    assert asked.boxes.tensor[:, 0].tolist() == [10.0]  # its points end at 1.5 m, more than the lowest, 1.4 m
    refused = RANGES + [0.0, 0.0, 0.35]  # the lowest is 1.75 m: what is in the box and up to .2 m more is lower
    assert not len(teacher_candidates(*given[:-1], refused, replace(rules, lowest=1.0), xyz[:, 2]).boxes)
    between = xyz.copy()
    between[5, 2] = 1.65  # over the tallest, 1.6 m, and below that over .95
    assert teacher_candidates(between, *given[1:], rules, xyz[:, 2]).boxes.tensor[0, 0] == 10.0


def test_a_box_around_what_looks_otherwise_does_not_pass():
    given = [car(10), car(20), car(30), car(40, length=9.0), car(50)]
    xyz, nowhere = cloud_in(given), np.zeros(40, dtype=bool)
    rows = (xyz, nowhere, boxes(given, [0, 0, 1, 0, 0], [0.9] * 5), NOTHING, Boxes3D.empty(), SIZES)
    alike = np.array([True, False, False, True, True])  # the third and fourth have no usual size
    got = teacher_candidates(*rows, TeacherRules(), alike=alike)
    assert got.boxes.tensor[:, 0].tolist() == [10.0, 50.0]
    assert got.steps['size'].tolist() == [1, 1] and got.steps['looks'].tolist() == [1, 0]
    assert len(teacher_candidates(*rows, TeacherRules()).boxes) == 3


def test_sizes_may_leave_the_range_of_annotated_boxes_by_a_factor():
    known = np.array(
        [[*car(0)[:3], 2.0, 4.0, 1.5, 0.1], car(0, length=6.0)]
    )  # which side is the length is yaw's matter
    ranges = size_ranges(known, np.zeros(2, int), np.array([[np.nan] * 3, [0.8, 0.6, 1.8], [np.nan] * 3]))
    assert ranges[0].tolist() == [[4.0, 2.0, 1.5], [6.0, 2.0, 1.5]]
    assert ranges[1].tolist() == [[0.8, 0.6, 1.8]] * 2 and np.isnan(ranges[2]).all()
    given = boxes([car(0, length=size) for size in (2.6, 2.7, 8.9, 9.1)], [0] * 4, [1] * 4)
    assert has_usual_size(given, ranges, 1.5).tolist() == [False, True, True, False]
    assert not has_usual_size(boxes([car(0)], [2], [1]), ranges, 1.5).any()


def test_annotated_objects_tell_what_a_good_score_is():
    known = boxes([car(10), car(30)], [0, 0], [1, 1])
    predicted = boxes([car(10.2), car(9.8), car(30.0), car(30.0)], [0, 0, 1, 0], [0.5, 0.6, 0.9, 0.0])
    instance = np.array([0, 0, 1, -1])
    probabilities = np.array([[0.8, 0.1, 0.1], [np.nan] * 3, [0.3, 0.2, 0.5], [0.0, 0.0, 1.0]])
    got = ask_annotated(known, instance, predicted, probabilities)
    assert got.labels.tolist() == [0, 0] and got.scores.tolist() == [0.6, 0.0]  # the one at 30 is of another class
    assert got.probs.tolist() == [0.8, 0.3]
    unseen = ask_annotated(known, instance, Boxes3D.empty(), None)
    assert unseen.scores.tolist() == [0, 0] and unseen.probs.tolist() == [0, 0]


def test_limits_by_hand():
    scores = [0.9, 0.6, 0.3, 0.2, 0.1, 0.1]
    found = boxes([car(10 * i) for i in range(6)], [0] * 6, scores)
    shown = Shown(np.array([0, 0, 0, 1]), np.array([0.5, 0.6, 0.7, 0.4]), np.array([0.9, 0.8, 0.2, 0.9]))
    got = box_limits(found, shown, 2, TeacherRules(share=0.5))
    assert got.ignore[0] == pytest.approx(np.mean([0.3, 0.2, 0.1, 0.1]))
    assert got.expected[0] == pytest.approx(1 + 1 + 1 / 4 + 1 / 9 + 2 / 36)  # 0.9 is an object, 0.3 with one in four
    assert got.accept[0] == pytest.approx(0.3)  # three boxes at most: half of 0.6 is as much
    assert np.isinf(got.accept[1]) and got.expected[1] == 0  # no candidate
    few = box_limits(found, shown, 2, TeacherRules(share=0.5), expected=np.array([2.0, 0.0]))
    assert few.accept[0] == pytest.approx(0.6) and few.expected.tolist() == [2.0, 0.0]
    most = box_limits(found, shown, 2, TeacherRules(share=0.5), most=np.array([1.5, 9.0]))
    assert most.expected.tolist() == [1.5, 0.0] and most.accept[0] == pytest.approx(0.6)
    assert (
        box_limits(found, shown, 2, TeacherRules(share=0.5), most=np.array([9.0, 9.0])).expected[0] == got.expected[0]
    )


def test_a_class_that_the_network_does_not_recognise_waits():
    found = boxes([car(0)], [0], [0.9])
    shown = Shown(np.array([0]), np.array([0.9]), np.array([0.3]))
    assert np.isinf(box_limits(found, shown, 1, TeacherRules()).accept[0])
    assert box_limits(found, shown, 1, TeacherRules(recognised=0.0)).accept[0] == pytest.approx(0.9)
    assert np.isinf(box_limits(found, NOTHING, 1, TeacherRules(recognised=0.0)).accept[0])  # nothing is annotated


def test_candidates_of_some_scenes_speak_for_all():
    found, shown = boxes([car(0), car(9)], [0, 0], [0.8, 0.8]), Shown(np.zeros(1, int), np.array([0.8]), np.ones(1))
    got = box_limits(found, shown, 1, TeacherRules(), scenes_ratio=3.0)
    assert got.expected[0] == pytest.approx(6.0) and got.accept[0] == pytest.approx(0.8)
    assert expected_from_whole([np.array([2, 0]), np.array([4, 1])], 10).tolist() == [30.0, 5.0]
    assert expected_from_whole([], 10) is None
    assert most_expected([3.5, 90.0], [3, 0], 2.0).tolist() == [7.0, np.inf]


def test_nothing_is_said_of_a_doubtful_place():
    rows = [car(10), car(20), car(30)]
    xyz = np.concatenate([cloud_in(rows), [[22.1, 0.0, 0.75]]])  # the last: 10 cm before the doubtful box
    found = teacher_candidates(
        xyz, np.zeros(len(xyz), dtype=bool), boxes(rows, [0] * 3, [0.9, 0.5, 0.1]), NOTHING, Boxes3D.empty(), SIZES,
        TeacherRules(),
    )  # fmt: skip
    limits = BoxLimits(np.array([0.8, np.inf]), np.array([0.3, 0.3]), np.ones(2))
    got = teacher_objects(xyz, found, limits, 2)
    assert got.boxes.tensor[:, 0].tolist() == [10.0]
    assert got.point_box.tolist() == [0] * 8 + [-1] * 17
    assert got.rejected.tolist() == [False] * 8 + [True] * 8 + [False] * 8 + [True]
    assert got.steps['doubt'].tolist() == [1, 0] and got.steps['score'].tolist() == [1, 0]
    waiting = teacher_objects(xyz, found, limits._replace(accept=np.full(2, np.inf)), 2)
    assert len(waiting.boxes) == 0 and waiting.steps['unrecognised'].tolist() == [3, 0]


@pytest.mark.parametrize(
    ('field', 'value'), [('share', 0.0), ('recognised', 1.5), ('size_ratio', 0.9), ('min_points', 0), ('background', 0)]
)
def test_rules_name_the_field(field, value):
    with pytest.raises(ValueError, match=f'TeacherRules.{field}'):
        TeacherRules(**{field: value})
