import numpy as np
import pytest

from rm3d_plugin.evaluation.functional import box_ap
from rm3d_plugin.structures import Boxes3D


def boxes(*rows):
    """Rows (x, class, score) of unit cubes."""
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    tensor = np.tile([0.0, 0, 0, 1, 1, 1, 0], (len(table), 1))
    tensor[:, 0] = table[:, 0]
    return Boxes3D(tensor, table[:, 1].astype(int), table[:, 2])


def test_perfect_and_nothing():
    truth = [boxes((0, 0, 1), (5, 1, 1)), boxes((2, 0, 1))]
    for result in box_ap(truth, truth, 2):
        assert result.ap.tolist() == [1, 1] and result.recall.tolist() == [1, 1] and result.mean_ap == 1
    assert box_ap(truth, [Boxes3D.empty()] * 2, 2)[0].ap.tolist() == [0, 0]


def test_a_duplicate_costs_precision():
    truth = [boxes((0, 0, 1), (5, 0, 1))]
    found = [boxes((0, 0, 0.9), (0.1, 0, 0.8), (5, 0, 0.7))]
    result = box_ap(truth, found, 1)[0]
    assert result.ap[0] == pytest.approx((1 + 2 / 3) / 2)
    assert result.recall[0] == 1


def test_one_of_two_and_a_late_mistake():
    result = box_ap([boxes((0, 0, 1), (5, 0, 1))], [boxes((0, 0, 0.9), (9, 0, 0.1))], 1)[0]
    assert (result.ap[0], result.recall[0]) == (0.5, 0.5)


def test_thresholds_apart():
    # Shifted by .5 of 1: overlap .5 / 1.5 = 1/3.
    low, high = box_ap([boxes((0, 0, 1))], [boxes((0.5, 0, 1))], 1)
    assert (low.iou, low.ap[0], high.iou, high.ap[0]) == (0.25, 1, 0.5, 0)


def test_the_order_goes_over_all_scenes():
    truth = [boxes((0, 0, 1)), boxes((0, 0, 1))]
    found = [boxes((0, 0, 0.5)), boxes((7, 0, 0.9), (0, 0, 0.8))]
    assert box_ap(truth, found, 1)[0].ap[0] == pytest.approx(2 / 3)


def test_a_class_without_truth_does_not_spoil_the_mean():
    result = box_ap([boxes((0, 0, 1))], [boxes((0, 0, 1), (3, 1, 1))], 2)[0]
    assert np.isnan(result.ap[1]) and result.mean_ap == 1
    assert box_ap([Boxes3D.empty()], [boxes((3, 1, 1))], 2)[0].mean_ap == 0
    assert box_ap([], [], 2)[0].mean_ap == 0


def test_scenes_must_pair():
    with pytest.raises(ValueError, match='1 scenes of truth, 0 of detections'):
        box_ap([Boxes3D.empty()], [], 1)
