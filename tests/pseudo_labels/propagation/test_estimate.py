import numpy as np
import pytest

from rm3d_plugin.pseudo_labels.propagation.estimate import (
    best_sharpness,
    believed_confusion,
    estimate_miou,
    mean_iou,
)

FREQUENCY = np.array([0.7, 0.25, 0.05])
CONFUSION = np.array([[0.96, 0.02, 0.02], [0.1, 0.85, 0.05], [0.05, 0.15, 0.8]])


def answer(rng, true):
    """Calibrated probabilities that name classes with the confusion above."""
    named = np.array([rng.choice(3, p=CONFUSION[own]) for own in true])
    posterior = CONFUSION * FREQUENCY[:, None]
    return (posterior / posterior.sum(axis=0)).T[named]


def true_miou(shares, true):
    named = shares.argmax(axis=1)
    return 100 * np.mean([((named == c) & (true == c)).sum() / ((named == c) | (true == c)).sum() for c in range(3)])


def test_mean_iou_of_a_known_confusion():
    joint = FREQUENCY[:, None] * CONFUSION
    hits = np.diag(joint)
    expected = np.mean(hits / (joint.sum(axis=0) + joint.sum(axis=1) - hits))
    assert mean_iou(CONFUSION, joint.sum(axis=0)) == pytest.approx(expected, abs=2e-3)


def test_intervals_hold_the_truth():
    held, errors = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        true = rng.choice(3, 4000, p=FREQUENCY)
        shares = answer(rng, true)
        left = np.repeat(np.arange(3), 20)  # as many of each class, which the points are not
        told = estimate_miou(shares, answer(rng, left), left, 100, rng)
        held.append(told.low <= true_miou(shares, true) <= told.high)
        errors.append(told.miou - true_miou(shares, true))
        assert told.low <= told.miou <= told.high
    assert np.mean(held) >= 0.8
    assert abs(np.mean(errors)) < 5.0


def test_sharpness_undoes_over_confidence():
    rng = np.random.default_rng(0)
    true = rng.choice(3, 3000, p=FREQUENCY)
    shares = answer(rng, true)
    overconfident = shares**2 / (shares**2).sum(axis=1, keepdims=True)
    assert best_sharpness(shares, true, FREQUENCY) == 1.0
    assert best_sharpness(overconfident, true, FREQUENCY) == 0.5


def test_believed_confusion_is_the_true_one_of_calibrated_probabilities():
    rng = np.random.default_rng(0)
    shares = answer(rng, rng.choice(3, 20000, p=FREQUENCY))
    believed = believed_confusion(shares, shares.argmax(axis=1), 1.0)
    np.testing.assert_allclose(believed, CONFUSION, atol=0.05)


def test_nothing_to_estimate():
    assert estimate_miou(np.zeros((0, 2)), np.eye(2), np.arange(2), 10, np.random.default_rng(0)) is None
