"""``rm3d annotate`` without a page: what it refuses; and the benchmark that measures it."""

import sys

import numpy as np
import pytest

from rm3d_plugin.annotation.demo_room import write_demo_room
from rm3d_plugin.commands.annotate import main
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments.benchmarks import clicks_to_quality as bench
from rm3d_plugin.storage.ply import read_ply


@pytest.mark.parametrize('words', [[], ['scan.ply', '--demo']])
def test_it_wants_scans_or_the_demo(words):
    with pytest.raises(ConfigError, match='expected scans, or --demo'):
        main(words)


def test_classes_are_split_by_blanks():
    with pytest.raises(ConfigError, match=r"--classes: got 'road,tree'; split names by blanks"):
        main(['scan.ply', '--classes', 'road,tree'])


def test_a_port_is_one_and_a_missing_scan_leaves_no_log(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(['scan.ply', '--port', '70000'])
    assert 'expected a whole number from 1 to 65535, got 70000' in capsys.readouterr().err
    with pytest.raises(ConfigError, match=r'scan\.ply: no such file'):
        main([str(tmp_path / 'scan.ply'), '--classes', 'road'])
    assert not list(tmp_path.iterdir())


def test_it_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, 'viser', None)
    monkeypatch.delitem(sys.modules, 'rm3d_plugin.annotation.page', raising=False)
    with pytest.raises(ConfigError, match=r'needs viser.*: pip install "rm3d_plugin\[annotate\]"'):
        main([str(tmp_path / 'scan.ply')])


def test_the_demo_room_is_written_once(tmp_path, monkeypatch):
    room = type('Room', (), {'aligned': np.zeros((9, 3)), 'colors': np.full((9, 3), 7), '__len__': lambda self: 9})()
    monkeypatch.setattr('rm3d_plugin.annotation.demo_room.make_room', lambda *arguments: room)
    path = write_demo_room(tmp_path / 'demo')
    assert read_ply(path)['red'].tolist() == [7] * 9
    path.write_text('mine')
    assert write_demo_room(tmp_path / 'demo').read_text() == 'mine'


def test_goals_that_most_runs_miss_are_said_to_be_over():
    one, other = np.array([[50.0, 85, 85, 95], [60, 70, 75, 78], [65, 71, 72, 73]]), np.full((3, 4), 75.0)
    assert bench.summary(np.stack([one, other])) == {
        'clicks to 70 %': 1.5,
        'clicks to 70 %, mean': 1.5,
        "clicks to 70 %, mean of the scans' medians": 1.5,
        'clicks to 80 %': 'over 4',
        'clicks to 80 %, mean': 4.5,
        "clicks to 80 %, mean of the scans' medians": 5.0,
        'clicks to 90 %': 'over 4',
        'clicks to 90 %, mean': 4.8,
        "clicks to 90 %, mean of the scans' medians": 5.0,
    }
