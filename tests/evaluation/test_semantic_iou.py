"""IoU of point classes, against hand-worked cases and a slow twin."""

import doctest
from importlib import import_module

import numpy as np
import pytest
from reference.sem_seg_slow import scores as slow_scores

from rm3d_plugin.evaluation.functional import confusion_counts, semantic_iou, semantic_scores


def one(prediction, truth, classes, **options):
    return semantic_iou([np.array(prediction)], [np.array(truth)], classes, **options)


def test_doctests():
    for name in ('semantic_iou', 'instance_ap'):
        failed, tried = doctest.testmod(import_module(f'rm3d_plugin.evaluation.functional.{name}'))
        assert tried and not failed


def test_by_hand():
    got = one([0, 0, 1, 1, 0], [0, 0, 1, 0, 1], 2)
    assert got.confusion.tolist() == [[2, 1, 0], [1, 1, 0]]
    assert got.iou.tolist() == [0.5, pytest.approx(1 / 3)]
    assert got.recall.tolist() == [pytest.approx(2 / 3), 0.5]
    assert got.precision.tolist() == [pytest.approx(2 / 3), 0.5]
    assert got.mean_iou == pytest.approx(5 / 12)
    assert got.mean_accuracy == pytest.approx(7 / 12)
    assert got.accuracy == 0.6


def test_perfect_is_one_and_nothing_is_zero():
    truth = [0, 1, 2, 2]
    perfect = one(truth, truth, 3)
    assert (perfect.mean_iou, perfect.mean_accuracy, perfect.accuracy) == (1.0, 1.0, 1.0)
    nothing = one([-1] * 4, truth, 3)
    assert (nothing.mean_iou, nothing.mean_accuracy, nothing.accuracy) == (0.0, 0.0, 0.0)
    empty = one(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), 3)
    assert (empty.mean_iou, empty.accuracy) == (0.0, 0.0)
    assert np.isnan(empty.iou).all()


@pytest.mark.parametrize('stray', [2, 3, 255, -1, -7, 10**12])
def test_a_prediction_that_is_no_class_spills_nowhere(stray):
    got = one([stray, 1, 0], [0, 1, 0], 2)
    assert got.confusion.tolist() == [[1, 0, 1], [0, 1, 0]]
    assert got.iou.tolist() == [0.5, 1.0]


def test_a_class_with_predictions_and_no_truth_leaves_the_mean_a_number():
    got = one([0, 2, 1], [0, 0, 1], 4)
    assert got.iou[:2].tolist() == [0.5, 1.0] and np.isnan(got.iou[2:]).all()
    assert got.mean_iou == 0.75  # the point lost to class 2 costs class 0
    assert np.isnan(got.recall[2]) and got.precision[2] == 0
    strict = one([0, 2, 1], [0, 0, 1], 4, absent='zero')
    assert strict.iou[2] == 0 and np.isnan(strict.iou[3])
    assert strict.mean_iou == 0.5


def test_ignored_truth_counts_nowhere_and_other_strange_truth_is_an_error():
    assert one([0, 1, 1, 0], [0, -1, 255, 1], 2).confusion.sum() == 2
    with pytest.raises(ValueError, match='truth holds 2; expected 0..1'):
        one([0], [2], 2)
    assert one([0], [2], 2, ignored=(2,)).confusion.sum() == 0
    with pytest.raises(ValueError, match=r'\(2,\) predictions'):
        one([0, 1], [0], 2)
    with pytest.raises(ValueError):
        semantic_iou([np.zeros(1, dtype=int)], [], 2)


def test_accuracy_over_predicted_points_only_on_request():
    assert one([0, -1, 1, 0], [0, 0, 1, 1], 2).accuracy == 0.5
    lenient = one([0, -1, 1, 0], [0, 0, 1, 1], 2, accuracy_over='predicted')
    assert lenient.accuracy == pytest.approx(2 / 3)
    assert lenient.mean_iou == one([0, -1, 1, 0], [0, 0, 1, 1], 2).mean_iou
    with pytest.raises(ValueError, match='accuracy_over'):
        semantic_scores(np.zeros((1, 2), dtype=int), accuracy_over='all')
    with pytest.raises(ValueError, match='absent'):
        semantic_scores(np.zeros((1, 2), dtype=int), absent='nan')


@pytest.mark.parametrize('seed', range(6))
def test_equals_the_slow_twin(seed):
    rng = np.random.default_rng(seed)
    sizes = rng.integers(0, 60, 3)
    truths = [rng.choice([-1, 0, 1, 2, 4, 255], n) for n in sizes]
    predictions = [rng.integers(-1, 6, n) for n in sizes]
    got = semantic_iou(predictions, truths, 5)
    want, right = slow_scores([p.tolist() for p in predictions], [t.tolist() for t in truths], 5)
    for name, column in zip(('iou', 'recall', 'precision'), zip(*want, strict=True), strict=True):
        np.testing.assert_allclose(getattr(got, name), [np.nan if v is None else v for v in column], atol=1e-15)
    assert got.accuracy == pytest.approx(right)


def test_scenes_add_up_and_the_order_of_points_is_of_no_account():
    rng = np.random.default_rng(0)
    prediction, truth = rng.integers(0, 3, 50), rng.integers(0, 3, 50)
    order = rng.permutation(50)
    whole = confusion_counts(prediction, truth, 3)
    parts = confusion_counts(prediction[order[:20]], truth[order[:20]], 3)
    parts = parts + confusion_counts(prediction[order[20:]], truth[order[20:]], 3)
    np.testing.assert_array_equal(whole, parts)
