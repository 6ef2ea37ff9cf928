import numpy as np
import pytest

from rm3d_plugin.pseudo_labels.propagation.estimate import (
    calibrated,
    estimate_miou,
    expected_ious,
)

FREQUENCY = np.array([0.7, 0.25, 0.05])
CONFUSION = np.array([[0.96, 0.02, 0.02], [0.1, 0.85, 0.05], [0.05, 0.15, 0.8]])


def answer(rng, true, power=1.0):
    """Probabilities of points that are named with the confusion above; a power of 1: right as often as they say."""
    named = np.array([rng.choice(3, p=CONFUSION[own]) for own in true])
    posterior = CONFUSION * FREQUENCY[:, None]
    shares = (posterior / posterior.sum(axis=0)).T[named] ** power
    return shares / shares.sum(axis=1, keepdims=True)


def ious(shares, true):
    named = shares.argmax(axis=1)
    return np.array([((named == c) & (true == c)).sum() / ((named == c) | (true == c)).sum() for c in range(3)])


@pytest.mark.parametrize(('power', 'labels'), [(1 / 1.4, 20), (1 / 1.4, 40), (1.0, 40), (1 / 0.7, 1000)])
def test_intervals_hold_the_truth_and_many_labels_undo_over_confidence(power, labels):
    held, errors = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        true = rng.choice(3, 4000, p=FREQUENCY)
        shares = answer(rng, true, power)
        left = np.repeat(np.arange(3), labels)  # as many of each class, which the points are not
        told = estimate_miou(shares, answer(rng, left, power), left, 100, rng)
        truth = 100 * ious(shares, true).mean()
        held.append(told.low <= truth <= told.high)
        errors.append(told.miou - truth)
        assert told.low <= told.miou <= told.high
    assert np.mean(held) >= 0.8
    assert abs(np.mean(errors)) < 8.0


def test_ious_of_calibrated_probabilities_are_those_that_come_true():
    rng = np.random.default_rng(0)
    true = rng.choice(3, 20000, p=FREQUENCY)
    shares = answer(rng, true)
    np.testing.assert_allclose(expected_ious(shares, 1.0), ious(shares, true), atol=0.03)


def test_calibration_keeps_the_class_and_rows_of_zeros():
    shares = np.array([[0.6, 0.4], [0.1, 0.9], [0.0, 0.0]])
    out = calibrated(shares, 2.0)
    np.testing.assert_allclose(out, [[0.36 / 0.52, 0.16 / 0.52], [0.01 / 0.82, 0.81 / 0.82], [0.0, 0.0]], rtol=1e-6)


def test_nothing_to_estimate_from():
    rng = np.random.default_rng(0)
    assert estimate_miou(np.zeros((0, 2)), np.eye(2)[[0, 1] * 5], np.arange(10) % 2, 10, rng) is None
    few = np.array([0] * 9 + [1, 2, 3])  # one class of four
    assert estimate_miou(np.full((5, 4), 0.25), np.eye(4)[few], few, 10, rng) is None
