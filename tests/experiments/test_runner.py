"""The runner with a trainer that only writes records: what is kept, refused, shared, killed and taken up."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest
from experiments.fake_commands import command

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments.run_commands import option_texts, parse_options, split_options
from rm3d_plugin.experiments.runner import Commands, Progress, RunError, alone, final_scores, plan, run_folder, run_rows
from rm3d_plugin.experiments.spec import Request, Row, Table

FAKE = Commands(lambda config: command('train', config), lambda config, checkpoint: command('test', config, checkpoint))
A, B = Row('a', 'a_cfg'), Row('b', 'b_cfg', {'strategy': 'paper'}, train=())


@pytest.fixture
def asked(tmp_path):
    told = []
    return Request(tmp_path / 'out', seeds=(0, 1), log=told.append), told


def begun(request):
    """Folder -> words of each command that began."""
    path = request.out / 'begun.txt'
    lines = path.read_text().splitlines() if path.exists() else []
    return [tuple(line.split(' ', 1)) for line in lines]


def test_every_run_has_its_folder_its_seed_and_its_record(asked):
    request, told = asked
    run_rows([A, B], request, FAKE)
    assert begun(request) == [
        ('a_cfg_seed0', 'a_cfg --demo --resume'),
        ('a_cfg_seed1', 'a_cfg --demo --resume'),
        ('b_cfg_strategy-paper_seed0', 'b_cfg --resume'),
        ('b_cfg_strategy-paper_seed1', 'b_cfg --resume'),
    ]
    assert final_scores(request.out, A, 1) == {'mIoU': 1.0, 'acc': 2.0, 'network/mIoU': 2.0}
    record = json.loads((run_folder(request.out, B, 1) / 'metrics.json').read_text())
    assert record['options'] == {'threads': '0', 'strategy': 'paper', 'seed': '1'}
    assert json.loads((run_folder(request.out, B, 1) / 'spec.json').read_text()) == {
        'config': 'b_cfg',
        'arguments': [],
        'seed': 1,
        'options': {'strategy': 'paper'},
    }
    assert (run_folder(request.out, A, 0) / 'train.log').read_text() == 'the fake one speaks\n'
    assert [line.split(': ')[1].split(';')[0] for line in told] == ['training', 'done'] * 4
    assert '1 of 4 runs' in told[1] and told[1].endswith(' left') and '4 of 4 runs' in told[-1]


def test_finished_runs_are_kept_and_missing_ones_made(asked):
    request, told = asked
    run_rows([A], request, FAKE)
    (run_folder(request.out, A, 1) / 'metrics.json').write_text('{"losses": {}, "validation": {}, "final": {}}')
    run_rows([A, B], replace(request, seeds=(0, 1, 2), options=('threads=4', 'cache_dir=elsewhere')), FAKE)
    assert [folder for folder, _ in begun(request)].count('a_cfg_seed0') == 1
    assert [folder for folder, _ in begun(request)].count('a_cfg_seed1') == 2  # it had no final scores
    assert any(line.endswith('a_cfg_seed0: finished before') for line in told)
    assert any('1 of 5 runs' in line for line in told)


def test_a_run_made_with_other_options_is_not_taken(asked):
    request, told = asked
    run_rows([A], replace(request, options=('sigma=2',)), FAKE)
    with pytest.raises(
        ConfigError, match=r"a_cfg_seed0: was made with options \{'sigma': '2'\}, not \{\}; name another --out"
    ):
        run_rows([B, A], request, FAKE)
    assert len(begun(request)) == 2  # nothing of B began
    with pytest.raises(ConfigError, match=r"arguments \['--demo'\], not \[\]"):
        run_rows([replace(A, train=())], replace(request, options=('sigma=2',)), FAKE)
    run_rows([A], replace(request, options=('sigma=2', 'threads=1')), FAKE)


def test_an_option_that_one_row_does_not_read_is_told_before_any_trains(asked):
    request, told = asked
    rows = [
        Row('points', 'rm3d_sem_scannet_0p2pct'),
        Row('regions', 'rm3d_sem_scannet_0p2pct', {'strategy': 'regions'}),
    ]
    with pytest.raises(ConfigError, match=r'0p2pct_strategy-regions_seed0: .*walker.*; nothing was begun'):
        run_rows(rows, replace(request, options=('walker.sigma=0.1',)))
    with pytest.raises(ConfigError, match='0p2pct_seed0: .*no such key.*; nothing was begun'):
        run_rows([replace(rows[0], test={'nosuch': 1})], request)
    assert told == [] and not request.out.exists()


def test_a_run_without_a_spec_is_taken_where_its_record_fits(asked):
    request, told = asked
    for seed in (0, 1):
        folder = run_folder(request.out, A, seed)
        folder.mkdir(parents=True)
        record = {'config': 'a_cfg', 'seed': seed, 'final': {'mIoU': 5.0}}
        (folder / 'metrics.json').write_text(json.dumps(record))
    run_rows([A], request, FAKE)
    assert begun(request) == []
    (folder / 'metrics.json').write_text(json.dumps({**record, 'seed': 7}))
    with pytest.raises(ConfigError, match='seed1: was made with seed 7, not 1'):
        run_rows([A], request, FAKE)


def test_one_failure_stops_no_other(asked):
    request, told = asked
    bad = Row('bad', 'bad_cfg', {'fail': 1})
    with pytest.raises(
        ConfigError, match=r'2 of 4 runs failed:\n  .*bad_cfg_fail-1_seed0: ended with exit code 3; see '
    ):
        run_rows([bad, A], request, FAKE)
    assert final_scores(request.out, A, 1)['mIoU'] == 1.0
    log = run_folder(request.out, bad, 0) / 'train.log'
    assert sum('failed' in line for line in told) == 2 and log.read_text() == 'the fake one speaks\n'
    with pytest.raises(ConfigError, match=r'seed0: ended with exit code 3; see .*seed0/train\.log'):
        run_rows([bad], request, FAKE)


def test_rows_that_train_the_same_share_the_run_and_are_tested_apart(asked):
    request, told = asked
    turned = Row('turned', 'a_cfg', test={'val_dataloader.turn': 90, 'score': 8})
    rows = [A, turned, replace(turned, name='other', train=None, test={'score': 6})]
    run_rows(rows, request, FAKE)
    tests = ('test_score-8_val_dataloader.turn-90', 'test_score-6')
    assert [(folder, words.split()[0]) for folder, words in begun(request)] == [
        *((f'a_cfg_seed{seed}', 'a_cfg') for seed in (0, 1)),  # all trainings first
        *((f'a_cfg_seed{seed}/{test}', 'a_cfg') for seed in (0, 1) for test in tests),
    ]
    assert begun(request)[2][1] == f'a_cfg {request.out}/a_cfg_seed0/epoch_4.pth --demo'
    assert [final_scores(request.out, row, 1)['mIoU'] for row in rows] == [1.0, 8.0, 6.0]
    run_rows(rows, request, FAKE)
    assert len(begun(request)) == 6
    (request.out / 'a_cfg_seed0' / 'test_score-6' / 'test_metrics.json').unlink()
    run_rows(rows, request, FAKE)
    assert [folder for folder, _ in begun(request)[6:]] == ['a_cfg_seed0/test_score-6']


def test_a_row_that_only_tests_needs_a_finished_run(asked):
    request, told = asked
    with pytest.raises(ConfigError, match='a_cfg_seed0: there is no finished run to test; make the table'):
        run_rows([replace(A, train=None)], request, FAKE)
    run_rows([A], request, FAKE)
    run_rows([replace(A, train=None, test={'score': 3})], request, FAKE)
    assert final_scores(request.out, replace(A, test={'score': 3}), 0)['mIoU'] == 3.0


def test_a_row_may_have_its_own_seeds(asked):
    request, told = asked
    assert [run.seed for run in plan([replace(A, seeds=(5,)), B], request)] == [5, 0, 1]


def test_several_jobs_run_at_once(asked):
    request, told = asked
    rows = [Row(name, f'{name}_cfg', {'hang': 1}) for name in 'ab']
    table = threading.Thread(target=run_rows, args=(rows, replace(request, jobs=4), FAKE))
    table.start()
    wait_for(lambda: len(begun(request)) == 4)  # none has ended: all four wait
    (request.out / 'go').touch()
    table.join(60)
    record = json.loads((run_folder(request.out, rows[0], 0) / 'metrics.json').read_text())
    assert record['options']['threads'] == '1' and all(run.is_finished for run in plan(rows, request))


TABLE_PROCESS = """
import sys
from pathlib import Path
from experiments.test_runner import FAKE
from rm3d_plugin.experiments.runner import run_rows
from rm3d_plugin.experiments.spec import Request, Row
run_rows([Row('a', 'a_cfg'), Row('h', 'h_cfg', {'hang': 1})], Request(Path(sys.argv[1]), seeds=(0, 1)), FAKE)
"""


def wait_for(happened, seconds=120):
    end = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < end, 'waited too long'
        time.sleep(0.02)


@pytest.mark.parametrize('whole_group', [True, False])
def test_a_killed_table_goes_on(asked, whole_group):
    """Killed with its training, the rest is trained; killed alone, the training that outlives it is waited for."""
    request, told = asked
    path = os.pathsep.join([str(Path(__file__).parents[1]), *sys.path])
    process = subprocess.Popen(
        [sys.executable, '-c', TABLE_PROCESS, str(request.out)],
        env={**os.environ, 'PYTHONPATH': path},
        start_new_session=True,
    )
    wait_for(lambda: len(begun(request)) == 3)
    (os.killpg if whole_group else os.kill)(process.pid, signal.SIGKILL)
    process.wait()
    rows = [A, Row('h', 'h_cfg', {'hang': 1})]
    table = threading.Thread(target=run_rows, args=(rows, request, FAKE))
    table.start()
    wait_for(lambda: len(begun(request)) == 4 if whole_group else any('waiting' in line for line in told))
    (request.out / 'go').touch()
    table.join(60)
    names = [folder for folder, _ in begun(request)]
    assert names.count('h_cfg_hang-1_seed0') == (2 if whole_group else 1)
    assert [names.count(name) for name in ('a_cfg_seed0', 'a_cfg_seed1', 'h_cfg_hang-1_seed1')] == [1, 1, 1]
    assert all(run.is_finished for run in plan(rows, request))


def test_waiting_for_a_folder_can_be_stopped(tmp_path):
    told, stopped = [], threading.Event()
    with alone(tmp_path, told.append, stopped):
        stopped.set()
        with pytest.raises(RunError, match='stopped'), alone(tmp_path, told.append, stopped):
            pass
    assert len(told) == 1 and 'another process works there' in told[0]
    with alone(tmp_path, told.append, threading.Event()):
        assert len(told) == 1


def test_time_left():
    progress = Progress(todo=5, jobs=2)
    assert progress.after(600) == '1 of 5 runs, 10 min; about 20 min left'
    assert progress.after(1200) == '2 of 5 runs, 20 min; about 22 min left'
    assert progress.after(30) == '3 of 5 runs, 30 s; about 10 min left'
    assert [progress.after(30), progress.after(30)] == ['4 of 5 runs, 30 s; about 8 min left', '5 of 5 runs, 30 s']


def test_options_on_a_command_line_come_back():
    options = {'strategy': 'paper', 'merge': {'gamma': 0.25, 'without': ['color', 'scale']}, 'ground': None, 'on': True}
    texts = option_texts(options)
    assert texts == {
        'strategy': 'paper',
        'merge.gamma': '0.25',
        'merge.without': '[color,scale]',
        'ground': 'None',
        'on': 'True',
    }
    assert parse_options(texts) == {
        'strategy': 'paper',
        'merge.gamma': 0.25,
        'merge.without': ['color', 'scale'],
        'ground': None,
        'on': True,
    }
    for value in ({}, 'a b', object()):
        with pytest.raises(ConfigError, match='option x: expected a number, a word'):
            option_texts({'x': value})
    assert split_options(['a=1', 'b=c=2']) == {'a': '1', 'b': 'c=2'}
    with pytest.raises(ConfigError, match="expected KEY=VALUE, got 'a'"):
        split_options(['a'])


def test_long_options_are_a_hash_in_the_name(tmp_path):
    row = Row('a', 'dir/a_cfg.py', {f'a_long_key_{i}': i for i in range(9)})
    name = run_folder(tmp_path, row, 3).name
    assert name.startswith('a_cfg_') and name.endswith('_seed3') and len(name) < 30
    assert name != run_folder(tmp_path, replace(row, options={**row.options, 'a_long_key_0': 1}), 3).name
    assert run_folder(tmp_path, Row('a', 'a', train=('--demo', '--amp')), 0).name == 'a_amp_seed0'


def test_tables_that_contradict_themselves():
    with pytest.raises(ValueError, match='two rows have one name'):
        Table('t', (A, A), {'mIoU': 'mIoU'})
    with pytest.raises(ValueError, match=r"reference: expected one of \['a'\], got 'b'"):
        Table('t', (A,), {'mIoU': 'mIoU'}, reference='b')
