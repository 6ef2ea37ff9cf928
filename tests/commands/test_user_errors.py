"""One message and an exit code for what a user can cause."""

import errno
import subprocess
import sys
import time

import pytest

from rm3d_plugin.commands import train
from rm3d_plugin.commands.main import main
from rm3d_plugin.commands.user_errors import exit_code
from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.inference.outputs import check_targets
from rm3d_plugin.storage import DamagedFileError
from rm3d_plugin.storage.locks import FolderInUseError
from rm3d_plugin.storage.scans import read_scan
from rm3d_plugin.storage.written_files import real_path
from rm3d_plugin.structures import SceneError


def raising(error):
    def command(arguments):
        raise error

    return command


@pytest.mark.parametrize(
    ('error', 'code', 'said'),
    [
        (SceneError('a.ply: torn'), 2, 'error: a.ply: torn\n'),
        (ConfigError('gamma: no'), 2, 'error: gamma: no\n'),
        (DamagedFileError('x'), 2, 'error: x\n'),
        (FolderInUseError('busy'), 2, 'error: busy\n'),
        (
            OSError(errno.ENOSPC, 'No space left on device', 'out/a.ply'),
            2,
            'error: out/a.ply: No space left on device\n',
        ),
        (PermissionError(errno.EACCES, 'Permission denied', 'in.ply'), 2, 'error: in.ply: Permission denied\n'),
        (OSError('odd'), 2, 'error: OSError: odd\n'),
        (
            MemoryError('40 GiB'),
            2,
            'error: out of memory (40 GiB); use a smaller scan or crop, or smaller max_points\n',
        ),
        (KeyboardInterrupt(), 130, 'stopped; go on with --resume\n'),
    ],
)
def test_codes_and_messages(error, code, said, capsys):
    assert exit_code(raising(error), hint='go on with --resume') == code
    assert capsys.readouterr().err == said


def test_what_is_a_fault_of_the_program_is_not_hidden():
    with pytest.raises(ValueError, match='a bug'):
        exit_code(raising(ValueError('a bug')))


@pytest.mark.parametrize('command', ['train', 'test', 'prepare'])
def test_a_wrong_config_is_told_before_torch_is_imported(command):
    words = [command, 'nosuch', 'a.pth'] if command == 'test' else [command, 'nosuch']
    code = (
        'import sys; from rm3d_plugin.commands.main import main\n'
        f'code = main({words!r}); assert "torch" not in sys.modules; sys.exit(code)'
    )
    began = time.process_time()
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True)
    assert (done.returncode, done.stderr.partition(';')[0]) == (2, 'error: nosuch: no such config')
    assert time.process_time() - began < 2


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        ('predict a.pth b.ply --out c --max-points 1', '--max-points: expected a whole number from 1000, got 1'),
        ('predict a.pth b.ply --out c --chunk -1', '--chunk: expected metres above 0, got -1'),
        ('predict a.pth b.ply --out c --unknown-below 3', '--unknown-below: expected a share from 0 to 1, got 3'),
        ('predict a.pth b.ply --out c --intensity-range 5 1', '--intensity-range: expected LOW below HIGH'),
        ('predict a.pth b.ply --out c --min-score nan', '--min-score: expected a share from 0 to 1, got nan'),
        ('oversegment a.ply --out b.ply --descriptor-options radius', "expected KEY=VALUE, got 'radius'"),
        ('train page.py --cfg-options =3', "--cfg-options: expected KEY=VALUE, got '=3'"),
        ('train page.py --cfg-options widths=[(1,2]', 'widths=[(1,2]: '),
        ('prepare page.py --jobs 0', '--jobs: expected a whole number from 1, got 0'),
        ('draw_labels page.py --out c --scenes many', '--scenes: expected a whole number from 0, got many'),
        ('test page.py a.pth --tta-rotations 1.5', '--tta-rotations: expected a whole number from 1, got 1.5'),
        ('label a.ply --clicks b.csv --out c --train 0', '--train: expected minutes above 0, got 0'),
        ('reproduce oakland --seeds -1', '--seeds: expected a whole number from 0, got -1'),
    ],
)
def test_numbers_of_the_command_line_are_checked_first(words, said, capsys):
    with pytest.raises(SystemExit) as ended:
        main(words.split())
    assert ended.value.code == 2 and said in capsys.readouterr().err


@pytest.mark.parametrize(
    ('page', 'told'),
    [
        ("import os\n_base_ = ['rm3d_plugin::rm3d_sem_files_rooms_clicks.py']\n", 'leave the import out'),
        ("_base_ = ['page.py']\n", "_base_ leads back to this page: 'page.py'"),
        ('raise SystemExit(3)\n', 'SystemExit: 3'),
        ('rounds = 1 / 0\n', 'ZeroDivisionError: division by zero'),
        ("_base_ = ['nosuch.py']\n", 'nosuch.py'),
    ],
)
def test_a_page_that_python_cannot_run(page, told, tmp_path):
    (tmp_path / 'page.py').write_text(page)
    with pytest.raises(ConfigError, match='page.py') as error:
        load_config(tmp_path / 'page.py')
    assert told in str(error.value)


def test_a_work_dir_that_is_a_file_is_told_before_demo_data_are_made(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'file').write_text('')
    words = ['rm3d_sem_scannet_0p2pct', '--demo', '--work-dir', str(tmp_path / 'file')]
    assert exit_code(train.main, words) == 2
    assert f'{tmp_path / "file"} is a file; name a folder' in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ['file']


def test_a_finished_work_dir_is_told_before_demo_data_are_made(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'run').mkdir()
    (tmp_path / 'run' / 'epoch_2.pth').touch()
    (tmp_path / 'run' / 'written_files.txt').write_text('epoch_2.pth\n')
    assert exit_code(train.main, ['rm3d_sem_scannet_0p2pct', '--demo', '--work-dir', 'run']) == 2
    assert 'run: holds 1 checkpoints of a run (epoch_2.pth); go on with --resume' in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ['run']


def test_links_in_a_circle_are_told(tmp_path):
    loop = tmp_path / 'loop'
    loop.symlink_to(loop)
    assert real_path(loop / 'a.ply') == real_path(tmp_path) / 'loop' / 'a.ply'
    check_targets([loop / 'a.ply'], [loop], tmp_path)
    with pytest.raises(SceneError, match='no such file'):
        read_scan(tmp_path / 'loop' / 'a.ply')
