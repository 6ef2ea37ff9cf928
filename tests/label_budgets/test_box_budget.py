"""Budgets are drawn once by seed, keep their promises, and cannot be altered unseen."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rm3d_plugin.label_budgets import (
    BoxAmount,
    BudgetError,
    box_amount,
    count_points,
    draw_box_budget,
    load_box_budget,
    save_box_budget,
)


def world(scenes=50, seed=0, classes=(0.7, 0.25, 0.05)):
    rng = np.random.default_rng(seed)
    return {f'{i:06d}': rng.choice(len(classes), size=rng.integers(0, 9), p=classes) for i in range(scenes)}


def chosen(budget, labels):
    return [labels[name][row] for name, rows in budget.annotated.items() for row in rows]


@pytest.mark.parametrize(('name', 'expected'), [('1pct', 10), ('0p5pct', 5)])
def test_named_budgets_count_boxes_by_scenes(name, expected):
    budget = draw_box_budget(world(50), name, seed=0)
    assert budget.annotated_count == expected == sum(budget.annotated_per_class.values())
    assert not budget.complete


def test_three_percent_and_everything():
    labels = world(100)
    total = sum(len(rows) for rows in labels.values())
    assert draw_box_budget(labels, '3pct', seed=0).annotated_count == round(0.03 * total)
    none = {name: np.zeros(len(rows), dtype=int) for name, rows in labels.items()}
    full = draw_box_budget(labels, 'full', seed=0, lidar_points=none)
    assert full.complete
    assert full.annotated == {name: tuple(range(len(rows))) for name, rows in labels.items()}
    assert full.annotated_per_class == full.total_per_class


def test_counts_by_hand():
    labels = {'a': np.array([0, 0, 1]), 'b': np.array([], dtype=int), 'c': np.array([0])}
    budget = draw_box_budget(labels, BoxAmount(per_scene=1), seed=0)
    assert budget.total_per_class == {0: 3, 1: 1}
    assert budget.annotated_per_class == {0: 2, 1: 1}
    assert budget.boxes_per_scene == {'a': 3, 'b': 0, 'c': 1}
    assert budget.annotated['a'][-1] == 2  # the only box of class 1
    assert len(budget.annotated['a']) == 2
    assert budget.annotated['c'] == (0,)  # before a third box of scene a
    assert budget.annotated['b'] == ()


@settings(derandomize=True, max_examples=60, deadline=None)
@given(st.integers(1, 40), st.integers(0, 10_000), st.floats(0.05, 3))
def test_promises(scenes, seed, per_scene):
    labels = world(scenes, seed)
    present = {int(c) for rows in labels.values() for c in rows}
    if not present:
        with pytest.raises(BudgetError, match='no box can be annotated'):
            draw_box_budget(labels, BoxAmount(per_scene=per_scene), seed)
        return
    budget = draw_box_budget(labels, BoxAmount(per_scene=per_scene), seed)
    total = sum(len(rows) for rows in labels.values())
    wanted = max(1, round(per_scene * scenes))
    assert budget.annotated_count == min(wanted, total)
    assert len(set(chosen(budget, labels))) == min(wanted, len(present)) or wanted > len(present)
    if wanted >= len(present):
        assert set(chosen(budget, labels)) == present
    for name, rows in budget.annotated.items():
        assert list(rows) == sorted(set(rows))
        assert all(0 <= row < len(labels[name]) for row in rows)
    counts = {name: len(rows) for name, rows in budget.annotated.items() if len(labels[name])}
    if max(counts.values()) > 1 and wanted > len(present) and min(counts.values()) == 0:
        # a scene has two although another has none: only a class that would else be empty may do so
        doubled = sum(count - 1 for count in counts.values() if count)
        assert doubled < len(present)


def test_the_draw_is_a_function_of_the_seed_not_of_the_order_of_scenes():
    labels = world(80)
    first = draw_box_budget(labels, '1pct', seed=3)
    again = draw_box_budget(dict(reversed(labels.items())), '1pct', seed=3)
    assert (first.annotated, first.hash) == (again.annotated, again.hash)
    others = {draw_box_budget(labels, '1pct', seed=seed).hash for seed in range(20)}
    assert len(others) == 20


def test_every_box_has_its_chance():
    labels = {'a': np.array([0, 0, 0, 0]), 'b': np.array([0]), 'c': np.array([0, 0])}
    hits = {(name, row): 0 for name, rows in labels.items() for row in range(len(rows))}
    for seed in range(600):
        budget = draw_box_budget(labels, BoxAmount(per_scene=1 / 3), seed)
        for name, rows in budget.annotated.items():
            for row in rows:
                hits[name, row] += 1
    assert sum(hits.values()) == 600
    assert all(55 < count < 120 for count in hits.values())  # 600 / 7 = 86


def test_boxes_with_few_points_are_not_drawn():
    labels = world(60)
    rng = np.random.default_rng(1)
    points = {name: rng.integers(0, 12, size=len(rows)) for name, rows in labels.items()}
    budget = draw_box_budget(labels, BoxAmount(fraction=0.9), seed=0, lidar_points=points, min_points=6)
    drawn = [points[name][row] for name, rows in budget.annotated.items() for row in rows]
    assert min(drawn) == 6
    assert len(drawn) == sum(int((p >= 6).sum()) for p in points.values())
    with pytest.raises(BudgetError, match=r'hold 4 boxes, none with 99 points; check classes and range'):
        draw_box_budget({'a': np.zeros(4)}, '1pct', 0, {'a': np.full(4, 98)}, min_points=99)
    with pytest.raises(BudgetError, match='scene a: 4 boxes, but lidar_points has 0 numbers'):
        draw_box_budget({'a': np.zeros(4)}, '1pct', 0, {})


def test_points_in_boxes_are_counted():
    boxes = np.array([[0.0, 0, 0, 2, 2, 2, 0], [10, 0, 0, 2, 2, 2, 0], [0, 0, 0, 4, 4, 4, 0]])
    xyz = np.array([[0.0, 0, 0], [0.5, 0, 0], [1.5, 0, 0], [30, 0, 0]])
    assert count_points(xyz, boxes).tolist() == [2, 0, 1]
    assert count_points(xyz, np.zeros((0, 7))).tolist() == []
    assert count_points(np.zeros((0, 3)), boxes).tolist() == [0, 0, 0]


def test_no_scene_at_all():
    with pytest.raises(BudgetError, match='0 scenes hold 0 boxes'):
        draw_box_budget({}, '1pct', 0)


@pytest.mark.parametrize(
    'amount', [{}, {'per_scene': 1, 'fraction': 1}, {'per_scene': 0}, {'fraction': 1.5}, {'fraction': 0}]
)
def test_wrong_amounts(amount):
    with pytest.raises(ValueError, match='BoxAmount'):
        BoxAmount(**amount)


def test_unknown_names_list_the_known_ones():
    choices = 'expected one of 1pct, 0p5pct, 3pct, full, onebox, 2pct, scenes10pct .*_alike, got'
    for name in ('1%', 'scenes0pct', 'scenes101pct', 'onebox_1pct'):
        with pytest.raises(BudgetError, match=f"{choices} '{name}'"):
            draw_box_budget(world(), name, 0)


@pytest.mark.parametrize(
    ('name', 'amount'),
    [
        ('1pct_alike', BoxAmount(per_scene=0.2, alike=True)),
        ('3pct_alike', BoxAmount(fraction=0.03, alike=True)),
        ('onebox', BoxAmount(each=1)),
        ('2pct', BoxAmount(each=1, scenes=0.1)),
        ('onebox_scenes10pct', BoxAmount(each=1, scenes=0.1)),
        ('scenes2p5pct', BoxAmount(fraction=1, scenes=0.025)),
    ],
)
def test_names_of_published_amounts(name, amount):
    assert box_amount(name) == amount
    assert BoxAmount(**amount.to_plain()) == amount


@pytest.mark.parametrize('name', ['onebox', 'onebox_alike'])
def test_one_object_in_each_scene_that_has_any(name):
    labels = world(60, seed=4)
    budget = draw_box_budget(labels, name, seed=2)
    assert {scene: len(rows) for scene, rows in budget.annotated.items()} == {
        scene: min(len(rows), 1) for scene, rows in labels.items()
    }
    assert set(budget.annotated_per_class) == {0, 1, 2}
    if name == 'onebox_alike':  # the rare class has all scenes that it can have
        holding = sum(2 in rows for rows in labels.values())
        plain = draw_box_budget(labels, 'onebox', seed=2)
        assert plain.annotated_per_class[2] < budget.annotated_per_class[2] <= holding


def test_one_object_in_a_tenth_of_the_scenes():
    labels = {f'{i:03d}': np.zeros(i % 4, dtype=int) for i in range(100)}  # 75 scenes with a box
    budget = draw_box_budget(labels, '2pct', seed=0)
    assert sorted(len(rows) for rows in budget.annotated.values())[-9:] == [0] + [1] * 8
    assert not budget.complete and budget.complete_scenes == ()
    assert draw_box_budget(labels, '2pct', seed=1).annotated != budget.annotated


def test_some_scenes_are_labelled_completely_and_the_others_not_at_all(tmp_path):
    labels = world(40, seed=1)
    budget = draw_box_budget(labels, 'scenes10pct', seed=0)
    assert len(budget.complete_scenes) == 4 and not budget.complete
    for scene, rows in labels.items():
        whole = scene in budget.complete_scenes
        assert budget.annotated[scene] == (tuple(range(len(rows))) if whole else ())
        assert budget.is_complete(scene) == whole
    save_box_budget(tmp_path / 'budget.json', budget)
    assert load_box_budget(tmp_path / 'budget.json') == budget


def test_scenes_that_nobody_labelled_are_left_out():
    labels = {'a': np.array([0]), 'b': np.array([], dtype=int), 'c': np.array([0, 1])}
    budget = draw_box_budget(labels, 'full', seed=0, unlabelled=['b'])
    assert budget.complete_scenes == ('a', 'c') and not budget.complete
    assert draw_box_budget(labels, BoxAmount(per_scene=1), 0, unlabelled=['c']).annotated == {
        'a': (0,),
        'b': (),
        'c': (),
    }


def test_budgets_drawn_before_there_were_such_amounts_keep_their_hash():
    assert draw_box_budget(world(30), '1pct', seed=5).to_plain()['amount'] == {'per_scene': 0.2, 'fraction': None}
    assert 'complete_scenes' not in draw_box_budget(world(30), 'full', seed=5).to_plain()


def test_rows_are_checked_against_the_scene():
    budget = draw_box_budget({'a': np.array([0, 0])}, 'full', 0)
    assert budget.rows('a', 2) == (0, 1)
    with pytest.raises(BudgetError, match='scene b: not in this label budget of 1 scenes'):
        budget.rows('b', 2)
    with pytest.raises(BudgetError, match='scene a: the label budget was drawn from 2 boxes, the scene has 3'):
        budget.rows('a', 3)


def test_summary_names_what_is_annotated():
    budget = draw_box_budget({'a': np.array([0, 0, 2]), 'b': np.array([0])}, BoxAmount(per_scene=1), seed=7)
    text = budget.summary(('Car', 'Pedestrian', 'Cyclist'))
    assert text.splitlines()[0].endswith('seed 7: 2 of 4 boxes (50.00 %) in 2 of 2 scenes')
    assert [line.split() for line in text.splitlines()[1:]] == [['Car', '1', 'of', '3'], ['Cyclist', '1', 'of', '1']]
    assert 'class 2' in budget.summary()


# ---------------------------------------------------------------------- on disk


def test_a_saved_budget_comes_back_equal(tmp_path):
    budget = draw_box_budget(world(30), '3pct', seed=11)
    save_box_budget(tmp_path / 'b.json', budget)
    assert load_box_budget(tmp_path / 'b.json') == budget


def test_an_altered_budget_is_refused(tmp_path):
    path = tmp_path / 'b.json'
    save_box_budget(path, draw_box_budget(world(30), '1pct', seed=1))
    content = json.loads(path.read_text())
    name = next(name for name, rows in content['annotated'].items() if not rows and content['boxes_per_scene'][name])
    for change in ({'seed': 2}, {'complete': True}, {'annotated': {**content['annotated'], name: [0]}}):
        path.write_text(json.dumps(content | change))
        with pytest.raises(BudgetError, match=r'b\.json: was altered after it was drawn'):
            load_box_budget(path)


@pytest.mark.parametrize('text', ['[]', '{"format": 1}', '{}', '3', '{"format": 9}'])
def test_other_files_are_refused(tmp_path, text):
    (tmp_path / 'b.json').write_text(text)
    with pytest.raises(BudgetError, match=r'b\.json: (not a label budget|format 9, expected 1)'):
        load_box_budget(tmp_path / 'b.json')


def test_a_missing_file_says_how_to_draw_one(tmp_path):
    with pytest.raises(BudgetError, match=r'none\.json: no such label budget; a training run draws one'):
        load_box_budget(tmp_path / 'none.json')


def test_classes_alike_take_turns_from_fresh_scenes():
    labels = {f'{i:02d}': np.array([0] * 5 + [1] * (i % 4 == 0) + [2] * (i == 7)) for i in range(20)}
    budget = draw_box_budget(labels, BoxAmount(per_scene=0.5, alike=True), seed=3)
    assert budget.annotated_per_class == {0: 4, 1: 5, 2: 1}  # one box of class 2; the others in turn, the rarer first
    assert max(len(rows) for rows in budget.annotated.values()) <= 2  # class 1 has no more scenes than it needs
    assert budget.hash != draw_box_budget(labels, BoxAmount(per_scene=0.5), seed=3).hash


def test_more_than_there_is_ends_the_turns():
    labels = {'a': np.array([0, 0, 1])}
    assert draw_box_budget(labels, BoxAmount(per_scene=9, alike=True), seed=0).annotated == {'a': (0, 1, 2)}


def test_a_budget_of_classes_alike_comes_back_equal(tmp_path):
    labels = {name: np.array([0, 1, 1]) for name in 'abcd'}
    budget = draw_box_budget(labels, BoxAmount(per_scene=0.5, alike=True), seed=0)
    save_box_budget(tmp_path / 'budget.json', budget)
    assert load_box_budget(tmp_path / 'budget.json') == budget
