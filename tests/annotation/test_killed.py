"""kill -9 in the middle of random actions: what was answered is in the log.

``make faults`` kills as many sessions as RM3D_FAULTS says.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from reference.corner_scan import corner

from rm3d_plugin.annotation import ClickLog
from rm3d_plugin.storage.ply import write_ply

KILLS = int(os.environ.get('RM3D_FAULTS', '1'))
ACTIONS = 200  # at most, before the kill
SCRIPT = Path(__file__).with_name('killed_session.py')


@pytest.fixture(scope='module')
def scan(tmp_path_factory):
    """A corner; every session goes on with the log of the one before."""
    xyz, _ = corner()
    columns = {axis: xyz[:, i] for i, axis in enumerate('xyz')}
    return write_ply(tmp_path_factory.mktemp('killed') / 'corner.ply', columns)


@pytest.mark.parametrize('seed', range(KILLS))
def test_a_killed_session_keeps_every_answered_action(scan, seed):
    log = scan.with_name('corner.clicks.jsonl')
    count = int(np.random.default_rng(seed).integers(1, ACTIONS))
    with subprocess.Popen([sys.executable, str(SCRIPT), str(scan), str(seed)], stdout=subprocess.PIPE) as process:
        told = [process.stdout.readline() for _ in range(count)]
        process.kill()
        told += process.stdout.readlines()
    answered = json.loads([row for row in told if row.endswith(b'\n')][-1])
    found = [standing(log)]
    log_before = log.read_bytes()
    log.write_bytes(b''.join(log_before.splitlines(keepends=True)[:-1]))
    found.append(standing(log))
    assert answered in found  # one more action may be there, which was not answered
    log.write_bytes(log_before)


def standing(log):
    """What a session says that takes the log up."""
    taken = ClickLog(log)
    return {
        'labels': {str(click.index): click.semantic for click in taken.clicks},
        'boxes': {str(number): list(box.row) for number, box in taken.boxes('corner').items()},
    }
