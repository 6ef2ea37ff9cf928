import numpy as np
import pytest

from rm3d_plugin.pseudo_labels.propagation import labels
from rm3d_plugin.pseudo_labels.propagation.choose import choose
from rm3d_plugin.pseudo_labels.propagation.folds import label_folds
from rm3d_plugin.pseudo_labels.propagation.labels import Labels, one_of_each, places_of
from rm3d_plugin.pseudo_labels.propagation.prior_shift import label_trust, prior_shift
from rm3d_plugin.pseudo_labels.propagation.rules import DEFAULT

FAR = np.array([100.0, 100.0, 100.0])


def among(xyz, each=100):
    """Points, and a centimetre round each of them others without a label."""
    xyz = np.asarray(xyz, float)
    ring = np.random.default_rng(0).normal(size=(each, 3))
    ring *= 0.01 / np.linalg.norm(ring, axis=1, keepdims=True)
    return np.concatenate([xyz, *(xyz[:, None] + ring)])


def labels_of(xyz, points, classes, count=9):
    """Labels whose looks are not asked."""
    points, classes = np.asarray(points), np.asarray(classes)
    places = places_of(np.asarray(xyz, float), points, classes)
    return Labels(points, classes, count, places, places, np.zeros((0, 3)), classes[:0])


def folds(xyz, classes, count=5):
    made = labels_of(among(xyz), np.arange(len(xyz)), classes)
    return label_folds(made, count, np.random.default_rng(0))


def test_each_class_is_dealt_out_evenly():
    classes = np.repeat([0, 1, 2], 10)
    part = folds(np.arange(90.0).reshape(30, 3), classes)
    for own in range(3):
        assert np.bincount(part[classes == own], minlength=5).tolist() == [2] * 5


def test_labels_in_one_place_are_left_out_together_and_a_single_place_never():
    xyz = [[0, 0, 0], [0.001, 0, 0], [5, 0, 0], [9, 0, 0], [9.001, 0, 0]]
    part = folds(xyz, [0, 0, 0, 1, 1])
    assert part[0] == part[1] != part[2]
    assert part[3:].tolist() == [-1, -1]


def plane(side=60, step=0.1):
    """A square of points, its rows four times as far apart as the points of one: rings of a scanner."""
    x, y = np.meshgrid(step * np.arange(side), 4 * step * np.arange(side // 4))
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def test_a_stroke_counts_as_one_label():
    xyz = np.concatenate([plane(), [FAR, FAR]])
    first = np.flatnonzero(np.linalg.norm(xyz - [2, 2, 0], axis=1) < 1.0)
    second = np.flatnonzero(np.linalg.norm(xyz - [4.5, 3, 0], axis=1) < 0.7)
    points = np.concatenate([first, second, [len(xyz) - 2, len(xyz) - 1]])
    classes = np.repeat([1, 0, 1], [len(first), len(second), 2])
    made = labels_of(xyz, points, classes, 3)
    assert [len(np.unique(made.places[classes == own])) for own in range(2)] == [1, 2]
    assert made.places[-1] == made.places[-2]  # one point, clicked twice
    assert made.place_counts.tolist() == [1, 2, 0]
    assert places_of(xyz, points[:0], classes[:0]).shape == (0,)


def test_a_stroke_is_one_place_however_many_are_looked_at_at_once(monkeypatch):
    xyz, points = plane(), np.flatnonzero(np.linalg.norm(plane() - [3, 3, 0], axis=1) < 1.6)
    whole = places_of(xyz, points, np.zeros(len(points), int))
    monkeypatch.setattr(labels, '_CHUNK', 7)
    np.testing.assert_array_equal(places_of(xyz, points, np.zeros(len(points), int)), whole)
    assert len(np.unique(whole)) == 1


def test_places_are_those_that_are_found_pair_by_pair():
    rng = np.random.default_rng(3)
    xyz = rng.uniform(0, 3, (200, 3))
    points = np.sort(rng.choice(200, 90, replace=False))
    classes = (xyz[points, 0] > 1.5).astype(int)
    found, label = places_of(xyz, points, classes), np.full(200, -1)
    label[points] = classes
    place = np.arange(len(points))
    for row, point in enumerate(points):
        near = np.argsort(np.linalg.norm(xyz - xyz[point], axis=1))[1 : labels.NEAREST + 1]
        for rank, other in enumerate(near):
            if label[other] == label[point] and np.mean(label[near[: rank + 1]] == label[point]) >= labels.MOST:
                joined = (place[row], place[np.flatnonzero(points == other)[0]])
                place[np.isin(place, joined)] = min(joined)
    np.testing.assert_array_equal(found[:, None] == found, place[:, None] == place)
    assert 5 < len(np.unique(found)) < 60


@pytest.mark.parametrize('seed', [None, 0, 1])
def test_places_do_not_depend_on_the_order_of_points_that_are_as_far_away(seed):
    grid = np.stack(np.meshgrid(np.arange(20), np.arange(20)), axis=-1).reshape(-1, 2) * 0.1
    xyz = np.column_stack([grid, np.zeros(len(grid))])
    order = np.arange(400) if seed is None else np.random.default_rng(seed).permutation(400)
    column, disc = np.flatnonzero(grid[:, 0] == 0.5), np.flatnonzero(np.linalg.norm(grid - 1.4, axis=1) < 0.35)
    number = np.argsort(order)  # of each point after it
    points = number[np.concatenate([column, disc])]
    places = places_of(xyz[order], points, np.repeat([0, 1], [len(column), len(disc)]))
    assert len(np.unique(places[: len(column)])) == len(column)  # a line of single points
    assert len(np.unique(places[len(column) :])) == 1


def test_labels_at_one_spot_are_one_place_whatever_else_lies_there():
    xyz = np.concatenate([np.zeros((4, 3)), np.random.default_rng(0).normal(size=(100, 3))])
    for points in ([2, 3], [0, 3], [1, 2]):
        assert len(np.unique(places_of(xyz, np.array(points), np.zeros(2, int)))) == 1
    assert len(np.unique(places_of(xyz, np.array([2, 3]), np.array([0, 1])))) == 2


def test_labels_drawn_by_chance_are_places_of_their_own():
    xyz = plane()
    points = np.sort(np.random.default_rng(0).choice(len(xyz), 20, replace=False))
    assert len(np.unique(places_of(xyz, points, np.zeros(20, int)))) >= 19


def test_one_label_of_each_place_is_judged():
    places = np.repeat([3, 1, 2], [4, 1, 5])
    rows = one_of_each(places, seed=0)
    assert sorted(places[rows]) == [1, 2, 3] and (np.diff(rows) > 0).all()
    assert {int(one_of_each(places, seed)[0]) for seed in range(40)} == {0, 1, 2, 3}


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
