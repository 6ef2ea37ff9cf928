"""Every format of the renderer, value by value."""

import csv
import io
import json
import math

import numpy as np

from rm3d_plugin.experiments.render import (
    FORMATS,
    Cell,
    FilledTable,
    NamedRow,
    Section,
    bar_figure,
    escape_latex,
    save,
    to_csv,
    to_format,
    to_json,
    to_latex,
    to_markdown,
)

ROOMS = Section(
    'rooms & co',
    ('method', 'mIoU_a', '50 %'),
    (
        NamedRow('few {1 %}', (Cell('40.0 (30.0 to 50.0)', (30.0, 50.0)), Cell('-'))),
        NamedRow('all', (Cell('85.0 (80.0 to 90.0)', (80.0, 90.0)), Cell('100 %'))),
    ),
)
STREETS = Section('', ('method', 'F1'), (NamedRow('x', (Cell('1', (1.0,)),)),))
RECORDS = (
    {'row': 'few, "1 %"', 'seed': 0, 'mIoU': 0.1 + 0.2},
    {'row': 'all\nlines', 'seed': 1, 'mIoU': 1 / 3, 'note': 'a,b'},
    {'row': 'none', 'seed': np.int64(2), 'mIoU': None},
)
TABLE = FilledTable('A title', ('a note',), (ROOMS, STREETS), RECORDS, lambda: bar_figure([ROOMS], 1, 'mIoU'))


def test_markdown():
    assert to_markdown(TABLE).splitlines() == [
        'A title',
        'a note',
        '',
        '**rooms & co**',
        '',
        '| method | mIoU_a | 50 % |',
        '|---|---|---|',
        '| few {1 %} | 40.0 (30.0 to 50.0) | - |',
        '| all | 85.0 (80.0 to 90.0) | 100 % |',
        '',
        '| method | F1 |',
        '|---|---|',
        '| x | 1 |',
    ]


def test_csv_is_read_back_in_full_precision():
    rows = list(csv.DictReader(io.StringIO(to_csv(TABLE))))
    assert [row['row'] for row in rows] == ['few, "1 %"', 'all\nlines', 'none']
    assert [float(row['mIoU']) for row in rows[:2]] == [0.1 + 0.2, 1 / 3] and rows[2]['mIoU'] == ''
    assert [row['note'] for row in rows] == ['', 'a,b', ''] and rows[2]['seed'] == '2'


def test_json_round_trip():
    content = json.loads(to_json(TABLE))
    assert (content['title'], content['notes']) == ('A title', ['a note'])
    sections = tuple(
        Section(
            section['title'],
            tuple(section['columns']),
            tuple(
                NamedRow(row['name'], tuple(Cell(cell['text'], tuple(cell['values'])) for cell in row['cells']))
                for row in section['rows']
            ),
        )
        for section in content['sections']
    )
    assert sections == TABLE.sections
    assert content['records'] == [dict(record) for record in RECORDS]
    nan = FilledTable('t', (), (), ({'cosine': math.nan, 'array': np.array([1.5])},), TABLE.figure)
    assert json.loads(to_json(nan))['records'] == [{'cosine': None, 'array': [1.5]}]


def test_latex():
    lines = to_latex(TABLE).splitlines()
    assert lines[:2] == ['% A title', '% a note']
    assert lines[2:14] == [
        r'\begin{table}',
        r'\centering',
        r'\caption{A title; rooms \& co}',
        r'\begin{tabular}{lrr}',
        r'\toprule',
        r'method & mIoU\_a & 50 \% \\',
        r'\midrule',
        r'few \{1 \%\} & 40.0 (30.0 to 50.0) & - \\',
        r'all & 85.0 (80.0 to 90.0) & 100 \% \\',
        r'\bottomrule',
        r'\end{tabular}',
        r'\end{table}',
    ]
    assert r'\caption{A title}' in lines and lines.count(r'\end{table}') == 2


def test_latex_has_no_special_character_left():
    assert escape_latex('a\\b ~ ^ $x$ #1') == r'a\textbackslash{}b \textasciitilde{} \textasciicircum{} \$x\$ \#1'


def test_figure_shows_means_and_ranges():
    picture = TABLE.figure()
    assert picture.startswith(b'\x89PNG') and picture == TABLE.figure()
    same_mean = NamedRow('few {1 %}', (Cell('', (20.0, 60.0)), Cell('-')))
    wider = Section(ROOMS.title, ROOMS.columns, (same_mean, ROOMS.rows[1]))
    assert bar_figure([wider], 1, 'mIoU') != picture


def test_all_files_are_written(tmp_path):
    paths = save(TABLE, tmp_path, 'rooms')
    assert [path.name for path in paths] == [f'rooms.{name}' for name in FORMATS]
    assert paths[0].read_text() == to_markdown(TABLE) and paths[4].read_bytes() == TABLE.figure()
    assert all(to_format(TABLE, name) == (tmp_path / f'rooms.{name}').read_bytes() for name in FORMATS)
