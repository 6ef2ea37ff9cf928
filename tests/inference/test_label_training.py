"""From clicks to a network within a given time: the plan, what the config is told, and a small run."""

from contextlib import nullcontext
from functools import partial
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from reference.corner_scan import corner, few, write_clicks_csv
from runs import tiny_runs

from rm3d_plugin.commands import label
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.inference import label_refresh
from rm3d_plugin.inference.given_labels import GivenLabels, PointLabels
from rm3d_plugin.inference.label_files import WrittenScan
from rm3d_plugin.inference.label_refresh import label_again
from rm3d_plugin.inference.label_training import (
    Pace,
    Schedule,
    TrainingOptions,
    clicks_of,
    plan_schedule,
)
from rm3d_plugin.storage.ply import read_ply, write_ply

TINY = ['widths=[8,16]', 'voxel_size=0.3', 'threads=1', 'learning_rate=0.01']
FEW = ['rounds=1', 'sigma=8', 'periods=[8]', 'restart_weights=[1]']  # the time that is left is not used


@pytest.mark.parametrize(
    ('seconds', 'expected'),
    [(1000.0, Schedule(3, 160)), (80.0, Schedule(3, 6)), (60.0, Schedule(1, 20)), (45.0, Schedule(1, 12))],
)
def test_epochs_fill_the_time(seconds, expected):
    pace = Pace(epoch=2.0, beside=10.0)
    assert plan_schedule(seconds, pace) == expected
    needed = expected.rounds * expected.sigma * pace.epoch + (expected.rounds + 1) * pace.beside
    assert needed <= seconds < needed + expected.rounds * pace.epoch


def test_a_time_that_is_too_short_is_told_with_what_is_needed():
    with pytest.raises(ConfigError, match=r'an epoch takes 2.0 s, .* 10.0 s; give at least 0.9 minutes'):
        plan_schedule(25.0, Pace(epoch=2.0, beside=10.0))
    with pytest.raises(ConfigError, match='--train: expected minutes > 0, got 0'):
        TrainingOptions(0.0)


def test_labels_become_clicks_by_number():
    labels = PointLabels(np.array([4, 9]), np.array([1, 0]))
    clicks = clicks_of(GivenLabels(('2', '6'), (2, 6), {'a': labels}))
    assert [(click.scene, click.index, click.semantic) for click in clicks] == [('a', 4, 1), ('a', 9, 0)]


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    """A corner with clicks and one without."""
    folder = tmp_path_factory.mktemp('label')
    xyz, semantic = corner()
    for name in ('corner', 'other'):
        write_ply(folder / f'{name}.ply', {axis: xyz[:, i].astype(np.float32) for i, axis in enumerate('xyz')})
    clicks = write_clicks_csv(folder / 'clicks.csv', 'corner', few(semantic, 10), semantic)
    arguments = [str(folder / 'corner.ply'), '--clicks', str(clicks), '--out', str(folder / 'out'), '--train', '5']
    arguments += ['--more', str(folder / 'other.ply'), '--cfg-options', *TINY, *FEW]
    code, log = tiny_runs.run(folder / 'log.txt', partial(tiny_runs.command, 'label', folder, arguments))
    assert code == 0, log
    return folder, log, semantic


def test_the_network_is_judged_and_further_scans_are_predicted(run):
    folder, log, semantic = run
    assert 'training by rm3d_sem_files_rooms_clicks for 5 min' in log
    assert 'clicks that the network was not taught' in log and 'other.ply: predicted by the network' in log
    first, other = (read_ply(folder / 'out' / f'{name}.ply') for name in ('corner', 'other'))
    assert (first['label'] == semantic).mean() > 0.97
    assert list(other) == ['x', 'y', 'z', 'label', 'confidence', 'region']
    assert (other['label'] == semantic).mean() > 0.8
    assert list((folder / 'out' / 'training' / 'run').glob('epoch_*.pth'))
    assert not (folder / 'out' / 'training' / 'pace').exists()


class Said(NamedTuple):
    network_weight: float


@pytest.mark.parametrize('weights', [(0.0, 0.0), (0.0, 0.4)])
def test_further_scans_are_told_to_be_doubtful_where_nothing_speaks_for_the_network(weights, monkeypatch, tmp_path):
    scans = [tmp_path / 'a.ply', tmp_path / 'b.ply']
    said = dict(zip(scans, map(Said, weights), strict=True))
    prepared = SimpleNamespace(cloud=None, columns={})
    files = SimpleNamespace(
        scans=scans, prepared=lambda _: prepared, given=None, options=SimpleNamespace(format='same')
    )
    written = WrittenScan(tmp_path / 'c.ply', None, None, [])
    fakes = {
        'train_network': lambda *_: (None, None),
        'judges_of': lambda _: {'a': None, 'b': None},
        '_with_network': lambda _, scan, *__: said[scan],
        'write_scan': lambda *_: [],
        'scan_kind': lambda _: None,
        'summary_of': lambda *_: {},
        '_predicted': lambda *_: written,
    }
    for name, fake in fakes.items():
        monkeypatch.setattr(label_refresh, name, fake)
    summary = SimpleNamespace(add=lambda *_: None)
    expected = nullcontext() if any(weights) else pytest.warns(UserWarning, match='--more: 1 scans are predicted by')
    with expected:
        found = list(label_again(files, 'rooms', [written.scan], tmp_path, TrainingOptions(1.0), summary))
    assert found[-1] is written and len(found) == 3


def test_ctrl_c_leaves_the_first_labels(tmp_path, monkeypatch, capsys):
    xyz, semantic = corner()
    scan = write_ply(tmp_path / 'corner.ply', {axis: xyz[:, i].astype(np.float32) for i, axis in enumerate('xyz')})
    clicks = write_clicks_csv(tmp_path / 'clicks.csv', 'corner', few(semantic, 3), semantic)
    kept = {}

    def interrupted(*_):
        kept.update({path.name: path.read_bytes() for path in (tmp_path / 'out').iterdir()})
        raise KeyboardInterrupt

    monkeypatch.setattr(label_refresh, 'train_network', interrupted)
    with pytest.raises(SystemExit) as ended:
        label.main([str(scan), '--clicks', str(clicks), '--out', str(tmp_path / 'out'), '--train', '5', '--no-check'])
    assert ended.value.code == 130 and 'the labels written so far stand' in capsys.readouterr().err
    assert set(kept) == {'corner.ply', 'labels.json'}
    assert {path.name: path.read_bytes() for path in (tmp_path / 'out').iterdir()} == kept
