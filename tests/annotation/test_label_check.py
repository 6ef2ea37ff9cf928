"""Labels that the others contradict."""

import numpy as np
import pytest
from reference.corner_scan import FLOOR, WALL, corner, few

from rm3d_plugin.annotation import Session, annotated_scan
from rm3d_plugin.storage.ply import write_ply


@pytest.fixture(scope='module')
def labelled(tmp_path_factory):
    """A session with five labels of each class, a point of the floor that is called wall, and one of a third class."""
    xyz, semantic = corner()
    path = write_ply(tmp_path_factory.mktemp('check') / 'corner.ply', {axis: xyz[:, i] for i, axis in enumerate('xyz')})
    points = few(semantic, 5)
    middle = np.linalg.norm(xyz - [1.5, 0.5, 0.0], axis=1)
    wrong, lamp = (int(np.where(semantic == FLOOR, middle + away, 99).argmin()) for away in (0, -2 * (xyz[:, 0] > 2.5)))
    with Session([path], classes=['floor', 'wall', 'lamp']) as session:
        for point in points.tolist():
            session.click('corner', point, session.classes[semantic[point]])
        session.click('corner', wrong, 'wall')
        session.click('corner', lamp, 'lamp')
        yield session, wrong, lamp


def test_a_wrong_label_is_found_and_said_in_words(labelled):
    session, wrong, _ = labelled
    found = session.contradicted('corner')
    assert found[0].point == wrong and found[0].reason.startswith('labelled wall, the other labels say floor (')
    assert found[0].score > 0.6 and all(each.score <= found[0].score for each in found)


def test_what_the_others_say_without_it_is_what_a_session_without_the_label_says(labelled):
    session, wrong, _ = labelled
    check = session.scan('corner').check(3)
    row = check.points.tolist().index(wrong)
    session.erase('corner', [wrong])
    alone = session.scan('corner').live(3)
    session.undo()
    assert check.said[row] == alone.semantic[wrong] == FLOOR
    assert check.own[row] < 0.4 and check.share[row] + check.own[row] <= 1.0 + 1e-6


def test_the_only_label_of_a_class_is_not_asked(labelled):
    session, wrong, lamp = labelled
    check = session.scan('corner').check(3)
    row = check.points.tolist().index(lamp)
    assert np.isnan(check.own[row]) and check.said[row] == 2
    agreement, region = session.agreement('corner'), session.scan('corner').region
    assert np.isnan(agreement[~np.isin(region, region[check.points])]).all()
    assert agreement[wrong] <= check.own[check.points.tolist().index(wrong)] < 0.4


def test_a_stroke_is_left_out_as_a_whole(labelled):
    session, wrong, _ = labelled
    xyz = session.scan('corner').cloud.xyz
    stroke = np.argsort(np.linalg.norm(xyz - xyz[wrong], axis=1))[:9].tolist()
    session.brush('corner', stroke, 'wall')
    found = [each.point for each in session.contradicted('corner')]
    session.undo()
    assert found[0] in stroke and len(set(found) & set(stroke)) == 1  # one place of the list
    assert session.scan('corner').annotated[wrong] == WALL


def test_labels_of_points_that_are_not_drawn_are_checked_as_they_were_given(tmp_path, monkeypatch):
    monkeypatch.setattr(annotated_scan, 'MOST_POINTS', 600)
    xyz, semantic = corner()
    path = write_ply(tmp_path / 'corner.ply', {axis: xyz[:, i] for i, axis in enumerate('xyz')})
    with Session([path], classes=['floor', 'wall', 'lamp']) as session:
        hidden = np.setdiff1d(np.arange(len(xyz)), session.scan('corner')._drawn)
        for own in (FLOOR, WALL):
            for point in hidden[semantic[hidden] == own][::90][:6].tolist():
                session.click('corner', point, session.classes[own])
        assert session.contradicted('corner') == []
        middle = np.linalg.norm(xyz[hidden] - [1.5, 0.5, 0.0], axis=1)
        wrong = int(hidden[middle.argmin()])
        session.click('corner', wrong, 'wall')
        (found,) = session.contradicted('corner')
        assert found.point == wrong and found.reason.startswith('labelled wall, the other labels say floor')


def test_without_labels_there_is_nothing_to_check(tmp_path):
    xyz, _ = corner()
    path = write_ply(tmp_path / 'corner.ply', {axis: xyz[:, i] for i, axis in enumerate('xyz')})
    with Session([path], classes=['floor', 'wall']) as session:
        assert session.contradicted('corner') == [] and np.isnan(session.agreement('corner')).all()
        session.click('corner', 1, 'wall')
        assert session.contradicted('corner') == []
