"""``rm3d reproduce``: lists tables, prints one in a format, and tells what can be mended."""

import json

import pytest

from rm3d_plugin.commands.main import run
from rm3d_plugin.experiments import TABLES, FilledTable, MeasuredTable
from rm3d_plugin.experiments.render import Cell, NamedRow, Section


def tool(*arguments):
    return run('reproduce', [str(a) for a in arguments])


@pytest.fixture
def asked(monkeypatch):
    """What a table that is made by hand was asked for."""
    requests = []

    def measure(request):
        requests.append(request)
        section = Section('', ('name', '50 %'), (NamedRow('a', (Cell('1', (1.0,)),)),))
        return FilledTable('toy', (), (section,), ({'name': 'a', 'value': 1.0},), lambda: b'\x89PNG')

    monkeypatch.setitem(TABLES, 'robustness-card', MeasuredTable('toy', measure))
    return requests


def test_list(capsys):
    assert tool('--list', '--seeds', 0, 1) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == [*TABLES, 'all']
    assert lines[0].split()[1:3] == ['8', 'runs']


@pytest.mark.parametrize(
    ('format', 'printed'),
    [
        ('md', 'toy\n\n| name | 50 % |\n|---|---|\n| a | 1 |\n'),
        ('csv', 'name,value\na,1.0\n'),
        ('tex', None),
        ('json', None),
    ],
)
def test_a_table_in_a_format(tmp_path, capsys, asked, format, printed):
    assert tool('robustness-card', '--out', tmp_path, '--format', format) == 0
    out = capsys.readouterr().out
    assert out == (tmp_path / f'robustness-card.{format}').read_text() == (printed or out)
    assert format != 'json' or json.loads(out)['records'] == [{'name': 'a', 'value': 1.0}]
    assert format != 'tex' or r'name & 50 \% \\' in out


def test_a_figure_is_named(tmp_path, capsys, asked):
    assert tool('robustness-card', '--out', tmp_path, '--format', 'png') == 0
    assert capsys.readouterr().out == f'{tmp_path}/robustness-card.png\n'


def test_the_request_holds_the_arguments(tmp_path, asked):
    words = '--seeds 4 5 --jobs 3 --cfg-options a=1 b=2 --scenes 7 --points 0 --seed 9 --data rooms --data-root D'
    assert tool('robustness-card', '--out', tmp_path, *words.split()) == 0
    (request,) = asked
    assert (request.out, request.seeds, request.jobs, request.options) == (tmp_path, (4, 5), 3, ('a=1', 'b=2'))
    assert (request.scenes, request.points, request.seed, request.data) == (7, None, 9, ('rooms',))
    assert str(request.data_root) == 'D'


def test_a_table_must_be_named(capsys):
    assert tool() == 2 and 'name a table; --list shows them' in capsys.readouterr().err
    with pytest.raises(SystemExit):
        tool('nothing')
