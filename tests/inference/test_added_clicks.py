"""Clicks are added to a finished run of one's own scans: told, taken up in the last round, the same after a kill."""

import shutil
import signal
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from inference.test_own_scans import CONFIG, OPTIONS, make_scans, world
from reference.toy_scenes import CLASSES, make_scene
from runs import tiny_runs

from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.engine.run import train as train_config
from rm3d_plugin.storage import LabelStore, read_json


def train(folder: Path, work: Path, resume=False, add=False, moment=None) -> None:
    from mmengine.registry import init_default_scope

    from rm3d_plugin.engine.run import set_threads
    from rm3d_plugin.labeling import PointBudgetSource
    from rm3d_plugin.registry import SCOPE

    own = {'data_root': str(folder / 'scans'), 'cache_dir': str(folder / 'geometry')}
    own |= {'budget.clicks': str(folder / 'clicks.csv'), 'sigma': 2, 'periods': [2, 2]}
    config = load_config(CONFIG, work, options=OPTIONS | own)
    next(hook for hook in config.custom_hooks if hook.type == 'ReportHook').update(train_scenes=0, val_scenes=0)
    set_threads(1)
    init_default_scope(SCOPE)
    tiny_runs._skip_pretty_printing()
    if moment == 'in the budget':
        tiny_runs._kill_at_call(PointBudgetSource, 'extend', call=1, after=True)
    if moment == 'before the round closes':
        tiny_runs._kill_at_call(LabelStore, 'finish_round', call=1, after=False)
    train_config(config, resume, add_clicks=add)


@pytest.fixture(scope='module')
def finished(tmp_path_factory) -> Path:
    folder = make_scans(tmp_path_factory.mktemp('clicked'))
    code, log = tiny_runs.run(folder / 'log.txt', partial(train, folder, folder / 'run'))
    assert code == 0, log
    members = np.flatnonzero(make_scene(0).semantic == 1)
    clicked = np.random.default_rng(1).choice(members, 5, replace=False)  # as make_scans draws them
    added = np.setdiff1d(members, clicked)[[2, 30, 60]]
    with (folder / 'clicks.csv').open('a') as file:
        file.writelines(f'a,{x:.4f},{y:.4f},{z:.4f},{CLASSES[1]}\n' for x, y, z in world(0)[added])
    return folder


@pytest.fixture(scope='module')
def unbroken(finished) -> Path:
    work = finished / 'unbroken'
    shutil.copytree(finished / 'run', work)
    code, log = tiny_runs.run(finished / 'unbroken.txt', partial(train, finished, work, True))
    assert code and 'clicks were added: a: 3 ' in log and '--resume --add-clicks' in log
    assert sorted(path.name for path in work.glob('epoch_*.pth')) == ['epoch_2.pth', 'epoch_4.pth'], 'nothing is lost'
    code, log = tiny_runs.run(finished / 'unbroken.txt', partial(train, finished, work, True, True))
    assert code == 0, log
    assert 'resumed epoch: 2' in log and '33 of 33 labelled points' not in log.split('resumed epoch')[0]
    return work


def test_the_last_round_is_made_again_with_all_clicks(finished, unbroken):
    store, before = LabelStore(unbroken / 'labels'), LabelStore(finished / 'run' / 'labels')
    assert store.rounds() == (0, 1)
    for name, more in (('a', 3), ('b', 0)):
        first, last = (store.read(name, number).point_is_annotated for number in (0, 1))
        assert first.sum() == 12 and last.sum() == 15 + more, 'a fifth of the clicks judges the network after round 0'
        np.testing.assert_array_equal(before.read(name, 0).semantic, store.read(name, 0).semantic)
    assert read_json(unbroken / 'labels' / 'budget.json')['annotated_per_class']['1'] == 13
    assert sorted(read_json(unbroken / 'metrics.json')['losses']) == ['1', '2', '3', '4']


@pytest.mark.parametrize('moment', ['in the budget', 'before the round closes'])
def test_a_kill_changes_nothing(finished, unbroken, moment, tmp_path):
    work = tmp_path / 'unbroken'  # the same name: the config in the checkpoint holds it
    shutil.copytree(finished / 'run', work)
    code, log = tiny_runs.run(tmp_path / 'killed.txt', partial(train, finished, work, True, True, moment))
    assert code == -signal.SIGKILL, log
    code, log = tiny_runs.run(tmp_path / 'resumed.txt', partial(train, finished, work, True))
    assert code == 0, log
    assert (work / 'metrics.json').read_bytes() == (unbroken / 'metrics.json').read_bytes()
    names = sorted(path.relative_to(work / 'labels') for path in (work / 'labels').rglob('*') if path.is_file())
    assert len(names) > 8
    for name in names:
        assert (work / 'labels' / name).read_bytes() == (unbroken / 'labels' / name).read_bytes(), name


def test_it_goes_with_resume_and_needs_a_checkpoint_where_a_round_begins(finished, tmp_path):
    with pytest.raises(ConfigError, match='--add-clicks: goes with --resume'):
        train(finished, tmp_path / 'new', add=True)
    shutil.copytree(finished / 'run', tmp_path / 'late')
    (tmp_path / 'late' / 'epoch_2.pth').unlink()
    with pytest.raises(ConfigError, match=r'no checkpoint of an epoch at which a round of labels begins \(2\)'):
        train(finished, tmp_path / 'late', True, True)
