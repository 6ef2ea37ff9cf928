"""Point budgets are drawn once by seed, keep their promises, and cannot be altered unseen."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rm3d_plugin.datasets import Truth
from rm3d_plugin.label_budgets import (
    BudgetError,
    PointAmount,
    draw_point_budget,
    draw_points,
    hide_points,
    load_point_budget,
    point_amount,
    save_point_budget,
    scramble_hidden_points,
)
from rm3d_plugin.storage import write_npz
from rm3d_plugin.structures import Boxes3D


def truth(semantic, instance=None):
    instance = None if instance is None else np.asarray(instance)
    return Truth(Boxes3D.empty(), np.asarray(semantic, dtype=np.int64), instance)


def world(scenes=6, points=400, classes=5, seed=0):
    rng = np.random.default_rng(seed)
    return {
        f's{i}': truth(rng.integers(-1, classes, size=points), rng.integers(-1, 4, size=points)) for i in range(scenes)
    }


def draw(truths, amount, seed=0):
    return draw_point_budget(list(truths), truths.__getitem__, amount, seed)


# ---------------------------------------------------------------------- names


@pytest.mark.parametrize(
    ('name', 'fields'),
    [
        ('onept', {'per_class': 1}),
        ('onept_instance', {'per_instance': 1}),
        ('20pts', {'per_scene': 20}),
        ('200pts', {'per_scene': 200}),
        ('20pts_class', {'per_class': 20}),
        ('0p03pct', {'percent': 0.03}),
        ('0p2pct', {'percent': 0.2}),
        ('1pct', {'percent': 1.0}),
        ('scenes5pct', {'scene_percent': 5.0}),
        ('full', {'percent': 100.0}),
        ('0p2pct_no_instances', {'percent': 0.2, 'instances': False}),
    ],
)
def test_names(name, fields):
    assert point_amount(name) == PointAmount(**fields) == point_amount(fields) == point_amount(PointAmount(**fields))


@pytest.mark.parametrize('name', ['', '1%', 'pct', '0.2pct', 'onepts', 'scenes20', '20pts_instance', '_no_instances'])
def test_unknown_names_list_the_known_ones(name):
    with pytest.raises(BudgetError, match=r'expected one of onept, .*full \(or another number\), got'):
        point_amount(name)


@pytest.mark.parametrize(
    ('fields', 'words'),
    [
        ({}, 'exactly one of percent, .*got none'),
        ({'percent': 1, 'per_scene': 2}, r"got \['percent', 'per_scene'\]"),
        ({'percent': 0}, r'percent: expected a number in \(0, 100\], got 0'),
        ({'percent': 101}, 'percent'),
        ({'per_scene': 0}, 'per_scene: expected a number from 1'),
        ({'per_scene': 1.5}, 'per_scene'),
        ({'clicks': ''}, 'clicks: expected the name of a file'),
        ({'points': 3}, 'expected fields among percent, .* got points'),
    ],
)
def test_wrong_fields(fields, words):
    with pytest.raises(BudgetError, match=words):
        point_amount(fields)


# ---------------------------------------------------------------------- one scene


SEMANTIC = np.array([0] * 50 + [1] * 30 + [2] + [-1] * 19)
INSTANCE = np.array([-1] * 50 + [4] * 10 + [7] * 20 + [0] + [-1] * 19)


def drawn(name, seed=0, semantic=SEMANTIC, instance=INSTANCE):
    return draw_points(semantic, instance, point_amount(name), np.random.default_rng(seed))


@pytest.mark.parametrize('seed', range(5))
def test_counts_in_one_scene(seed):
    def counts(name):
        return np.bincount(SEMANTIC[drawn(name, seed)], minlength=3).tolist()

    assert counts('onept') == [1, 1, 1]
    assert counts('7pts_class') == [7, 7, 1]
    assert sum(counts('20pts')) == 20 and min(counts('20pts')) == 1
    assert counts('100pts') == [50, 30, 1]
    assert sum(counts('2pts')) == 2 and max(counts('2pts')) == 1
    assert sum(counts('10pct')) == 8 and min(counts('10pct')) == 1  # 8.1
    assert counts('1pct') == [1, 1, 1]  # one of each class although 1 % is one point
    one_each = drawn('onept_instance', seed)
    assert sorted(INSTANCE[one_each].tolist()) == [-1, 0, 4, 7]
    assert SEMANTIC[one_each[INSTANCE[one_each] < 0]].tolist() == [0]


def test_fewer_points_than_classes_give_every_class_its_chance():
    classes = np.arange(8)
    seen = np.concatenate([drawn('3pts', seed, classes, np.full(8, -1)) for seed in range(400)])
    assert len(seen) == 1200
    assert all(100 < count < 200 for count in np.bincount(seen))  # 150


def test_every_labelled_point_has_its_chance():
    seen = np.bincount(np.concatenate([drawn('20pts', seed) for seed in range(500)]), minlength=100)
    assert seen[80] == 500 and seen[81:].max() == 0
    assert 60 < seen[:80].min() and seen[:80].max() < 190  # 119


@settings(derandomize=True, max_examples=60, deadline=None)
@given(
    st.lists(st.integers(-1, 4), max_size=60),
    st.sampled_from(['onept', '3pts', '20pts', '0p2pct', '40pct', 'onept_instance', '2pts_class']),
    st.integers(0, 1000),
)
def test_promises(semantic, name, seed):
    semantic = np.array(semantic, dtype=np.int64)
    rows = drawn(name, seed, semantic, np.where(semantic == 1, np.arange(len(semantic)) % 3, -1))
    assert (np.diff(rows) > 0).all() and (semantic[rows] >= 0).all()
    present = set(semantic[semantic >= 0].tolist())
    if name == '3pts':
        assert len(rows) == min(3, int((semantic >= 0).sum()))
        assert len(set(semantic[rows].tolist())) == min(len(rows), len(present))
    else:
        assert set(semantic[rows].tolist()) == present


@pytest.mark.parametrize('semantic', [[], [-1, -1], [3]])
@pytest.mark.parametrize('name', ['onept', '20pts', '1pct', 'onept_instance'])
def test_scenes_with_hardly_anything(name, semantic):
    semantic = np.array(semantic, dtype=np.int64)
    assert drawn(name, 0, semantic, np.full(len(semantic), -1)).tolist() == ([0] if 3 in semantic else [])


# ---------------------------------------------------------------------- whole data sets


def test_counts_and_labels_by_hand():
    truths = {'a': truth([0, 0, 1, -1], [-1, -1, 5, -1]), 'b': truth([1, 1, 1]), 'c': truth([-1])}
    budget = draw(truths, 'onept')
    assert budget.total_per_class == {0: 2, 1: 4}
    assert budget.annotated_per_class == {0: 1, 1: 2}
    assert budget.annotated_count == 3
    assert tuple(budget.sizes['a']) == (4, 3, 1)
    assert budget.annotated['a'].points[-1] == 2 and budget.annotated['a'].instance.tolist() == [-1, 5]
    assert budget.annotated['a'].semantic.tolist() == [0, 1]
    assert budget.annotated['b'].instance.tolist() == [-1]
    assert budget.annotated['c'].points.tolist() == []
    lines = budget.summary(('ground', 'car')).splitlines()
    assert lines[0].endswith('seed 0: 3 of 6 labelled points (50 %) in 2 of 3 scenes')
    assert [line.split() for line in lines[1:]] == [['ground', '1', 'of', '2'], ['car', '2', 'of', '4']]


def test_instances_may_stay_hidden():
    hidden = draw(world(), '20pts_no_instances')
    shown = draw(world(), '20pts')
    for name, points in hidden.annotated.items():
        np.testing.assert_array_equal(points.points, shown.annotated[name].points)
        assert (points.instance == -1).all() and (shown.annotated[name].instance >= 0).any()
    assert 'instances stay hidden' in hidden.summary() and 'hidden' not in shown.summary()


def test_a_scene_is_drawn_from_the_seed_and_itself_alone():
    truths = world()
    first = draw(truths, '20pts', 3)
    again = draw(dict(reversed(truths.items())), '20pts', 3)
    assert first.hash == again.hash
    alone = draw({'s2': truths['s2']}, '20pts', 3)
    np.testing.assert_array_equal(alone.annotated['s2'].points, first.annotated['s2'].points)
    other = dict(truths, s0=world(seed=9)['s0'])
    np.testing.assert_array_equal(draw(other, '20pts', 3).annotated['s1'].points, first.annotated['s1'].points)
    assert len({draw(truths, '20pts', seed).hash for seed in range(10)}) == 10
    assert first.annotated['s0'].points.tolist() != first.annotated['s1'].points.tolist()


def test_scene_budgets_reveal_whole_scenes():
    truths = world(scenes=20)
    budget = draw(truths, 'scenes10pct')
    assert len(budget.complete) == 2
    assert budget.annotated_count == sum(int((truths[name].semantic >= 0).sum()) for name in budget.complete)
    assert all(len(points.points) == 0 for points in budget.annotated.values())
    assert draw(world(scenes=3), 'scenes1pct').complete  # at least one
    assert len({draw(truths, 'scenes10pct', seed).complete for seed in range(10)}) > 5
    assert ', 2 of them completely' in budget.summary()
    full = draw(truths, 'full')
    assert full.complete == frozenset(truths)
    assert full.annotated_per_class == full.total_per_class


def test_points_are_checked_against_the_scene():
    budget = draw({'a': truth([0, 0, 1])}, 'onept')
    assert len(budget.points_of('a', 3).points) == 2
    with pytest.raises(BudgetError, match='scene b: not in this label budget of 1 scenes'):
        budget.points_of('b', 3)
    with pytest.raises(BudgetError, match='scene a: the label budget was drawn from 3 points, the scene has 4'):
        budget.points_of('a', 4)
    with pytest.raises(ValueError, match='scene a is labelled completely'):
        draw({'a': truth([0])}, 'full').points_of('a', 1)


def test_nothing_to_reveal():
    for truths in ({}, {'a': truth([-1, -1])}, {'a': truth([])}):
        with pytest.raises(BudgetError, match=rf'no point can be annotated: {len(truths)} scenes hold 0 labelled'):
            draw(truths, 'onept')
    with pytest.raises(BudgetError, match='scene a: has no point labels'):
        draw({'a': SimpleNamespace(boxes=None, semantic=None, instance=None)}, 'onept')
    with pytest.raises(BudgetError, match=r'my\.csv says what is annotated'):
        draw(world(), {'clicks': 'my.csv'})


# ---------------------------------------------------------------------- on disk


@pytest.mark.parametrize('name', ['20pts', 'scenes20pct', 'full', 'onept_instance', '0p6pct_no_instances'])
def test_a_saved_budget_comes_back_equal(tmp_path, name):
    budget = draw(world(), name, seed=11)
    save_point_budget(tmp_path / 'b.json', budget)
    again = load_point_budget(tmp_path / 'b.json')
    assert (again.hash, again.amount, again.seed, again.complete) == (budget.hash, budget.amount, 11, budget.complete)
    assert again.annotated_per_class == budget.annotated_per_class and again.sizes == budget.sizes
    for scene, points in budget.annotated.items():
        for ours, theirs in zip(points, again.annotated[scene], strict=True):
            np.testing.assert_array_equal(ours, theirs, strict=True)


def test_an_altered_budget_is_refused(tmp_path):
    path = tmp_path / 'b.json'
    budget = draw(world(), '20pts', seed=1)
    save_point_budget(path, budget)
    content = json.loads(path.read_text())
    for change in ({'seed': 2}, {'complete': ['s0']}, {'amount': {**content['amount'], 'per_scene': 21}}):
        path.write_text(json.dumps(content | change))
        with pytest.raises(BudgetError, match=r'b\.json: was altered after it was drawn'):
            load_point_budget(path)
    path.write_text(json.dumps(content))
    load_point_budget(path)
    arrays = dict(np.load(tmp_path / 'b.npz'))
    arrays = {name: values for name, values in arrays.items() if not name.startswith('__')}
    write_npz(tmp_path / 'b.npz', arrays | {'semantic': (arrays['semantic'] + 1) % 5})
    with pytest.raises(BudgetError, match=r'b\.json: was altered'):
        load_point_budget(path)
    write_npz(tmp_path / 'b.npz', arrays | {'offsets': arrays['offsets'][:-1]})
    with pytest.raises(BudgetError, match=r'b\.json: not a label budget'):
        load_point_budget(path)
    (tmp_path / 'b.npz').write_bytes(b'junk')
    with pytest.raises(BudgetError, match=r'b\.npz: cut off or altered'):
        load_point_budget(path)
    (tmp_path / 'b.npz').unlink()
    with pytest.raises(BudgetError, match=r'b\.npz: missing'):
        load_point_budget(path)


@pytest.mark.parametrize(
    ('text', 'words'),
    [('[]', 'not a label budget'), ('{"format": 1}', 'no budget of points'), ('{"format": 9}', 'format 9, expected 1')],
)
def test_other_files_are_refused(tmp_path, text, words):
    (tmp_path / 'b.json').write_text(text)
    with pytest.raises(BudgetError, match=words):
        load_point_budget(tmp_path / 'b.json')


# ---------------------------------------------------------------------- audit


@pytest.mark.parametrize('instances', [True, False])
@pytest.mark.parametrize('annotated', [(), (0,), (3, 1, 60), tuple(range(100))])
def test_noise_in_hidden_labels_changes_nothing_that_is_seen(annotated, instances):
    known = truth(SEMANTIC, INSTANCE)
    for seed in range(5):
        noisy = scramble_hidden_points(known, annotated, np.random.default_rng(seed), instances)
        ours, theirs = hide_points(known, annotated, instances), hide_points(noisy, annotated, instances)
        for a, b in zip(ours, theirs, strict=True):
            np.testing.assert_array_equal(a, b, strict=True)


def test_noise_reaches_everything_hidden_and_nothing_annotated():
    known, kept = truth(SEMANTIC, INSTANCE), np.array([2, 55, 80])
    noisy = [scramble_hidden_points(known, kept, np.random.default_rng(seed)) for seed in range(40)]
    for name, before in (('semantic', SEMANTIC), ('instance', INSTANCE)):
        values = np.array([getattr(scene, name) for scene in noisy])
        spread = values.std(axis=0)
        assert (spread[kept] == 0).all() and (np.delete(spread, kept) > 0).all()
        np.testing.assert_array_equal(values[0][kept], before[kept])
    hidden = [scramble_hidden_points(known, kept, np.random.default_rng(s), False).instance for s in range(40)]
    assert (np.std(hidden, axis=0)[kept] > 0).all()
    assert SEMANTIC[0] == 0 and INSTANCE[50] == 4  # the arguments stay as they were


def test_rows_out_of_range_or_twice():
    for rows, words in (((100,), 'expected rows of 100 points'), ((-1,), 'expected rows'), ((1, 1), 'comes twice')):
        with pytest.raises(ValueError, match=words):
            hide_points(truth(SEMANTIC), rows)
    with pytest.raises(ValueError, match='no point labels'):
        hide_points(Truth(Boxes3D.empty()), (0,))
