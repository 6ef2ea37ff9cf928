import numpy as np
import pytest

from rm3d_plugin.pseudo_labels.propagation.estimate import (
    POWERS,
    calibrated,
    estimate_miou,
    expected_ious,
    label_excess,
    label_gains,
    miou_draws,
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


def told_and_true(seed, power, labels):
    """Estimate and true mean IoU, percent."""
    rng = np.random.default_rng(seed)
    true = rng.choice(3, 4000, p=FREQUENCY)
    shares = answer(rng, true, power)
    left = np.repeat(np.arange(3), labels)  # as many of each class, which the points are not
    told = estimate_miou(shares, answer(rng, left, power), left, 100, rng)
    assert told.low <= told.miou <= told.high
    return told, 100 * ious(shares, true).mean()


@pytest.mark.parametrize(('power', 'labels'), [(1 / 1.4, 20), (1 / 1.4, 40), (1.0, 40)])
def test_intervals_hold_the_truth(power, labels):
    told, truth = zip(*(told_and_true(seed, power, labels) for seed in range(20)), strict=True)
    assert np.mean([each.low <= true <= each.high for each, true in zip(told, truth, strict=True)]) >= 0.8
    assert abs(np.mean([each.miou for each in told]) - np.mean(truth)) < 6.0


def test_many_labels_undo_over_confidence_and_narrow_the_interval():
    told, truth = zip(*(told_and_true(seed, 1 / 0.7, 1000) for seed in range(20)), strict=True)
    assert all(each.high - each.low < 8.0 for each in told)
    assert abs(np.mean([each.miou for each in told]) - np.mean(truth)) < 3.0  # rare classes count more than they should


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


def test_claims_are_counted_by_hand():
    left, classes, found = np.array([[0.8, 0.2], [0.6, 0.4], [0.3, 0.7]]), np.array([0, 1, 1]), np.array([0.75, 0.25])
    at = POWERS.index(1.0)
    by_hand = [0.75 * (0.8 - 1), 0.125 * 0.6, 0.125 * (0.7 - 1)]  # the second is wrong; two of a class share its weight
    np.testing.assert_allclose(label_excess(left, classes, found)[at], by_hand)
    doubled = [0.64 / 0.68, 0.36 / 0.52, 0.49 / 0.58]
    by_hand = [0.75 * (doubled[0] - 1), 0.125 * doubled[1], 0.125 * (doubled[2] - 1)]
    np.testing.assert_allclose(label_excess(left, classes, found)[POWERS.index(2.0)], by_hand)


def test_draws_lie_about_the_mean_of_what_both_ways_expect():
    rng = np.random.default_rng(0)
    expected = np.linspace(0.2, 0.8, len(POWERS))[:, None].repeat(2, axis=1)
    gains, excess = np.zeros((len(POWERS), 4)), np.ones((len(POWERS), 4))
    gains[3], excess[15] = 1.0, 0.0  # one says power 3, the other 15, however the labels weigh
    drawn = miou_draws(expected, gains, excess, np.array([4000, 4000]), 400, rng)
    middle = (expected[3, 0] + expected[15, 0]) / 2
    assert abs(drawn.mean() - middle) < 0.002
    worth = 0.75 * 4001
    np.testing.assert_allclose(drawn.std(), np.sqrt(middle * (1 - middle) / (worth + 1) / 2), rtol=0.15)


def test_the_likeliest_power_is_that_by_which_labels_were_drawn():
    rng = np.random.default_rng(3)
    true = rng.dirichlet([0.5, 0.5], 6000)
    classes = np.array([rng.choice(2, p=row) for row in true])
    shares = calibrated(true, 0.5).astype(np.float64)
    found = np.bincount(shares.argmax(axis=1), minlength=2) / len(shares)
    assert POWERS[label_gains(shares, classes, found).sum(axis=1).argmax()] == pytest.approx(2.0, rel=0.2)


def test_a_high_power_of_even_shares_keeps_the_likeliest_class():
    shares = np.full((1, 40), 1 / 40, dtype=np.float32)
    shares[0, 3] += 1e-3
    assert calibrated(shares, 32.0).argmax() == 3 and calibrated(shares, 32.0).sum() == pytest.approx(1, abs=1e-5)
    assert not calibrated(np.zeros((2, 3)), 2.0).any() and calibrated(np.zeros((0, 3)), 2.0).shape == (0, 3)
