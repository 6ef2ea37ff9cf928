import numpy as np
import pytest

from rm3d_plugin.pseudo_labels.propagation.choose import choose
from rm3d_plugin.pseudo_labels.propagation.folds import label_folds
from rm3d_plugin.pseudo_labels.propagation.labels import Labels, places_of
from rm3d_plugin.pseudo_labels.propagation.prior_shift import label_trust, prior_shift
from rm3d_plugin.pseudo_labels.propagation.rules import DEFAULT


def folds(xyz, classes, count=5):
    xyz, classes = np.asarray(xyz, float), np.asarray(classes)
    labels = Labels(np.arange(len(xyz)), classes, 9, places_of(xyz, classes, 0.1), xyz[:0], classes[:0])
    return label_folds(labels, count, np.random.default_rng(0))


def test_each_class_is_dealt_out_evenly():
    classes = np.repeat([0, 1, 2], 10)
    part = folds(np.arange(90.0).reshape(30, 3), classes)
    for own in range(3):
        assert np.bincount(part[classes == own], minlength=5).tolist() == [2] * 5


def test_labels_in_one_place_are_left_out_together_and_a_single_place_never():
    xyz = [[0, 0, 0], [0.05, 0, 0], [5, 0, 0], [9, 0, 0], [9.05, 0, 0]]
    part = folds(xyz, [0, 0, 0, 1, 1])
    assert part[0] == part[1] != part[2]
    assert part[3:].tolist() == [-1, -1]


def test_a_stroke_counts_as_one_label():
    stroke = np.column_stack([0.08 * np.arange(40), np.zeros(40), np.zeros(40)])
    xyz = np.concatenate([stroke, stroke[::-1] + [0, 0, 0.05], [[9, 9, 9]], [[9, 9, 9]]])
    classes = np.repeat([1, 0, 1, 1], [40, 40, 1, 1])
    places = places_of(xyz, classes, 0.1)
    assert len(np.unique(places[:40])) == len(np.unique(places[40:80])) == 1 and places[80] == places[81]
    assert Labels(np.arange(82), classes, 3, places, xyz[:0], classes[:0]).place_counts.tolist() == [1, 2, 0]
    assert places_of(xyz[:0], classes[:0], 0.1).shape == (0,)


def test_trust_grows_with_the_labels_of_the_poorest_classes():
    trusts = [label_trust(np.array(counts), 3.0) for counts in ([1, 1], [1, 19], [5, 5], [20, 20], [200, 200])]
    assert trusts[0] == 0.0
    assert trusts == sorted(trusts)
    assert trusts[-1] < 1.0


def test_a_prior_shift_follows_what_is_frequent_where_labels_are_even():
    said, sizes = np.repeat([0, 1], [90, 10]), np.ones(100, int)
    even = prior_shift(said, sizes, np.array([20, 20]), 3.0)
    assert even[0] / even[1] == pytest.approx(9.0 ** label_trust(np.array([20, 20]), 3.0), rel=0.05)
    drawn = prior_shift(said, sizes, np.array([180, 20]), 3.0)
    assert drawn[0] / drawn[1] == pytest.approx(1.0, rel=0.1)


def test_of_labels_and_places_the_count_rules_that_the_solution_contradicts_less():
    said, sizes, places = np.repeat([0, 1], [90, 10]), np.ones(100, int), np.array([20, 20])
    dense = prior_shift(said, sizes, places, 3.0, np.array([900, 100]))  # a chance draw that fell together
    assert dense[0] / dense[1] == pytest.approx(1.0, rel=0.1)
    strokes = prior_shift(said, sizes, places, 3.0, np.array([20, 9000]))  # a stroke on the rare class
    np.testing.assert_allclose(strokes, prior_shift(said, sizes, places, 3.0))


def test_the_default_is_left_only_for_one_that_is_clearly_ahead():
    rng = np.random.default_rng(0)
    classes = rng.integers(0, 4, 200)
    noisy = np.where(rng.uniform(size=200) < 0.6, classes, (classes + 1) % 4)
    slightly = np.where(rng.uniform(size=200) < 0.62, classes, (classes + 1) % 4)
    shares = {DEFAULT: np.eye(4)[noisy], 'walker': np.eye(4)[slightly], 'nearest': np.eye(4)[classes]}
    assert choose({name: shares[name] for name in (DEFAULT, 'walker')}, classes, 2.0).candidate == DEFAULT
    chosen = choose(shares, classes, 2.0)
    assert chosen.candidate == 'nearest'
    assert chosen.accuracy['nearest'] == pytest.approx(1.0)
