"""The log of a session: it only grows, survives a crash, and is a label budget as it is."""

import json

import numpy as np
import pytest
from reference.toy_scenes import ToyRooms

from rm3d_plugin.annotation import Click, ClickFileError, ClickLog, InstanceBox, read_clicks, write_clicks
from rm3d_plugin.annotation.click_log import Action
from rm3d_plugin.label_budgets import clicks_of
from rm3d_plugin.labeling import PointBudgetSource

CLASSES = ('floor', 'box', 'wall')


def click(index, semantic=0):
    return Click('s', semantic, index=index)


def test_clicks_and_undos_are_lines(tmp_path):
    log = ClickLog(tmp_path / 'new' / 'session.jsonl', CLASSES)
    assert log.clicks == [] and log.path.read_text() == '{"kind": "clicks", "format": 1}\n'
    assert [log.add(click(7, 2)), log.add(Click('s', 1, 4, xyz=(1.00004, 2, 3))), log.add(click(9))] == [1, 2, 3]
    assert log.undo(1) == [click(7, 2)] and log.undo() == [click(9)]
    assert log.add(click(5)) == 4  # a number is given once
    assert [json.loads(line) for line in log.path.read_text().splitlines()[1:]] == [
        {'click': 1, 'scene': 's', 'index': 7, 'class': 'wall'},
        {'click': 2, 'scene': 's', 'x': 1.0, 'y': 2.0, 'z': 3.0, 'class': 'box', 'instance': 4},
        {'click': 3, 'scene': 's', 'index': 9, 'class': 'floor'},
        {'undo': 1},
        {'undo': 3},
        {'click': 4, 'scene': 's', 'index': 5, 'class': 'floor'},
    ]
    assert [c.index for c in log.clicks] == [c.index for c in read_clicks(log.path, CLASSES)] == [None, 5]


def test_a_session_is_taken_up(tmp_path):
    path = tmp_path / 's.jsonl'
    log = ClickLog(path, CLASSES)
    log.add(click(1))
    log.add(click(2))
    log.undo()
    again = ClickLog(path, CLASSES)
    assert again.clicks == [click(1)]
    assert again.add(click(3)) == 3 and again.undo(1) == [click(1)]
    assert ClickLog(path, CLASSES).clicks == [click(3)]


@pytest.mark.parametrize('cut', range(1, 60, 7))
def test_a_crash_while_writing_loses_that_line_alone(tmp_path, cut):
    path = tmp_path / 's.jsonl'
    log = ClickLog(path, CLASSES)
    log.add(click(1))
    log.add(click(2))
    path.write_bytes(path.read_bytes()[:-cut])
    left = len(read_clicks(path, CLASSES)) if cut < 55 else 1
    again = ClickLog(path, CLASSES)
    assert again.clicks == [click(1), click(2)][:left] and left == (2 if cut == 1 else 1)
    again.add(click(3))
    assert ClickLog(path, CLASSES).clicks == [*[click(1), click(2)][:left], click(3)]


def test_what_is_not_there_cannot_be_taken_back(tmp_path):
    log = ClickLog(tmp_path / 's.jsonl', CLASSES)
    with pytest.raises(ClickFileError, match='undo: no click 0 stands; 0 do'):
        log.undo()
    log.add(click(1))
    log.undo(1)
    before = log.path.read_bytes()
    with pytest.raises(ClickFileError, match=r's\.jsonl: undo: no click 1 stands; 0 do'):
        log.undo(1)
    with pytest.raises(ClickFileError, match=r'class: expected a number 0\.\.2, got 3'):
        log.add(click(1, 3))
    assert log.path.read_bytes() == before


def test_files_that_are_no_log_are_left_alone(tmp_path):
    with pytest.raises(ClickFileError, match=r'a log of clicks is named \*\.jsonl'):
        ClickLog(tmp_path / 's.csv', CLASSES)
    (tmp_path / 's.jsonl').write_text('{"a": 1}\n')
    with pytest.raises(ClickFileError, match='line 1: expected'):
        ClickLog(tmp_path / 's.jsonl', CLASSES)
    assert (tmp_path / 's.jsonl').read_text() == '{"a": 1}\n'


@pytest.mark.parametrize('name', ['clicks.csv', 'clicks.json', 'clicks.jsonl'])
def test_a_drawn_budget_comes_back_from_clicks(tmp_path, name):
    drawn = PointBudgetSource(ToyRooms(2), '20pts', seed=4)
    clicks = []
    for index, scene in enumerate(drawn.scene_ids):
        cloud = drawn.load_cloud(index)
        clicks += clicks_of(scene, drawn.annotated(index, len(cloud)), cloud, drawn.rows_of(scene))
    write_clicks(tmp_path / name, clicks, CLASSES)
    again = PointBudgetSource(ToyRooms(2, truth=False), {'clicks': str(tmp_path / name)})
    assert list(again.budget.annotated) == list(drawn.budget.annotated)
    for scene, points in drawn.budget.annotated.items():
        for ours, theirs in zip(points, again.budget.annotated[scene], strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_a_session_is_a_budget(tmp_path):
    log = ClickLog(tmp_path / 'session.jsonl', CLASSES)
    for index, semantic in ((12, 1), (3, 0), (40, 2)):
        log.add(Click('room0', semantic, index=index))
    log.undo(1)
    budget = PointBudgetSource(ToyRooms(1, truth=False), f'clicks={log.path}').budget
    assert budget.annotated['room0'].points.tolist() == [3, 40]
    assert budget.annotated['room0'].semantic.tolist() == [0, 2]


def test_many_points_at_once_are_one_line_and_one_undo(tmp_path):
    path = tmp_path / 's.jsonl'
    log = ClickLog(path, CLASSES)
    assert log.add(click(4, 1), click(5, 1), click(6, 1)) == 1 and log.add(click(9, 2)) == 2
    assert json.loads(path.read_text().splitlines()[1]) == {
        'click': 1, 'scene': 's', 'points': [4, 5, 6], 'class': 'box'
    }  # fmt: skip
    assert [(c.index, c.semantic) for c in read_clicks(path, CLASSES)] == [(4, 1), (5, 1), (6, 1), (9, 2)]
    assert [c.index for c in ClickLog(path, CLASSES).undo(1)] == [4, 5, 6]
    assert [c.index for c in read_clicks(path, CLASSES)] == [9]
    with pytest.raises(ClickFileError, match='one scene, class and instance'):
        log.add(click(1, 0), click(2, 1))


def test_classes_are_named_coloured_and_renamed_in_the_log(tmp_path):
    path = tmp_path / 's.jsonl'
    log = ClickLog(path)
    assert [log.add_class('tree', '#2e8b57'), log.add_class('road'), log.add_class('tree', '#00ff00')] == [0, 1, 0]
    log.add(click(3, 0))
    log.rename_class('tree', 'oak')
    log.add(click(4, 0))
    again = ClickLog(path)
    assert again.classes == log.classes == ('oak', 'road') and again.colors == log.colors == {'oak': '#00ff00'}
    assert [(c.index, c.semantic) for c in again.clicks] == [(3, 0), (4, 0)]
    assert [c.semantic for c in read_clicks(path, ['road', 'oak'])] == [1, 1]  # names count, not numbers
    for old, new in (('pine', 'fir'), ('oak', 'road')):
        with pytest.raises(ClickFileError, match='expected a class added here and a free name'):
            log.rename_class(old, new)
    before = path.read_bytes()
    for name in ('  ', 'a\nb', 'a\0', '\ud800', 'a\u2028b'):
        for action in (log.add_class, lambda name: log.rename_class('oak', name)):
            with pytest.raises(ClickFileError, match='needs a name: expected one line of text'):
                action(name)
    with pytest.raises(ClickFileError, match=r"'oak': color: expected #rrggbb, got 'red'"):
        log.add_class('oak', 'red')
    assert path.read_bytes() == before


@pytest.mark.parametrize('name', ['<b>x</b>', 'a,b', '"q"', "a'b", 'ünï☃', ' lead', 'trail ', '5', '-1', 'null'])
def test_odd_names_come_back(tmp_path, name):
    log = ClickLog(tmp_path / 's.jsonl')
    assert [log.add_class('other'), log.add_class(name), log.add_class(name)] == [0, 1, 1]
    log.add(Click(' scene of blanks', 1, index=3))
    again = ClickLog(log.path)
    assert again.classes == ('other', name.strip()) and again.clicks == log.clicks
    for ending in ('csv', 'json', 'jsonl'):
        write_clicks(tmp_path / f'out.{ending}', [click(3, 1)], log.classes)
        assert read_clicks(tmp_path / f'out.{ending}', log.classes) == [click(3, 1)]


def test_what_another_program_wrote_meanwhile_is_not_mixed_in(tmp_path):
    one = ClickLog(tmp_path / 's.jsonl', CLASSES)
    one.add(click(1))
    ClickLog(one.path, CLASSES).add(click(2))
    before = one.path.read_bytes()
    with pytest.raises(ClickFileError, match='another program changed this file'):
        one.add(click(3))
    assert one.path.read_bytes() == before and ClickLog(one.path, CLASSES).clicks == [click(1), click(2)]


def test_a_line_that_did_not_reach_the_disk_is_not_in_the_file(tmp_path, monkeypatch):
    log = ClickLog(tmp_path / 's.jsonl', CLASSES)
    log.add(click(1))

    def broken(handle):
        raise OSError(5, 'Input/output error')

    with monkeypatch.context() as patched, pytest.raises(OSError, match='Input/output'):
        patched.setattr('rm3d_plugin.annotation.click_log.os.fsync', broken)
        log.add(click(2))
    log.add(click(3))
    assert ClickLog(log.path, CLASSES).clicks == log.clicks == [click(1), click(3)]


@pytest.mark.parametrize('points', ['[]', '[1.5]', '["a"]', '[true]', '{}', '7'])
def test_points_that_are_no_numbers_are_told(tmp_path, points):
    path = ClickLog(tmp_path / 's.jsonl', CLASSES).path
    path.write_text(path.read_text() + f'{{"click": 1, "scene": "s", "points": {points}, "class": "box"}}\n')
    with pytest.raises(ClickFileError, match='line 2: points: expected a list of numbers of points'):
        ClickLog(path, CLASSES)


def test_lines_of_one_action_are_taken_back_as_one_after_a_restart(tmp_path):
    log = ClickLog(tmp_path / 's.jsonl', CLASSES)
    log.add(click(1))
    box = InstanceBox.at('s', 3, 2, np.array([4e5 + 1 / 3, 2, 1, 4, 2, 1.5, 0.1234567]))
    assert log.act(Action([[click(2, 1)], [click(3, 2), click(4, 2)]], [box])) == [2, 3, 4]
    rows = [json.loads(line) for line in log.path.read_text().splitlines()[2:]]
    assert [row.get('with') for row in rows] == [None, 2, 2]
    assert rows[2] == {
        'box': 4, 'scene': 's', 'instance': 3, 'class': 'wall', 'center': [400000.3333, 2.0, 1.0],
        'size': [4.0, 2.0, 1.5], 'yaw': 0.123457, 'with': 2,
    }  # fmt: skip
    again = ClickLog(log.path, CLASSES)
    assert again.standing == log.standing == [[1], [2, 3, 4]] and again.boxes('s') == {3: box}
    taken = again.take_back(again.standing[-1])
    assert taken == Action([[click(2, 1)], [click(3, 2), click(4, 2)]], [box])
    assert again.standing == ClickLog(log.path, CLASSES).standing == [[1]] and again.boxes('s') == {}
    assert again.act(Action(boxes=[box])) == [5]
    assert [c.index for c in read_clicks(log.path, CLASSES)] == [1]


@pytest.mark.parametrize(
    ('row', 'words'),
    [
        ('"instance": "a", "class": null', 'expected scene and instance of a box'),
        ('"instance": 1, "class": "box", "center": [1, 2], "size": [1, 1, 1], "yaw": 0', 'center and size of three'),
        ('"instance": 1, "class": "x", "center": [1, 2, 3], "size": [1, 1, 1], "yaw": 0', 'class: expected one of'),
        ('"instance": 1, "class": "box", "center": [1, 2, 3], "size": [1, 0, 1], "yaw": 0', 'lengths above 0 m'),
        ('"instance": 1, "class": null, "with": "a"', 'with: expected the number of a click or box'),
    ],
)
def test_boxes_that_are_none_are_told(tmp_path, row, words):
    path = ClickLog(tmp_path / 's.jsonl', CLASSES).path
    path.write_text(path.read_text() + f'{{"box": 1, "scene": "s", {row}}}\n')
    with pytest.raises(ClickFileError, match=words):
        ClickLog(path, CLASSES)
