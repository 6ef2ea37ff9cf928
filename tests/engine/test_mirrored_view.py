"""Two looks at a scene, by hand."""

import numpy as np
import pytest
import torch

from rm3d_plugin.engine.mirrored_view import agreed_boxes, agreed_prediction, mirrored_batch, mirrored_boxes
from rm3d_plugin.pseudo_labels import PointPrediction
from rm3d_plugin.structures import Boxes3D, SceneError


def boxes(rows, labels, scores):
    return Boxes3D(np.array(rows, dtype=float).reshape(-1, 7), np.array(labels), np.array(scores, dtype=float))


def car(x, yaw=0.0):
    return [x, 1.0, 0.0, 4.0, 2.0, 1.5, yaw]


def test_boxes_of_both_looks_are_averaged_and_the_others_go():
    first = boxes([car(10), car(20), car(30)], [0, 0, 1], [0.9, 0.8, 0.7])
    second = boxes([car(11), car(30), car(50)], [0, 0, 0], [0.4, 0.9, 0.9])
    got = agreed_boxes(first, second)
    assert got.tensor.tolist() == [car(10.5)] and got.labels.tolist() == [0]
    assert got.scores[0] == pytest.approx(np.sqrt(0.9 * 0.4) * 3 / 5)  # 3 of 5 metres are shared
    assert len(agreed_boxes(first, Boxes3D.empty())) == 0


def test_a_turned_box_is_the_same_outline_and_the_first_look_tells_the_front():
    got = agreed_boxes(boxes([car(0, 0.1)], [0], [1.0]), boxes([car(0, 0.3 + np.pi)], [0], [1.0]))
    assert got.tensor[0, 6] == pytest.approx(0.2)


def test_mirroring_twice_changes_nothing():
    given = boxes([car(3, 0.4)], [0], [0.5])
    once = mirrored_boxes(given)
    assert once.tensor[0].tolist() == [3.0, -1.0, 0.0, 4.0, 2.0, 1.5, -0.4]
    np.testing.assert_array_equal(mirrored_boxes(once).tensor, given.tensor)


def test_a_batch_is_mirrored_and_left_as_it_was():
    points = torch.tensor([[1.0, 2.0, 3.0, 0.5]])
    batch = {'inputs': {'points': [points]}, 'data_samples': ['scene']}
    got = mirrored_batch(batch)
    assert got['inputs']['points'][0].tolist() == [[1.0, -2.0, 3.0, 0.5]] and got['data_samples'] == ['scene']
    assert points.tolist() == [[1.0, 2.0, 3.0, 0.5]]
    with pytest.raises(SceneError, match='mirror=False'):
        mirrored_batch({'inputs': torch.zeros(1), 'data_samples': []})


def test_probabilities_are_the_mean_of_both_looks():
    first = PointPrediction(np.array([[0.2, 0.8]]), None, boxes([car(0)], [0], [1.0]))
    second = PointPrediction(np.array([[0.4, 0.6]]), None, mirrored_boxes(boxes([car(0)], [0], [0.25])))
    got = agreed_prediction(first, second)
    np.testing.assert_allclose(got.probabilities, [[0.3, 0.7]])
    assert got.boxes is not None and got.boxes.scores.tolist() == [0.5]
    assert agreed_prediction(first, PointPrediction(np.array([[0.4, 0.6]]))).boxes is first.boxes
