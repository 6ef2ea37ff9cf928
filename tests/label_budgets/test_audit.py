"""Hidden labels are hidden: noise in their place changes nothing that training sees."""

import dataclasses

import numpy as np
import pytest

from rm3d_plugin.datasets import Truth
from rm3d_plugin.label_budgets import hide, scramble_hidden
from rm3d_plugin.structures import Boxes3D

BOXES = Boxes3D(
    np.array([[0.0, 0, 0, 2, 2, 2, 0], [10, 0, 0, 2, 2, 2, 0.3], [0.5, 0, 0, 2, 2, 2, 0], [0, 9, 0, 2, 2, 2, 0]]),
    np.array([2, 0, 1, 0]),
)
XYZ = np.array([[0.0, 0, 0], [1.2, 0, 0], [10, 0.1, 0], [0, 9, 0.2], [5, 5, 5]])
TRUTH = Truth(BOXES, np.array([2, 1, 0, 0, 3]), np.array([0, 2, 1, 3, -1]))


def fields(labels):
    assert labels.boxes.scores is not None
    names = ('semantic', 'instance', 'point_is_annotated', 'confidence', 'box_is_annotated')
    boxes = (labels.boxes.tensor, labels.boxes.labels, labels.boxes.scores)
    return [getattr(labels, name) for name in names] + [*boxes, np.array(labels.complete)]


def test_only_points_in_annotated_boxes_are_labelled():
    seen = hide(XYZ, TRUTH, (1, 3))
    assert seen.semantic.tolist() == [-1, -1, 0, 0, -1]
    assert seen.instance.tolist() == [-1, -1, 0, 1, -1]
    assert seen.point_is_annotated.tolist() == [False, False, True, True, False]
    assert seen.confidence.tolist() == [0, 0, 1, 1, 0]
    assert seen.confidence.dtype == np.float32
    np.testing.assert_array_equal(seen.boxes.tensor, BOXES.tensor[[1, 3]])
    assert seen.box_is_annotated.tolist() == [True, True]
    assert not seen.complete


def test_a_hidden_box_does_not_take_points_from_a_annotated_one():
    assert hide(XYZ, TRUTH, (2,)).semantic.tolist() == [1, 1, -1, -1, -1]  # box 0 holds the first point too
    assert hide(XYZ, TRUTH, (0, 2)).semantic.tolist() == [2, 1, -1, -1, -1]


def test_nothing_and_everything_annotated():
    nothing = hide(XYZ, TRUTH, ())
    assert (nothing.semantic == -1).all()
    assert len(nothing.boxes) == 0
    everything = hide(XYZ, TRUTH, range(4), complete=True)
    assert everything.complete
    assert everything.semantic.tolist() == [2, 1, 0, 0, -1]
    assert len(hide(np.zeros((0, 3)), TRUTH, (0,))) == 0


def test_point_labels_are_not_needed():
    bare = Truth(BOXES)
    for a, b in zip(fields(hide(XYZ, bare, (1,))), fields(hide(XYZ, TRUTH, (1,))), strict=True):
        np.testing.assert_array_equal(a, b, strict=True)
    assert scramble_hidden(bare, (1,), np.random.default_rng(0)).semantic is None


@pytest.mark.parametrize('annotated', [(), (0,), (1, 3), (2, 0), (0, 1, 2, 3)])
@pytest.mark.parametrize('seed', range(5))
def test_noise_in_hidden_labels_changes_nothing_that_is_seen(annotated, seed):
    noisy = scramble_hidden(TRUTH, annotated, np.random.default_rng(seed))
    for a, b in zip(fields(hide(XYZ, TRUTH, annotated)), fields(hide(XYZ, noisy, annotated)), strict=True):
        np.testing.assert_array_equal(a, b, strict=True)


def test_noise_reaches_everything_hidden_and_nothing_annotated():
    before = TRUTH.boxes.tensor.copy()
    labels, semantic = [], []
    for seed in range(40):
        noisy = scramble_hidden(TRUTH, (1,), np.random.default_rng(seed))
        assert isinstance(noisy, Truth)
        np.testing.assert_array_equal(noisy.boxes.tensor[1], BOXES.tensor[1])
        assert noisy.boxes.labels[1] == 0
        assert (noisy.boxes.tensor[[0, 2, 3]] != BOXES.tensor[[0, 2, 3]]).all()
        labels.append(noisy.boxes.labels)
        semantic.append(noisy.semantic)
    assert (np.std(labels, axis=0)[[0, 2, 3]] > 0).all()
    assert set(np.ravel(labels)) == {0, 1, 2}
    assert (np.std(semantic, axis=0) > 0).all()
    assert set(np.ravel(semantic)) == {-1, 0, 1, 2, 3}
    np.testing.assert_array_equal(TRUTH.boxes.tensor, before)


def test_any_frozen_truth_will_do():
    @dataclasses.dataclass(frozen=True)
    class Other:
        boxes: Boxes3D
        semantic: None = None
        instance: None = None
        name: str = 'mine'

    assert scramble_hidden(Other(BOXES), (0,), np.random.default_rng(0)).name == 'mine'
    assert len(scramble_hidden(Other(Boxes3D.empty()), (), np.random.default_rng(0)).boxes) == 0


@pytest.mark.parametrize('annotated', [(4,), (-1,)])
def test_rows_out_of_range(annotated):
    for function in (lambda: hide(XYZ, TRUTH, annotated), lambda: scramble_hidden(TRUTH, annotated, None)):
        with pytest.raises(ValueError, match='expected rows of 4 boxes.*draw the label budget again'):
            function()


def test_a_row_twice():
    with pytest.raises(ValueError, match='comes twice'):
        hide(XYZ, TRUTH, (1, 1))
