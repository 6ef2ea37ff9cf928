"""Kernel ridge regression over classes: by hand, left out for real, and frequencies of what has no label."""

import numpy as np
import pytest

from rm3d_plugin.pseudo_labels.common import kernel_classifier as kernels
from rm3d_plugin.pseudo_labels.common.kernel_classifier import (
    class_prior_em,
    evenly_chosen,
    fit_kernel_classifier,
    normalised,
    scaling_of,
)

LENGTH = 1.1
CENTERS = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 4.0]])


def blobs(counts, seed=0, spread=1.0):
    rng = np.random.default_rng(seed)
    own = np.repeat(np.arange(len(counts)), counts)
    return CENTERS[own] + spread * rng.normal(size=(len(own), 2)), own


def by_hand(model, examples, classes, rows):
    """Slow twin: every row asks every example, and the system of equations is solved outright."""
    said = sorted(set(classes.tolist()))
    scaled = model.scaling.apply(examples).astype(float)
    counts = np.array([(classes == c).sum() for c in said])

    def alike(a, b):
        return np.exp(-((a - b) ** 2).sum() / (2 * LENGTH**2))

    gram = np.array([[alike(a, b) for b in scaled] for a in scaled])
    for i, c in enumerate(classes):
        gram[i, i] += kernels.NOISE * counts[said.index(c)] / counts.max()
    weights = np.linalg.solve(gram, np.array([[float(c == k) for k in said] for c in classes]) - 1 / len(said))
    out = []
    for row in model.scaling.apply(rows).astype(float):
        value = sum(alike(row, example) * weight for example, weight in zip(scaled, weights, strict=True))
        powers = np.exp(model.sharpness * value)
        out.append(powers / powers.sum())
    return np.array(out)


def test_as_by_hand_and_near_the_right_class():
    examples, classes = blobs([12, 5, 8])
    rows, own = blobs([300, 20, 100], seed=1)
    numbers = np.array([2, 5, 6])  # classes 0, 1, 3 and 4 have no example
    model = fit_kernel_classifier(examples, numbers[classes], scaling_of(rows), LENGTH)
    shares = model.shares(rows, 8)
    np.testing.assert_allclose(shares[:, numbers], by_hand(model, examples, numbers[classes], rows), atol=1e-5)
    assert (np.delete(shares, numbers, axis=1) == 0).all() and shares.sum(axis=1) == pytest.approx(1.0)
    assert (shares.argmax(axis=1) == numbers[own]).mean() > 0.9
    found = class_prior_em(shares[:, numbers])
    assert found == pytest.approx([300 / 420, 20 / 420, 100 / 420], abs=0.06)


def test_rows_of_many_blocks_are_those_of_one(monkeypatch):
    examples, classes = blobs([5, 5, 5])
    rows, _ = blobs([40, 30, 30], seed=2)
    model = fit_kernel_classifier(examples, classes, scaling_of(rows), LENGTH)
    wanted = model.shares(rows, 3)
    monkeypatch.setattr(kernels, '_CHUNK', 7)
    np.testing.assert_allclose(model.shares(rows, 3), wanted, atol=1e-6)
    assert model.shares(rows[:0], 3).shape == (0, 3)


def test_sharpness_is_what_suits_examples_that_are_left_out():
    """The closed form says of each example what a fit without it says; the sharpness is the likeliest of those."""
    examples, classes = blobs([7, 4, 6], spread=2.0)
    scaling = scaling_of(examples)
    model = fit_kernel_classifier(examples, classes, scaling, LENGTH)
    counts = np.bincount(classes)
    noise = kernels.NOISE * (counts / counts.max())[classes]
    scaled = scaling.apply(examples).astype(float)
    gram = np.exp(-np.square(scaled[:, None] - scaled[None]).sum(-1) / (2 * LENGTH**2))
    wanted, likelihood = np.eye(3)[classes] - 1 / 3, dict.fromkeys(kernels.SHARPNESS, 0.0)
    for i, own in enumerate(classes):
        rest = np.delete(np.arange(len(classes)), i)
        weights = np.linalg.solve(gram[np.ix_(rest, rest)] + np.diag(noise[rest]), wanted[rest])
        value = gram[i, rest] @ weights
        for sharp in likelihood:
            powers = np.exp(sharp * value)
            likelihood[sharp] += np.log(powers[own] / powers.sum()) / counts[own]
    assert model.sharpness == max(likelihood, key=likelihood.get)


def test_frequencies_of_well_known_rows_are_their_shares():
    sure = np.eye(3)[np.repeat([0, 1, 2], [70, 20, 10])] * 0.96 + 0.01
    assert class_prior_em(sure / sure.sum(axis=1, keepdims=True)) == pytest.approx([0.7, 0.2, 0.1], abs=0.02)
    assert class_prior_em(np.full((5, 4), 0.25)) == pytest.approx([0.25] * 4)  # rows that tell nothing
    assert class_prior_em(np.zeros((0, 2))) == pytest.approx([0.5, 0.5])


def test_large_rows_count_more_and_classes_are_as_frequent_as_where_they_may_be():
    sure = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])  # the last row says nothing
    assert class_prior_em(sure) == pytest.approx([0.5, 0.25])
    assert class_prior_em(sure, np.array([1, 3, 6, 10])) == pytest.approx([4 / 20, 6 / 20])
    possible = np.array([[True, False], [True, False], [True, True], [False, True]])
    assert class_prior_em(sure, np.array([1, 3, 6, 10]), possible) == pytest.approx([4 / 10, 6 / 16])
    repeated = class_prior_em(np.repeat(np.array([[0.7, 0.3], [0.2, 0.8]]), [3, 2], axis=0))
    assert class_prior_em(np.array([[0.7, 0.3], [0.2, 0.8]]), np.array([3, 2])) == pytest.approx(repeated)
    assert normalised(sure * 4).tolist() == sure.tolist()


def test_weights_of_columns():
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(500, 3)) * [1, 10, 0] + [0, 5, 2]
    scaling = scaling_of(rows, np.array([1.0, 3.0, 6.0]))
    assert scaling.weights.tolist() == [0.25, 0.75, 0.0]  # a constant column has no say, and the others share its own
    scaled = scaling.apply(rows)
    assert scaled.shape == (500, 2) and np.square(scaled).mean(axis=0) == pytest.approx([0.25, 0.75], rel=0.02)
    far = scaling.apply(np.array([[1e9, scaling.middle[1], 0.0]]))
    assert far[0] == pytest.approx([kernels.CLIP * 0.5, 0.0])


def test_examples_are_spread_over_those_there_are():
    classes = np.repeat([4, 2, 7], [1, 10, 4])
    assert evenly_chosen(classes, 4).tolist() == [1, 4, 7, 10, 0, 11, 12, 13, 14]
    assert evenly_chosen(classes[:0], 4).tolist() == []


def test_columns_that_never_change_and_single_examples():
    rows, own = blobs([30, 30, 30])
    padded = np.c_[rows, np.full(90, 7.0)]
    plain = fit_kernel_classifier(rows[::9], own[::9], scaling_of(rows), LENGTH)
    wide = fit_kernel_classifier(padded[::9], own[::9], scaling_of(padded), LENGTH)
    np.testing.assert_allclose(wide.shares(padded, 3), plain.shares(rows, 3), atol=1e-6)
    one = fit_kernel_classifier(rows[:1], own[:1], scaling_of(rows), LENGTH)
    assert (one.shares(rows, 3) == [1.0, 0.0, 0.0]).all()
    with pytest.raises(ValueError, match='at least one labelled row'):
        fit_kernel_classifier(rows[:0], own[:0], scaling_of(rows), LENGTH)
