import base64
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from rm3d_plugin.visualization import (
    BudgetSummary,
    Chart,
    Picture,
    ResultRow,
    RoundTime,
    RunReport,
    Series,
    draw_chart,
    render_report,
    write_report,
)
from rm3d_plugin.visualization.curves import nice_ticks
from rm3d_plugin.visualization.report_sections import duration

VOID = {'meta', 'img', 'input', 'line', 'circle', 'polyline', 'br'}
PNG = b'\x89PNG\r\n\x1a\nnot really'
ROUNDS = [
    {
        'coverage': 0.125,
        'truth_known': True,
        'points': {'Car': {'pseudo': 1234, 'precision': 0.875}, 'background': {'pseudo': 9, 'precision': None}},
        'boxes': {'Car': {'annotated': 2, 'pseudo': 8, 'correct': 6, 'true': 26}},
    },
    {
        'round': 5,
        'coverage': 0.5,
        'truth_known': False,
        'points': {},
        'boxes': {
            'Car': {
                'annotated': 2,
                'pseudo': 8,
                'correct': 0,
                'agreement': {
                    'boxes': 10,
                    'boxes_with_instance': 4,
                    'instances': 0,
                    'instances_with_box': 0,
                    'points_in_boxes': 200,
                    'points_of_class': 25,
                },
            }
        },
        'warnings': ['Cyclist: no pseudo box; of 9 candidates size took 7 <all>'],
    },
]
RUN = RunReport(
    title='Cars <b>&</b> "people"',
    synthetic=True,
    notes=['one <note>'],
    summary={'mAP': 51.239, 'device': 'CPU'},
    budget=BudgetSummary(
        'two boxes per ten scenes', 'cafe01', {'Car': (2, 28), 'Cyclist': (1, 4)}, seed=7, unit='boxes'
    ),
    results=[ResultRow('Car', '3d R40 @ 0.70', 61.5, 52.25, float('nan')), ResultRow('mean', '3d R40', 1.0, 2.0, 3.0)],
    charts=[Chart('Loss', 'epoch', 'loss', {'total & all': Series([1, 2, 3], [3.0, 2.0, 1.5])}, marks=[2])],
    rounds=ROUNDS,
    pictures=[Picture('Scene 000001 <seen>', PNG)],
    config={'descriptor': 'AdaptedPFH', 'script': '<script>alert(1)</script>'},
    config_text='x = "<tag>"',
    seconds={'train': 3600.0, 'merge': 400.0},
    times=[
        RoundTime(0, 61.0, 0.0, 40.0, None),
        RoundTime(1, 4.5, 1.25, 40.0, 0.1125, 0.5),
        RoundTime(2, 5.0, 2.0, 0.0, None),
    ],
)


class Reader(HTMLParser):
    """Checks that tags close in order; gathers text and rows of tables."""

    def __init__(self, text):
        super().__init__()
        self.open, self.words, self.rows, self.tags, self.links = [], [], [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for name, value in attrs if name in ('href', 'src', 'srcset', 'action', 'data')]
        if tag == 'tr':
            self.rows.append([])
        if tag in ('td', 'th'):
            self.rows[-1].append('')
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)
        if self.open and self.open[-1] in ('td', 'th', 'code') and 'tr' in self.open:
            self.rows[-1][-1] += data


@pytest.fixture(scope='module')
def reader():
    return Reader(render_report(RUN))


def test_page_holds_the_numbers(reader):
    assert ['Car', '3d R40 @ 0.70', '61.50', '52.25', '–'] in reader.rows
    assert ['mean', '3d R40', '1.00', '2.00', '3.00'] in reader.rows
    assert ['Car', '2', '28', '7.14 %'] in reader.rows
    assert ['all', '3', '32', '9.38 %'] in reader.rows
    assert ['0', '12.5 %', '1\u2009234', '87.5 %', '9', '–'] in reader.rows
    assert ['0', '2', '8', '75.0 %', '25.0 %'] in reader.rows
    assert ['5', '50.0 %', '–', '–', '–', '–'] in reader.rows
    assert ['5', '2', '8', '–', '–'] in reader.rows
    assert ['5', '40.0 %', '–', '12.5 %'] in reader.rows  # how far boxes, instances and classes agree
    assert ['train', '1 h 0 min', '90 %'] in reader.rows
    assert ['0', '1 min 1 s', '–', '40.0 s', '–', '–'] in reader.rows
    assert ['1', '4.5 s', '1.2 s', '40.0 s', '11.2 %', '0.5 s'] in reader.rows
    assert ['2', '5.0 s', '2.0 s', '–', '–', '–'] in reader.rows
    assert ['descriptor', 'AdaptedPFH'] in reader.rows
    text = ' '.join(reader.words)
    assert 'Round 5: Cyclist: no pseudo box; of 9 candidates size took 7 <all>' in text
    assert '51.24' in text and 'cafe01' in text and 'seed 7' in text and 'synthetic' in text


def test_page_needs_no_network_and_escapes_every_word(reader):
    page = render_report(RUN)
    assert not re.search(r'https?:|//\w|@import|url\(', page)
    assert reader.links == ['data:image/png;base64,' + base64.b64encode(PNG).decode()]
    assert 'script' not in reader.tags and 'b' not in reader.tags and 'seen' not in reader.tags
    assert 'Cars <b>&</b> "people"' in reader.words
    assert 'x = "<tag>"' in reader.words


def test_page_is_readable_for_all(reader):
    page = render_report(RUN)
    assert '<html lang="en">' in page and 'name="viewport"' in page and 'prefers-color-scheme: dark' in page
    assert page.count('<h1>') == 1
    assert 'alt="Scene 000001 &lt;seen&gt;"' in page
    assert 'aria-label="Loss: total &amp; all from 3 to 1.5"' in page


def test_what_is_empty_is_left_out():
    page = render_report(RunReport('Bare'))
    Reader(page)
    assert 'synthetic' not in page and '<h2' not in page and '<table' not in page


def test_written_whole_and_replaced(tmp_path):
    path = tmp_path / 'deep' / 'report.html'
    path.parent.mkdir()
    path.write_text('old')
    assert write_report(path, RUN) == path
    assert path.read_text(encoding='utf-8') == render_report(RUN)
    assert list(path.parent.iterdir()) == [path]


class TestCurves:
    def test_points_lie_where_the_values_say(self):
        svg = draw_chart(Chart('c', 'x', 'y', {'a': Series([0, 1], [0.0, 10.0])}))
        Reader(svg)
        assert 'points="56.0,256.0 624.0,14.0"' in svg

    def test_a_gap_splits_the_line(self):
        svg = draw_chart(Chart('c', 'x', 'y', {'a': Series([0, 1, 2, 3, 4], [1, 2, np.nan, 3, np.inf])}))
        assert svg.count('<polyline') == 1 and svg.count('<circle') == 3
        assert 'nan' not in svg and 'inf' not in svg

    def test_nothing_one_point_and_flat_lines(self):
        assert 'nothing was recorded' in draw_chart(Chart('c', 'x', 'y', {'a': Series([], [])}))
        for line in (Series([3], [5]), Series([1, 2], [0, 0])):
            Reader(draw_chart(Chart('c', 'x', 'y', {'a': line})))
        with pytest.raises(ValueError, match="line 'a': 1 x, 2 y"):
            draw_chart(Chart('c', 'x', 'y', {'a': Series([1], [1, 2])}))

    def test_ticks_are_round_and_inside(self):
        assert nice_ticks(0, 320, 8) == [0, 50, 100, 150, 200, 250, 300]
        assert nice_ticks(-0.003, 0.011) == [0, 0.005, 0.01]
        assert nice_ticks(2, 2) == [2]


def test_durations():
    assert [duration(s) for s in (0.04, 59.96, 60, 3599.7, 7260)] == [
        '0.0 s',
        '60.0 s',
        '1 min 0 s',
        '1 h 0 min',
        '2 h 1 min',
    ]


def test_budgets_are_told_in_words():
    page = render_report(RUN)
    assert '<strong>3 of 32 boxes, 9.4 %</strong>' in page and 'Existing' in page
    clicked = BudgetSummary('clicks = a.csv', 'cafe02', {'tree': (5, 5)}, 0, 'clicked points', total_known=False)
    page = render_report(RunReport('clicks', budget=clicked))
    assert '<strong>5 clicked points</strong>' in page and 'Existing' not in page and 'seed' not in page
