"""The ratio of two densities: against loops, against known densities, and left out as if it had not been there."""

import numpy as np
import pytest

from rm3d_plugin.pseudo_labels.common import density_ratio
from rm3d_plugin.pseudo_labels.common.density_ratio import CENTRES, LENGTH, RIDGE, fit_density_ratio
from rm3d_plugin.pseudo_labels.common.kernel_classifier import scaling_of


def slow_ratio(labelled, rows, scaling, at, centres=None):
    """uLSIF as in the paper, kernel by kernel."""
    scaled, own, where = (scaling.apply(part).astype(float) for part in (rows, labelled, at))
    chosen = np.unique(np.linspace(0, len(rows) - 1, min(len(rows), CENTRES)).astype(int))
    centres = np.concatenate([own, scaled[chosen]]) if centres is None else centres

    def kernel(x):
        return np.array([np.exp(-((x - c) ** 2).sum() / (2 * LENGTH**2)) for c in centres])

    H = sum(np.outer(kernel(x), kernel(x)) for x in scaled) / len(scaled)
    h = sum(kernel(x) for x in own) / len(own)
    weights = np.linalg.inv(H + RIDGE * np.eye(len(centres))) @ h
    return np.array([max(kernel(x) @ weights, 0.0) for x in where])


@pytest.mark.parametrize('seed', range(3))
def test_ratio_equals_the_slow_one_and_its_left_out_values_those_of_a_fit_without(seed):
    rng = np.random.default_rng(seed)
    rows, labelled = rng.normal(size=(60, 4)) * [1, 5, 0.1, 0], rng.normal(1.0, 0.3, size=(4, 4)) * [1, 5, 0.1, 0]
    scaling = scaling_of(rows)
    ratio, left_out = fit_density_ratio(labelled, rows, scaling)
    assert ratio.of(rows) == pytest.approx(slow_ratio(labelled, rows, scaling, rows), abs=1e-4)
    centres = np.concatenate([scaling.apply(labelled), scaling.apply(rows)]).astype(float)  # the kernels stay
    for row in range(4):
        others = np.delete(labelled, row, axis=0)
        assert left_out[row] == pytest.approx(
            slow_ratio(others, rows, scaling, labelled[row : row + 1], centres)[0], abs=1e-4
        )


def test_it_is_high_where_labelled_rows_are_and_others_are_not():
    rng = np.random.default_rng(0)
    crowd, apart = rng.normal(0.0, 1.0, size=(900, 2)), rng.normal(4.0, 0.4, size=(100, 2))
    rows = np.concatenate([crowd, apart])
    ratio, left_out = fit_density_ratio(apart[:5], rows, scaling_of(rows))
    assert ratio.of(apart).min() > 5 * np.quantile(ratio.of(crowd), 0.99)
    assert (left_out > 3.0).all() and 5.0 < ratio.of(apart).mean() < 15.0  # a tenth of all rows are there: truly ten


def test_labelled_rows_like_the_others_tell_nothing():
    rows = np.random.default_rng(1).normal(size=(2000, 2))
    ratio, _ = fit_density_ratio(rows[:500], rows, scaling_of(rows))
    assert 0.6 < ratio.of(rows).mean() < 1.1 and ratio.of(rows).std() < 0.3


def test_one_labelled_row_stands_for_itself():
    rows = np.random.default_rng(2).normal(size=(50, 3))
    ratio, left_out = fit_density_ratio(rows[:1], rows, scaling_of(rows))
    assert left_out == pytest.approx(ratio.of(rows[:1]), rel=1e-5)


def test_many_rows_ask_for_few_kernels(monkeypatch):
    monkeypatch.setattr(density_ratio, 'CENTRES', 20)
    rows = np.random.default_rng(3).normal(size=(5000, 3))
    ratio, _ = fit_density_ratio(rows[:30], rows, scaling_of(rows))
    assert len(ratio.centres) == 40 and ratio.of(rows[:0]).shape == (0,)


@pytest.mark.parametrize(('labelled', 'rows'), [(0, 5), (2, 0)])
def test_rows_of_both_kinds_are_asked_for(labelled, rows):
    scaling = scaling_of(np.ones((1, 2)))
    with pytest.raises(ValueError, match=rf'rows of both kinds, got {labelled} labelled and {rows} in all'):
        fit_density_ratio(np.ones((labelled, 2)), np.ones((rows, 2)), scaling)
