"""The table of a few finished runs, worked out by hand; no training."""

import csv
import json
from dataclasses import replace

import pytest
from experiments.fake_commands import command

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments import TABLES, list_tables, make_table
from rm3d_plugin.experiments.render import to_markdown
from rm3d_plugin.experiments.run_commands import config_path
from rm3d_plugin.experiments.runner import Commands, run_folder
from rm3d_plugin.experiments.scores import fill_table
from rm3d_plugin.experiments.spec import MeasuredTable, Request, Row, Table, method_rows
from rm3d_plugin.experiments.tables.propagation import COLUMNS, METHODS
from rm3d_plugin.experiments.tables.pseudo_label_rounds import METHODS as ROUND_METHODS

FEW, ALL = Row('few', 'few_cfg'), Row('all', 'all_cfg')
TABLE = Table('a title', (FEW, ALL), {'Car': 'car', 'mean': 'mean'}, reference='all')
TRAINED = {name: table for name, table in TABLES.items() if isinstance(table, Table)}
OWN_ROWS = ('detection-mechanisms', 'methods-', 'descriptors-instance')  # tables whose rows are others
BY_BUDGET = [name for name in TRAINED if not name.startswith(OWN_ROWS)]


def finish(request, row, seed, **scores):
    folder = run_folder(request.out, row, seed)
    folder.mkdir(parents=True)
    (folder / 'metrics.json').write_text(json.dumps({'losses': {}, 'validation': {}, 'final': scores}))


def markdown(table, request):
    return to_markdown(fill_table(table, request)).splitlines()


def test_means_ranges_and_ratio(tmp_path):
    request = Request(tmp_path, seeds=(0, 1))
    finish(request, FEW, 0, car=30.0, mean=40.0)
    finish(request, FEW, 1, car=50.0, mean=44.0)
    finish(request, ALL, 0, car=90.0, mean=80.0)
    finish(request, ALL, 1, car=80.0, mean=88.0)
    assert markdown(TABLE, request) == [
        'a title; mean of seeds 0, 1 (lowest to highest)',
        '',
        '| trained on | Car | mean | mean / all |',
        '|---|---|---|---|',
        '| few | 40.0 (30.0 to 50.0) | 42.0 (40.0 to 44.0) | 50 % |',
        '| all | 85.0 (80.0 to 90.0) | 84.0 (80.0 to 88.0) | 100 % |',
    ]
    plain = markdown(replace(TABLE, reference=None), request)
    assert plain[2:4] == ['| trained on | Car | mean |', '|---|---|---|']
    assert plain[-1] == '| all | 85.0 (80.0 to 90.0) | 84.0 (80.0 to 88.0) |'
    lone = markdown(replace(TABLE, rows=(replace(FEW, seeds=(1,)), ALL)), request)
    assert lone[-2] == '| few (seeds 1) | 50.0 (50.0 to 50.0) | 44.0 (44.0 to 44.0) | 52 % |'
    assert fill_table(TABLE, request).records[1] == {
        'row': 'few', 'config': 'few_cfg', 'seed': 1, 'Car': 50.0, 'mean': 44.0
    }  # fmt: skip


LABELLED = {
    *TRAINED,
    'propagation',
    'pseudo-labels',
    'methods-pseudo-labels',
    'pseudo-boxes',
}  # the others measure descriptors and need no labels


@pytest.mark.parametrize('name', BY_BUDGET)
def test_each_budget_of_a_table_has_both_strategies_and_the_labels_alone(name):
    rows = [row for row in TRAINED[name].rows if not row.name.startswith('all ')]
    budgets = {row.config.removeprefix('rm3d_').removeprefix('sup_') for row in rows}
    assert budgets and len(rows) == 3 * len(budgets)
    for budget in budgets:
        own = [row for row in rows if row.config in (f'sup_{budget}', f'rm3d_{budget}')]
        assert [(row.config.split('_')[0], dict(row.options)) for row in own] == [
            ('sup', {}), ('rm3d', {'strategy': 'paper'}), ('rm3d', {})
        ]  # fmt: skip
        assert own[0].name.startswith('labelled ') and own[1].name.startswith('RM3D as in the paper (')


def test_measured_tables_of_labels_have_both_strategies_and_what_is_trivial():
    measured = {name for name, table in TABLES.items() if isinstance(table, MeasuredTable)}
    assert measured - LABELLED == {
        'descriptors-overseg',
        'descriptors-matching',
        'robustness-card',
        'unsupervised-instances',
        'clicks-to-quality',
        'octree',
        'figures',
    }
    assert {'nearest labelled point', 'labelled points alone', 'RM3D as in the paper', 'RM3D'} <= set(METHODS)
    assert {'labelled_only', 'nearest', 'paper', 'rm3d'} <= set(COLUMNS)
    assert list(ROUND_METHODS.values()) == ['nearest labelled point', 'RM3D as in the paper', 'RM3D']


def test_what_became_of_the_labels_stands_beside_the_scores(tmp_path):
    request = Request(tmp_path, seeds=(0, 1))
    for row, coverage, precision in ((FEW, 0.625, 0.9), (ALL, 1.0, None)):
        for seed in (0, 1):
            finish(request, row, seed, car=30.0, mean=40.0)
            last = {'coverage': coverage - seed / 8, 'precision': precision}
            for number, summary in enumerate(({'coverage': 0.5, 'precision': 0.1}, last)):
                folder = run_folder(tmp_path, row, seed) / 'labels' / f'round_{number:03d}'
                folder.mkdir(parents=True)
                content = {'round': number, 'scenes': {}, 'summary': summary}
                (folder / 'complete.json').write_text(json.dumps(content))
    table = replace(TABLE, labels=True)
    lines = markdown(table, request)
    assert lines[2].endswith('| mean / all | points with a label | pseudo labels right |')
    assert lines[-2].endswith('| 100 % | 56.2 (50.0 to 62.5) | 90.0 (90.0 to 90.0) |')
    assert lines[-1].endswith('| 100 % | 93.8 (87.5 to 100.0) | - |')
    assert fill_table(table, request).records[3]['points with a label'] == 87.5


def test_a_table_is_made_written_and_kept(tmp_path, monkeypatch):
    monkeypatch.setitem(TABLES, 'tiny', replace(TABLE, scores={'mIoU': 'mIoU', 'acc': 'acc'}))
    fake = Commands(lambda config: command('train', config))
    told = []
    request = Request(tmp_path, seeds=(3, 4), log=told.append)
    table = make_table('tiny', request, fake)
    assert (tmp_path / 'tiny.md').read_text() == to_markdown(table)
    assert to_markdown(table).splitlines()[-1] == '| all | 3.5 (3.0 to 4.0) | 7.0 (6.0 to 8.0) | 100 % |'
    assert [float(row['acc']) for row in csv.DictReader((tmp_path / 'tiny.csv').read_text().splitlines())] == [
        6,
        8,
        6,
        8,
    ]
    told.clear()
    assert to_markdown(make_table('tiny', request, fake)) == to_markdown(table)
    assert [line.endswith('finished before') for line in told] == [True] * 4


def test_unknown_table_names_the_known_ones(tmp_path):
    with pytest.raises(ConfigError, match=r"no table 'x'; there are: kitti-demo, .*robustness-card"):
        make_table('x', Request(tmp_path))


def test_list_of_tables(tmp_path):
    lines = list_tables(Request(tmp_path, seeds=(0, 1))).splitlines()
    assert (
        len(lines) == len(TABLES) + 1
        and lines[-1].startswith('all ')
        and lines[0].split()[:3] == ['kitti-demo', '8', 'runs']
    )
    assert [line.split()[1] for line in lines if line.startswith('propagation')] == ['measured']


def test_rows_of_every_method():
    rows = method_rows('ins', 's3dis', ['onept', '20pts'])
    assert [(row.name, row.config, dict(row.options)) for row in rows] == [
        ('labelled points alone (a point a class)', 'sup_ins_s3dis_onept', {}),
        ('RM3D as in the paper (a point a class)', 'rm3d_ins_s3dis_onept', {'strategy': 'paper'}),
        ('RM3D (a point a class)', 'rm3d_ins_s3dis_onept', {}),
        ('labelled points alone (20 points)', 'sup_ins_s3dis_20pts', {}),
        ('RM3D as in the paper (20 points)', 'rm3d_ins_s3dis_20pts', {'strategy': 'paper'}),
        ('RM3D (20 points)', 'rm3d_ins_s3dis_20pts', {}),
        ('all points', 'sup_ins_s3dis_full', {}),
    ]
    assert [row.train for row in method_rows('votenet', 'kitti', ['1pct'], full=False, train=())] == [()] * 3
    assert method_rows('votenet', 'kitti', [])[0].name == 'all boxes'


@pytest.mark.parametrize('name', TRAINED)
def test_the_configs_of_a_table_are_there(name):
    assert all(config_path(row.config).is_file() for row in TRAINED[name].rows)
