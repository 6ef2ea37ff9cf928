"""Commands on damaged files: they end with 0, or with 2 and one message; nothing else is raised and none hangs.

``make fuzz`` tries many more (RM3D_FUZZ = cases of each kind; a twentieth of them where a whole run is started).
"""

import json
import os
import shutil
import time
import warnings

import numpy as np
import pytest
from jaxtyping import config
from reference.toy_scenes import ToyRooms
from runs import tiny_runs
from runs.random_segmentor import make_checkpoint, make_scan
from storage.damage import damaged
from storage.test_fuzz_stores import written_damaged

from rm3d_plugin.commands.main import run
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.storage.checkpoint import read_checkpoint

CASES = int(os.environ.get('RM3D_FUZZ', '4'))
RUNS = max(CASES // 20, 1)
LONGEST = 25  # s
DATASETS.register_module(module=ToyRooms, force=True)


def write_texts(folder):
    """A scan as text, and clicks on it."""
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 2, (300, 3))
    xyz[:, 2] = np.arange(300) % 2
    np.savetxt(folder / 'sheets.txt', xyz, fmt='%.3f', header='x y z')
    rows = [f'sheets,{point},{("low", "high")[point % 2]}' for point in range(0, 300, 31)]
    (folder / 'clicks.csv').write_text('\n'.join(['scene,index,class', *rows]) + '\n')


def predict(folder):
    make_checkpoint(folder / 'net.pth')
    make_scan(folder / 'scan.ply')
    return 'predict', folder / 'net.pth', folder / 'scan.ply', '--out', folder / 'out'


def label(folder):
    write_texts(folder)
    return 'label', folder / 'sheets.txt', '--clicks', folder / 'clicks.csv', '--out', folder / 'out', '--no-check'


def oversegment(folder):
    write_texts(folder)
    (folder / 'tune.csv').write_text((folder / 'clicks.csv').read_text())
    return 'oversegment', folder / 'sheets.txt', '--out', folder / 'out.ply', '--tune', folder / 'tune.csv'


def draw(name, text):
    def build(folder):
        (folder / name).write_text(text)
        budget = f'clicks={folder / name}'
        return 'draw_labels', '--dataset', 'ToyRooms', '--budget', budget, '--out', folder / 'out.csv'

    return build


CLICKS = [dict(scene='room0', index=5, **{'class': 'floor'}), dict(scene='room1', index=9, **{'class': 'box'})]
COMMANDS = {
    'predict: checkpoint': (predict, 'net.pth'),
    'predict: scan': (predict, 'scan.ply'),
    'label: scan': (label, 'sheets.txt'),
    'label: clicks': (label, 'clicks.csv'),
    'oversegment: scan': (oversegment, 'sheets.txt'),
    'oversegment: labels': (oversegment, 'tune.csv'),
    'draw_labels: clicks': (draw('clicks.csv', 'scene,index,class\nroom0,5,floor\nroom1,9,box\n'), 'clicks.csv'),
    'draw_labels: clicks.json': (draw('clicks.json', json.dumps(CLICKS)), 'clicks.json'),
}


@pytest.fixture(autouse=True)
def without_shape_checks():
    config.update('jaxtyping_disable', True)
    yield
    config.update('jaxtyping_disable', False)


@pytest.mark.parametrize('kind', COMMANDS)
def test_a_damaged_file(tmp_path, capsys, kind):
    make, name = COMMANDS[kind]
    refused = 0
    for case in range(CASES):
        folder = tmp_path / str(case)
        folder.mkdir()
        command, *arguments = map(str, make(folder))
        if case:
            path = folder / name
            written_damaged(path, path.read_bytes(), np.random.default_rng([case, len(kind)]))
        began = time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', UserWarning)
            code = run(command, arguments)
        told = capsys.readouterr()
        assert code in ((0, 2) if case else (0,)), (case, told)
        assert 'Traceback' not in told.out + told.err
        if code:
            refused += 1
            (message,) = [line for line in told.err.splitlines() if line.startswith('error: ')]
            assert len(message) < 2000, (case, message)
        assert time.process_time() - began < LONGEST, case
        shutil.rmtree(folder)
    print(f'{kind}: {CASES} cases, {refused} refused')


def ended(result):
    code, output = result
    assert code in (0, 2) and 'Traceback' not in output, output
    return code


def damage_one(folder, rng):
    """Damage one of the files that a run wrote."""
    files = sorted(path for path in folder.rglob('*') if path.is_file() and path.suffix in ('.npz', '.json', '.pth'))
    path = files[rng.integers(len(files))]
    written_damaged(path, path.read_bytes(), rng)
    return path


@pytest.mark.slow
@pytest.mark.parametrize('number', range(RUNS))
def test_what_a_run_left_is_damaged(trained, call, tmp_path, number):
    """Resuming the run, scoring its checkpoint and reading its ledgers."""
    rng = np.random.default_rng([7, number])
    work = tmp_path / 'run'
    shutil.copytree(trained, work)
    path = damage_one(work, rng)
    settings = tiny_runs.options(trained.parent / 'kitti', **tiny_runs.LEARNT)
    arguments = tiny_runs.arguments_of(settings, work)
    print(path.relative_to(work), ended(call('inspect_merges', '--labels', work / 'labels', '--ledger')))
    at = arguments.index('--work-dir')
    print(ended(call('train', *arguments[:at], '--resume', *arguments[at:])))


def weights_of(path):
    """A zip says some of its facts twice: what is damaged may be what nobody reads."""
    return {name: value.numpy().tobytes() for name, value in read_checkpoint(path)['state_dict'].items()}


@pytest.mark.slow
@pytest.mark.parametrize('number', range(RUNS))
def test_a_damaged_checkpoint_is_not_scored(trained, call, tmp_path, number):
    checkpoint = tmp_path / 'net.pth'
    good = max(trained.glob('epoch_*.pth')).read_bytes()
    checkpoint.write_bytes(damaged(good, np.random.default_rng([8, number])))
    settings = tiny_runs.options(trained.parent / 'kitti', **tiny_runs.LEARNT)
    arguments = tiny_runs.arguments_of(settings, tmp_path / 'scored')
    code = ended(call('test', arguments[0], checkpoint, *arguments[1:]))
    assert code == 2 or weights_of(checkpoint) == weights_of(max(trained.glob('epoch_*.pth')))
