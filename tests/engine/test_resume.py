"""A run that was killed anywhere and resumed leaves the very files of an unbroken one."""

import json
import shutil
import signal

import pytest
from runs import tiny_runs
from runs.same_run import assert_same_run

from rm3d_plugin.storage import LabelStore


def test_the_unbroken_run_has_two_rounds_two_epochs_and_two_validations(finished):
    assert sorted(finished.record['losses']) == sorted(finished.record['validation']) == ['1', '2']
    assert LabelStore(finished.folder / 'labels').rounds() == (0, 1)
    assert finished.record['losses']['1'] != finished.record['losses']['2']
    assert finished.record['synthetic'] is True and finished.record['config'] == 'rm3d_votenet_kitti_1pct'


RESUMED_FROM_EPOCH_1 = [
    'in the second epoch',
    'in a refresh',
    'in a label file',
    'before a round closes',
    'in the record',
    'in a checkpoint',
    'before a validation',
]


@pytest.mark.parametrize('moment', [*RESUMED_FROM_EPOCH_1, 'before the last validation', 'in the first epoch'])
def test_a_killed_run_goes_on_bit_for_bit(moment, world, finished, tmp_path):
    settings, work = tiny_runs.options(world), tmp_path / 'run'
    code, log = tiny_runs.run(tmp_path / 'killed.txt', tiny_runs.train, work, settings, False, moment)
    assert code == -signal.SIGKILL, log
    assert not (work / 'report.html').exists()
    code, log = tiny_runs.run(tmp_path / 'resumed.txt', tiny_runs.train, work, settings, True)
    assert code == 0, log
    assert_same_run(work, finished.folder)
    assert ('resumed epoch: 1' in log) == (moment in RESUMED_FROM_EPOCH_1)
    assert ('training starts from scratch' in log) == (moment == 'in the first epoch')
    assert not list(work.glob('.*')), 'parts of files were left behind'
    if moment in RESUMED_FROM_EPOCH_1:
        again = moment not in ('in the second epoch', 'in the record', 'in a checkpoint')
        assert [number for number, _, _ in tiny_runs.refreshes(log)] == ([1, 1, 1] if again else [])


def test_worker_processes_change_no_bit(world, finished, tmp_path):
    settings = tiny_runs.options(world, num_workers=2)
    code, log = tiny_runs.run(tmp_path / 'log.txt', tiny_runs.train, tmp_path / 'run', settings)
    assert code == 0, log
    assert_same_run(tmp_path / 'run', finished.folder)


def test_resuming_a_finished_run_changes_nothing(world, finished, tmp_path):
    work = tmp_path / 'run'
    shutil.copytree(finished.folder, work)
    code, log = tiny_runs.run(tmp_path / 'log.txt', tiny_runs.train, work, tiny_runs.options(world), True)
    assert code == 0, log
    assert_same_run(work, finished.folder)
    assert 'resumed epoch: 2' in log and tiny_runs.refreshes(log) == []


def test_a_resumed_run_must_have_the_same_settings(world, finished, tmp_path):
    work = tmp_path / 'run'
    shutil.copytree(finished.folder, work)
    changed = tiny_runs.options(world, learning_rate=0.5)
    code, log = tiny_runs.run(tmp_path / 'log.txt', tiny_runs.train, work, changed, True)
    assert code == 1 and 'learning_rate: ' in log and '0.5 now' in log
    assert_same_run(work, finished.folder)


def test_a_new_run_in_the_same_folder_leaves_nothing_of_the_old(world, finished, tmp_path):
    work = tmp_path / 'run'
    shutil.copytree(finished.folder, work)
    (work / 'labels' / 'clicks.csv').write_text('of a person')
    arguments = (work, tiny_runs.options(world, rounds=1), False, None, False, None)
    code, log = tiny_runs.run(tmp_path / 'log.txt', tiny_runs.train, *arguments)
    assert code == 1 and 'holds 2 checkpoints of a run (epoch_2.pth); go on with --resume' in log
    assert LabelStore(work / 'labels').rounds() == (0, 1)
    code, log = tiny_runs.run(tmp_path / 'log.txt', tiny_runs.train, *arguments, True)
    assert code == 0, log
    assert (work / 'labels' / 'clicks.csv').read_text() == 'of a person'
    assert [path.name for path in work.glob('epoch_*.pth')] == ['epoch_1.pth']
    assert LabelStore(work / 'labels').rounds() == (0,)
    assert json.loads((work / 'metrics.json').read_text())['losses'] == {'1': finished.record['losses']['1']}
