"""A session without any web: every action is answered from the disk's point of view, and labels follow."""

import json

import numpy as np
import pytest
from reference.corner_scan import FLOOR, WALL, corner, few

from rm3d_plugin.annotation import Click, ClickFileError, ClickLog, Session, read_clicks
from rm3d_plugin.label_budgets.base import BudgetError
from rm3d_plugin.label_budgets.clicks import resolve_clicks
from rm3d_plugin.storage.locks import FolderInUseError
from rm3d_plugin.storage.ply import read_ply, write_ply
from rm3d_plugin.structures import SceneError

ORIGIN = (4e5, 5e6, 100.0)


@pytest.fixture
def scan(tmp_path):
    """A PLY file in world coordinates, and the classes of its points: floor 0, wall 1."""
    xyz, semantic = corner(ORIGIN)
    return write_ply(tmp_path / 'corner.ply', {axis: xyz[:, i] for i, axis in enumerate('xyz')}), semantic


def started(scan, **arguments):
    return Session([scan], classes=['floor', 'wall'], **arguments)


def annotated_points(session):
    annotated = session.scan('corner').annotated
    return {int(point): int(annotated[point]) for point in np.flatnonzero(annotated >= 0)}


def test_two_clicks_name_every_point(scan):
    path, semantic = scan
    with started(path) as session:
        assert (session.labels('corner').semantic == -1).all()  # nothing is said before the first click
        for number, name in enumerate(session.classes):
            session.click('corner', int(few(semantic, 1)[number]), name)
        live, settled = session.labels('corner'), session.settled('corner')
        assert (live.semantic == semantic).mean() > 0.9 and (settled.semantic == semantic).mean() > 0.9
        assert (live.semantic == settled.semantic).mean() > 0.95
        np.testing.assert_array_equal(live.region, settled.region)
        assert live.confidence[few(semantic, 1)].tolist() == [1.0, 1.0]


def test_a_later_click_on_a_point_counts_and_undo_and_redo_follow(scan):
    with started(scan[0]) as session:
        session.click('corner', 5, 'floor')
        session.brush('corner', [5, 6, 7], 'wall')
        assert annotated_points(session) == {5: WALL, 6: WALL, 7: WALL}
        session.erase('corner', [6, 9])
        assert annotated_points(session) == {5: WALL, 7: WALL}
        assert session.undo() and annotated_points(session) == {5: WALL, 6: WALL, 7: WALL}
        assert session.undo() and annotated_points(session) == {5: FLOOR}
        assert session.redo() and session.redo() and annotated_points(session) == {5: WALL, 7: WALL}
        assert not session.redo()
        assert [session.undo() for _ in range(4)] == [True, True, True, False] and annotated_points(session) == {}
        session.click('corner', 1, 'wall')
        assert not session.redo()  # what was taken back before another action is gone


def test_every_answered_action_is_on_the_disk(scan):
    path, log = scan[0], scan[0].with_name('corner.clicks.jsonl')
    generator, names = np.random.default_rng(0), ['floor', 'wall']
    with started(path) as session:
        for step in range(60):
            match int(generator.integers(5)):
                case 0:
                    session.undo()
                case 1:
                    session.redo()
                case 2:
                    session.brush('corner', generator.integers(40, size=5).tolist(), names[step % 2])
                case 3:
                    session.erase('corner', generator.integers(40, size=3).tolist())
                case _:
                    session.click('corner', int(generator.integers(40)), names[step % 2])
            told = {click.index: click.semantic for click in ClickLog(log).clicks}  # as after kill -9
            assert told == annotated_points(session)
        expected = annotated_points(session)
    with Session([path]) as again:
        assert again.classes == ('floor', 'wall') and annotated_points(again) == expected
        assert {click.index: click.semantic for click in read_clicks(log, names)} == expected


def test_a_region_is_labelled_as_a_whole(scan):
    with started(scan[0]) as session:
        session.region('corner', 100, 'wall')
        region = session.scan('corner').region
        assert set(annotated_points(session)) == set(np.flatnonzero(region == region[100]).tolist())


def test_saved_files_hold_the_settled_labels_and_every_field(scan, tmp_path):
    path, semantic = scan
    with started(path) as session:
        for point in few(semantic, 3):
            session.click('corner', int(point), session.classes[semantic[point]])
        (written,) = session.save(tmp_path / 'out')
        columns, found = read_ply(written), session.settled('corner', check=False)
    np.testing.assert_array_equal(columns['label'], found.semantic)
    np.testing.assert_array_equal(columns['region'], found.region)
    np.testing.assert_allclose(columns['x'], read_ply(path)['x'])
    assert (columns['label'] == semantic).mean() > 0.95


def test_clicks_go_out_with_their_place_and_come_back(scan, tmp_path):
    path = scan[0]
    with started(path) as session:
        session.click('corner', 5, 'floor', instance=4)
        session.brush('corner', [7, 8], 'wall')
        exported = session.export_clicks(tmp_path / 'clicks.csv')
        xyz = session.scan('corner').cloud.xyz.astype(np.float64) + session.scan('corner').cloud.origin
    placed = read_clicks(exported, ['floor', 'wall'])
    np.testing.assert_allclose([click.xyz for click in placed], xyz[[5, 7, 8]], atol=1e-4)
    with started(path, log=tmp_path / 'other.jsonl') as session:
        assert session.import_clicks(exported) == 3
        assert annotated_points(session) == {5: FLOOR, 7: WALL, 8: WALL}
        assert session.undo() and annotated_points(session) == {}


def test_suggestions_are_new_places_with_a_reason_and_find_the_class_that_is_missing(scan):
    path, semantic = scan
    with started(path) as session:
        (first,) = session.suggest('corner')
        assert first.reason == 'much of the scan looks like this'
        session.click('corner', first.point, session.classes[semantic[first.point]])
        more = session.suggest('corner', 6)
        assert len({each.point for each in [first, *more]}) == 7
        assert semantic[more[0].point] != semantic[first.point] and 'new class' in more[0].reason
        points = [each.point for each in more]
        assert not {each.point for each in session.suggest('corner', 3)} & set(points)


def test_what_cannot_be_is_told_and_changes_nothing(scan, tmp_path):
    path = scan[0]
    with started(path) as session:
        before = session.log.path.read_text()
        for action, error, words in [
            (
                lambda: session.click('corner', 10**6, 'floor'),
                SceneError,
                r'expected points 0\.\.1799, got point 1000000',
            ),
            (
                lambda: session.click('corner', 1, 'roof'),
                ClickFileError,
                "no class 'roof' in this session; it has floor, wall",
            ),
            (lambda: session.click('attic', 1, 'floor'), SceneError, "no scan 'attic' in this session; it has corner"),
            (lambda: session.brush('corner', [], 'floor'), SceneError, 'got no point'),
            (lambda: session.save(tmp_path / 'out'), SceneError, 'no point is labelled yet'),
        ]:
            with pytest.raises(error, match=words):
                action()
        assert session.log.path.read_text() == before and not (tmp_path / 'out').exists()


def test_places_and_numbers_in_one_log_are_clicks_on_one_point(scan, tmp_path):
    log = ClickLog(tmp_path / 's.jsonl')
    log.add_class('floor'), log.add_class('wall')
    with started(scan[0], log=tmp_path / 'other.jsonl') as session:
        cloud = session.scan('corner').cloud
    places = cloud.xyz.astype(np.float64) + cloud.origin
    for point in (5, 6, 7, 8):
        log.add(Click('corner', FLOOR, xyz=tuple(places[point])))
    assert len(log.clicks) == 4
    log.add(Click('corner', WALL, index=5))
    log.add(Click('corner', WALL, xyz=tuple(places[8])))
    with started(scan[0], log=log.path) as session:
        session.erase('corner', [6])
        assert annotated_points(session) == {5: WALL, 7: FLOOR, 8: WALL}
        exported = session.export_clicks(tmp_path / 'clicks.csv')
    budget = resolve_clicks(read_clicks(log.path, ['floor', 'wall']), cloud)
    assert dict(zip(budget.points.tolist(), budget.semantic.tolist(), strict=True)) == {5: WALL, 7: FLOOR, 8: WALL}
    told = {click.index: click.semantic for click in read_clicks(exported, ['floor', 'wall'])}
    assert told == {5: WALL, 7: FLOOR, 8: WALL}


def test_a_log_of_another_scan_of_that_name_is_refused_each_time(scan, tmp_path):
    log = ClickLog(tmp_path / 's.jsonl')
    log.add_class('floor')
    log.add(Click('corner', FLOOR, index=10**6))
    with started(scan[0], log=log.path) as session:
        for _ in range(2):
            with pytest.raises(BudgetError, match=r'has the points 0\.\.1799, got index 1000000'):
                session.scan('corner')


def test_an_action_on_a_full_disk_can_be_done_again(scan, tmp_path, monkeypatch):
    exported = tmp_path / 'clicks.csv'
    exported.write_text('scene,index,class\ncorner,1,floor\ncorner,2,wall\n')
    with started(scan[0]) as session:
        session.click('corner', 5, 'floor')
        session.click('corner', 6, 'floor')
        assert session.undo()

        def fails(action):
            with monkeypatch.context() as patched, pytest.raises(ClickFileError, match='the disk is full'):
                patched.setattr('rm3d_plugin.annotation.click_log.os.write', lambda handle, line: len(line) // 2)
                action()

        for action in (session.undo, session.redo, lambda: session.import_clicks(exported)):
            fails(action)
        assert annotated_points(session) == {5: FLOOR}
        assert session.redo() and session.undo() and session.undo() and annotated_points(session) == {}
        assert session.import_clicks(exported) == 2
        fails(session.undo)
        assert annotated_points(session) == {1: FLOOR, 2: WALL} and session.undo() and annotated_points(session) == {}
        assert {click.index for click in ClickLog(session.log.path).clicks} == set()


def test_points_may_be_of_numpy_and_a_stroke_of_all_points_is_quick(scan):
    with started(scan[0]) as session:
        session.click('corner', np.int64(3), 'floor')
        session.brush('corner', np.arange(1800), 'wall')
        assert session.suggest('corner') == []  # no region is left
        session.erase('corner', np.arange(900))
        assert len(annotated_points(session)) == 900 and session.suggest('corner')


def test_two_sessions_on_one_log_are_told(scan, monkeypatch):
    path = scan[0]
    with started(path):
        monkeypatch.setattr('rm3d_plugin.storage.locks.os.getpid', lambda: 1)  # another process that lives
        with pytest.raises(FolderInUseError, match='works there'):
            started(path)
    started(path).close()  # free again


def test_a_log_of_another_scan_is_refused(scan, tmp_path):
    path = scan[0]
    with started(path, log=tmp_path / 'a.jsonl') as session:
        session.click('corner', 1, 'floor')
    other = path.rename(tmp_path / 'moved.ply')
    with pytest.raises(ClickFileError, match=r"holds clicks of scan 'corner', which is none of the scans: moved"):
        Session([other], log=tmp_path / 'a.jsonl')
    assert not (tmp_path / 'a.jsonl.lock').exists()


def test_classes_have_colours_that_stay(scan):
    with started(scan[0]) as session:
        session.add_class('roof', '#123456')
        session.click('corner', 3, 'roof')
        session.rename_class('roof', 'gable')
        assert session.color('gable') == '#123456' and session.color('floor').startswith('#')
    with Session([scan[0]]) as again:
        assert again.classes == ('floor', 'wall', 'gable') and again.color('gable') == '#123456'
        assert annotated_points(again) == {3: 2}
    rows = [json.loads(line) for line in again.log.path.read_text().splitlines()]
    assert rows[-1] == {'rename': 'roof', 'to': 'gable'}


def test_points_without_a_place_stay_without_a_label(scan, tmp_path):
    columns = dict(read_ply(scan[0]))
    columns['x'] = columns['x'].copy()
    columns['x'][:7] = np.nan
    path = write_ply(tmp_path / 'holes.ply', columns)
    with started(path) as session, pytest.raises(SceneError, match='7 of 1800 points are NaN'):
        session.scan('holes')
    with pytest.warns(UserWarning, match='they are dropped'), started(path, drop_nan=True) as session:
        session.click('holes', 10, 'floor')
        session.click('holes', 1700, 'wall')
        assert len(session.labels('holes').semantic) == 1793
        (written,) = session.save(tmp_path / 'out')
    labels = read_ply(written)
    assert labels['label'][:7].tolist() == labels['region'][:7].tolist() == [-1] * 7
    assert labels['label'][[17, 1707]].tolist() == [0, 1] and (labels['label'][7:] >= 0).all()


def test_an_import_is_one_undo_after_a_restart_too(scan, tmp_path):
    exported = tmp_path / 'clicks.csv'
    exported.write_text('scene,index,class\ncorner,1,floor\ncorner,2,wall\n')
    with started(scan[0]) as session:
        session.click('corner', 5, 'floor')
        session.import_clicks(exported)
    with started(scan[0]) as again:
        assert again.undo() and annotated_points(again) == {5: FLOOR}


def test_a_class_that_was_renamed_is_there_when_the_same_command_starts_again(scan):
    with started(scan[0]) as session:
        session.click('corner', 5, 'floor')
        session.rename_class('floor', 'ground')
    with started(scan[0]) as again:
        assert again.classes == ('ground', 'wall') and annotated_points(again) == {5: FLOOR}
        assert again.add_class('floor') == 2  # who wants it, may have it


def test_a_name_that_is_none_leaves_no_file_behind(scan):
    with pytest.raises(ClickFileError, match='a class needs a name'):
        Session([scan[0]], classes=['floor', ' '])
    assert not scan[0].with_name('corner.clicks.jsonl').exists()
