"""``rm3d NAME ...`` and ``python tools/NAME.py ...`` are one command."""

import importlib
import subprocess
import sys

import pytest
from runs.tiny_runs import ROOT

from rm3d_plugin import __version__
from rm3d_plugin.commands.main import NAMES, main, summary


def shell(*words, cwd):
    return subprocess.run([sys.executable, *map(str, words)], cwd=cwd, capture_output=True, text=True, timeout=120)


def test_help_names_every_command_in_one_line(capsys):
    with pytest.raises(SystemExit, match='0'):
        main(['--help'])
    told = capsys.readouterr().out.splitlines()
    for name in NAMES:
        (line,) = [line for line in told if line.split()[:1] == [name]]
        assert line.split(maxsplit=1)[1] == summary(name) and summary(name).endswith('.') and len(line) < 120
    assert len(told) < 30


def test_help_is_quick(tmp_path):
    loaded = 'import sys; from rm3d_plugin.commands.main import NAMES, summary; [summary(n) for n in NAMES]'
    done = shell('-c', f'{loaded}; print(*sys.modules)', cwd=tmp_path)
    assert done.returncode == 0 and not {'torch', 'numba', 'matplotlib'} & set(done.stdout.split())


def test_version(capsys):
    with pytest.raises(SystemExit, match='0'):
        main(['--version'])
    assert capsys.readouterr().out == f'rm3d_plugin {__version__}\n'


@pytest.mark.parametrize('words', [[], ['tran'], ['train'], ['train', '--nonsense']])
def test_a_wrong_line_ends_with_exit_code_2(words, capsys):
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert told.startswith('usage: rm3d') and 'rm3d' in told.splitlines()[-1]


@pytest.mark.parametrize('name', NAMES)
def test_a_command_has_a_tool_and_its_own_help(name, capsys):
    tool = (ROOT / 'tools' / f'{name}.py').read_text()
    assert f"run('{name}')" in tool and len(tool.splitlines()) < 10
    with pytest.raises(SystemExit, match='0'):
        main([name, '--help'])
    told = capsys.readouterr().out
    assert told.startswith(f'usage: rm3d {name} ')
    first = importlib.import_module(f'rm3d_plugin.commands.{name}').__doc__.splitlines()[0]
    assert ' '.join(first.split()[:5]) in ' '.join(told.split())


def test_tools_and_commands_are_the_same():
    assert {path.stem for path in (ROOT / 'tools').glob('*.py')} == set(NAMES)


@pytest.mark.parametrize('start', [('-m', 'rm3d_plugin', 'train'), (ROOT / 'tools' / 'train.py',)])
def test_both_doors_lead_to_one_message(start, tmp_path):
    done = shell(*start, 'absent.py', cwd=tmp_path)
    assert done.returncode == 2 and done.stdout == ''
    assert done.stderr.startswith('error: absent.py: no such config')
