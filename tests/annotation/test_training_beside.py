"""Training beside a session: the process, what it says, and a difference that is accepted in parts."""

import sys
import time

import numpy as np
import pytest
from reference.corner_scan import FLOOR, WALL, corner, few

from rm3d_plugin.annotation import Session
from rm3d_plugin.annotation.training import Difference, Training, TrainingPlan, accept
from rm3d_plugin.inference.label_files import SUMMARY
from rm3d_plugin.storage import read_json, write_json
from rm3d_plugin.storage.ply import read_ply, write_ply
from rm3d_plugin.structures import SceneError


@pytest.fixture
def session(tmp_path):
    """A session on a corner with three clicks a class; the classes are not in the order of the alphabet."""
    xyz, semantic = corner((4e5, 5e6, 100.0))
    path = write_ply(tmp_path / 'corner.ply', {axis: xyz[:, i] for i, axis in enumerate('xyz')})
    with Session([path], classes=['wall', 'floor']) as opened:
        for point in few(semantic, 3).tolist():
            opened.click('corner', point, ('floor', 'wall')[semantic[point]])
        yield opened


def ended(training, seconds=300):
    until = time.monotonic() + seconds
    while training.running and time.monotonic() < until:
        time.sleep(0.1)
    return training


def test_the_labels_of_a_training_arrive_as_a_difference_that_is_accepted_in_parts(session, tmp_path, monkeypatch):
    command = Training._command

    def short(self):  # as it is asked for, but for the network
        words = command(self)
        assert words[1:4] == ['-m', 'rm3d_plugin', 'label'] and words[-4:] == [
            '--train',
            '20',
            '--cfg-options',
            'seed=1',
        ]
        return words[:-4]

    monkeypatch.setattr(Training, '_command', short)
    training = ended(Training(session, TrainingPlan(tmp_path / 'out', 20.0, ['seed=1'])))
    assert training.told() == 'training is done' and training.progress == 1.0
    assert training.labelled('corner') and not training.labelled('another')
    said = read_ply(tmp_path / 'out' / 'corner.ply')['label']  # numbers by the alphabet: floor 0, wall 1
    for point in few(corner()[1], 3, seed=1).tolist():
        session.click('corner', point, 'wall')  # others are wrong since then
    found = training.difference('corner')
    now, annotated = session.labels('corner').semantic, session.scan('corner').annotated
    expected = np.where((1 - said != now) & (annotated < 0), 1 - said, -1)
    np.testing.assert_array_equal(found.semantic, expected)
    assert not found.heard and found.counts(2).sum() == (expected >= 0).sum() > 0
    floor = found.semantic == session.class_number('floor')
    assert accept(session, 'corner', found, floor) == floor.sum()
    after = session.scan('corner').annotated
    assert (after[floor] == 1).all() and (after[~floor] == annotated[~floor]).all()
    assert session.undo() and (session.scan('corner').annotated == annotated).all()
    summary = read_json(tmp_path / 'out' / SUMMARY)
    summary['scans']['corner']['method'] = 'walker, features and network'
    write_json(tmp_path / 'out' / SUMMARY, summary)
    assert training.difference('corner').heard


def test_a_training_that_fails_or_is_stopped_is_told(session, tmp_path, monkeypatch):
    script = 'print("some step", flush=True); import time; time.sleep(60)'
    monkeypatch.setattr(Training, '_command', lambda self: [sys.executable, '-c', script])
    training = Training(session, TrainingPlan(tmp_path / 'a', 1.0))
    with pytest.raises(SceneError, match='no labels of a training'):
        training.difference('corner')
    training.stop()
    assert not training.running and training.told().startswith('training ended with -15')
    monkeypatch.setattr(Training, '_command', lambda self: [sys.executable, '-c', 'raise SystemExit("no room")'])
    failed = ended(Training(session, TrainingPlan(tmp_path / 'b', 1.0)))
    assert failed.told() == 'training ended with 1: no room' and not failed.labelled('corner')
    with pytest.raises(SceneError, match='ended with 1: no room'):
        failed.difference('corner')


def test_labels_of_one_class_teach_nothing(session, tmp_path):
    while len(set(session.scan('corner').annotated.tolist())) > 2:
        session.undo()
    with pytest.raises(SceneError, match='training needs labels of two classes, got 1'):
        Training(session, TrainingPlan(tmp_path / 'out', 1.0))


def test_accepting_needs_a_change(session):
    nothing = Difference(np.full(1800, -1), True)
    with pytest.raises(SceneError, match='got no point'):
        accept(session, 'corner', nothing, np.ones(1800, dtype=np.bool_))
    some = nothing._replace(semantic=np.where(np.arange(1800) < 3, [FLOOR, WALL, WALL] * 600, -1))
    assert accept(session, 'corner', some, np.ones(1800, dtype=np.bool_)) == 3
    assert session.scan('corner').annotated[:3].tolist() == [FLOOR, WALL, WALL]
    assert session.undo() and (session.scan('corner').annotated >= 0).sum() == 6
