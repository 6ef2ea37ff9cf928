"""Parts of the page that only segmentation has, from plain values to rows."""

import re

import numpy as np
from visualization.test_report import Reader

from rm3d_plugin.visualization import BevPanel, MergeReport, MergeRow, RunReport, ScoreTable, draw_bev, render_report
from rm3d_plugin.visualization.palette import MORE, SERIES, class_color

NAN = float('nan')
ROUNDS = [
    {
        'round': number,
        'coverage': 0.5,
        'precision': 0.9,
        'mean_precision': 0.8,
        'offset_error': offset,
        'points': {
            'wall': {'pseudo': 1200 * (number + 1), 'coverage': 0.625, 'precision': 0.95, 'offset_error': None},
            'chair': {'pseudo': 0, 'coverage': 0.0, 'precision': None, 'offset_error': offset},
        },
        'boxes': {},
    }
    for number, offset in ((0, 0.25), (1, 0.125))
]


def test_scores_of_classes_have_rows():
    table = ScoreTable('Percent', ('Class', 'IoU', 'AP50'), [('chair <b>', 51.239, NAN), ('mean', 40.0, 30.0)])
    page = render_report(RunReport('t', scores=table))
    reader = Reader(page)
    assert ['Class', 'IoU', 'AP50'] in reader.rows
    assert ['chair <b>', '51.24', '–'] in reader.rows and ['mean', '40.00', '30.00'] in reader.rows
    assert re.search(r'<tr class="strong"><th scope="row">mean', page)


def test_labels_have_a_row_a_class_and_columns_a_round():
    rows = Reader(render_report(RunReport('t', rounds=ROUNDS))).rows
    assert ['Class', 'Round 0', 'Round 1'] in rows
    assert ['labels', 'coverage', 'precision', 'offset (m)'] * 2 in rows
    assert ['all', '1\u2009200', '50.0 %', '90.0 %', '0.25', '2\u2009400', '50.0 %', '90.0 %', '0.12'] in rows
    assert ['wall', '1\u2009200', '62.5 %', '95.0 %', '–', '2\u2009400', '62.5 %', '95.0 %', '–'] in rows
    assert ['chair', '0', '0.0 %', '–', '0.25', '0', '0.0 %', '–', '0.12'] in rows


def test_labels_without_instances_have_no_offsets():
    rounds = [{**entry, 'offset_error': None} for entry in ROUNDS]
    rows = Reader(render_report(RunReport('t', rounds=rounds))).rows
    assert ['labels', 'coverage', 'precision'] * 2 in rows
    assert ['chair', '0', '0.0 %', '–', '0', '0.0 %', '–'] in rows


def test_merges_are_told_with_their_terms():
    row = MergeRow('s<1>', (4, 9), ('chair', ''), (12, 1200), 0.5, NAN, 0.25, 1.0, 0.75, 0.6251, 0.6)
    merges = MergeReport(3, 4124, {'merged': 121, 'have different classes': 0}, {'Weakest merges': [row]})
    page = render_report(RunReport('t', merges=merges))
    reader = Reader(page)
    terms = ['0.50', '–', '0.25', '1.00', '0.75', '0.625', '0.600']
    assert ['s<1>', '4 + 9', 'chair | not known', '12 + 1\u2009200', *terms] in reader.rows
    assert 'Round 3: of 4\u2009124 pairs of adjacent regions 121 merged.' in ' '.join(reader.words)
    np.testing.assert_allclose(row.margin, 0.0251)
    alike = MergeRow('s', (1, 2), ('bed', 'bed'), (1, 1), 1, 1, 1, 1, 1, 1, 0.6)
    page = render_report(RunReport('t', merges=MergeReport(0, 1, {'merged': 1}, {'Strongest merges': [alike]})))
    assert any(cells[2:3] == ['bed'] for cells in Reader(page).rows)


def test_classes_have_colours_of_their_own():
    assert len({class_color(c) for c in range(24)}) == 24 and class_color(24) == class_color(0) == SERIES[0]
    assert class_color(8) == MORE[0]


def test_a_legend_beside_widens_nothing_but_is_drawn():
    xyz = np.random.default_rng(0).uniform(0, 4, (50, 3))
    panel = BevPanel('p', xyz, legend=[('#ff0000', 'a class')])
    beside = BevPanel('p', xyz, legend=panel.legend, legend_beside=True)
    assert draw_bev([panel]) != draw_bev([beside])


def test_the_estimate_of_each_round_is_told_where_labels_were_checked():
    checked = [
        {**ROUNDS[0], 'estimate': None},
        {**ROUNDS[1], 'estimate': {'miou': 68.2, 'low': 60.9, 'high': 75.0, 'clicks': 240}},
    ]
    rows = Reader(render_report(RunReport('t', rounds=checked))).rows
    assert ['0', 'no estimate: too few clicks'] in rows
    assert ['1', 'about 68 (61 to 75) mIoU, from 240 of your clicks'] in rows
    assert 'left out' not in render_report(RunReport('t', rounds=ROUNDS))
