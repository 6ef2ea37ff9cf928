"""kill -9 in the middle of random actions: what was answered is in the log.

``make faults`` kills as many sessions as RM3D_FAULTS says.
"""

import multiprocessing
import os

import numpy as np
import pytest
from reference.corner_scan import corner

from rm3d_plugin.annotation import ClickLog, Session
from rm3d_plugin.storage.ply import write_ply

KILLS = int(os.environ.get('RM3D_FAULTS', '2'))
ACTIONS = 200  # at most, before the kill

pytestmark = pytest.mark.skipif(os.name != 'posix', reason='kills by a signal')


@pytest.fixture(scope='module')
def scan(tmp_path_factory):
    """A corner; every session goes on with the log of the one before."""
    xyz, _ = corner()
    columns = {axis: xyz[:, i] for i, axis in enumerate('xyz')}
    return write_ply(tmp_path_factory.mktemp('killed') / 'corner.ply', columns)


def act(scan, seed, pipe):
    """Act until killed, and say after each action what stands: labels by point and boxes by object."""
    generator, name = np.random.default_rng(seed), scan.stem
    with Session([scan], classes=['floor', 'wall']) as session:
        while True:
            points = generator.integers(40, size=5).tolist()
            row = generator.uniform(1, 2, 7).round(4)
            actions = (
                session.undo,
                session.redo,
                lambda points=points: session.brush(name, points, 'wall'),
                lambda points=points: session.erase(name, points[:3]),
                lambda points=points: session.click(name, points[0], 'floor'),
                lambda points=points, row=row: session.objects.set_box(name, points[0] % 3, row, 'wall'),
            )
            actions[int(generator.integers(len(actions)))]()
            annotated = session.scan(name).annotated
            labels = {point: int(annotated[point]) for point in np.flatnonzero(annotated >= 0).tolist()}
            pipe.send((labels, session.objects.boxes(name)))


@pytest.mark.parametrize('seed', range(KILLS))
def test_a_killed_session_keeps_every_answered_action(scan, seed):
    context, log = multiprocessing.get_context('fork'), scan.with_name('corner.clicks.jsonl')
    count = int(np.random.default_rng(seed).integers(1, ACTIONS))
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=act, args=(scan, seed, theirs))
    process.start()
    theirs.close()
    told = [ours.recv() for _ in range(count)]
    process.kill()
    process.join()
    told += until_the_end(ours)
    assert process.exitcode == -9 and len(told) >= count
    found, whole = [standing(log)], log.read_bytes()
    log.write_bytes(b''.join(whole.splitlines(keepends=True)[:-1]))
    found.append(standing(log))
    assert told[-1] in found  # one more action may be there, which was not answered
    log.write_bytes(whole)


def until_the_end(pipe):
    """What was sent in whole before the kill."""
    told = []
    try:
        while True:
            told.append(pipe.recv())
    except (EOFError, OSError):
        return told


def standing(log):
    """What a session says that takes the log up."""
    taken = ClickLog(log)
    return {click.index: click.semantic for click in taken.clicks}, taken.boxes('corner')
