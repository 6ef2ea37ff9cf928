"""The table of a few finished runs, worked out by hand; no training."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments.reproduce import TABLES, Table, render, reproduce, run_dir

TABLE = Table('a title', {'few': 'few_cfg', 'all': 'all_cfg'}, {'Car': 'car', 'mean': 'mean'})


def finish(out, config, seed, **scores):
    folder = run_dir(out, config, seed)
    folder.mkdir(parents=True)
    (folder / 'metrics.json').write_text(json.dumps({'losses': {}, 'validation': {}, 'final': scores}))


def test_means_spreads_and_ratio(tmp_path):
    finish(tmp_path, 'few_cfg', 0, car=30.0, mean=40.0)
    finish(tmp_path, 'few_cfg', 1, car=50.0, mean=44.0)
    finish(tmp_path, 'all_cfg', 0, car=90.0, mean=80.0)
    finish(tmp_path, 'all_cfg', 1, car=80.0, mean=88.0)
    lines = render(TABLE, [0, 1], tmp_path).splitlines()
    assert lines[0] == 'a title; mean of seeds 0, 1 (lowest to highest)'
    assert lines[-2] == '| few | 40.0 (30.0 to 50.0) | 42.0 (40.0 to 44.0) | 50 % |'
    assert lines[-1] == '| all | 85.0 (80.0 to 90.0) | 84.0 (80.0 to 88.0) | 100 % |'
    plain = render(replace(TABLE, ratio=False), [0, 1], tmp_path).splitlines()
    assert plain[2:4] == ['| trained on | Car | mean |', '|---|---|---|']
    assert plain[-1] == '| all | 85.0 (80.0 to 90.0) | 84.0 (80.0 to 88.0) |'


def test_finished_runs_are_not_trained_again(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__('rm3d_plugin.experiments.reproduce', fromlist=['TABLES']).TABLES, 'tiny', TABLE)
    for config in ('few_cfg', 'all_cfg'):
        finish(tmp_path, config, 3, car=10.0, mean=10.0)
    told = []
    text = reproduce('tiny', [3], tmp_path, log=told.append)
    assert [line.endswith('finished before') for line in told] == [True, True]
    assert (tmp_path / 'tiny.md').read_text() == text + '\n'


def test_what_became_of_the_labels_stands_beside_the_scores(tmp_path):
    for config, coverage, precision in (('few_cfg', 0.625, 0.9), ('all_cfg', 1.0, None)):
        for seed in (0, 1):
            finish(tmp_path, config, seed, car=30.0, mean=40.0)
            for number, summary in enumerate(({'coverage': 0.5, 'precision': 0.1}, (coverage - seed / 8, precision))):
                if isinstance(summary, tuple):
                    summary = dict(zip(('coverage', 'precision'), summary, strict=True))
                folder = run_dir(tmp_path, config, seed) / 'labels' / f'round_{number:03d}'
                folder.mkdir(parents=True)
                content = {'round': number, 'scenes': {}, 'summary': summary}
                (folder / 'complete.json').write_text(json.dumps(content))
    lines = render(replace(TABLE, labels=True), [0, 1], tmp_path).splitlines()
    assert lines[2].endswith('| mean / full | points with a label | pseudo labels right |')
    assert lines[-2].endswith('| 100 % | 56.2 (50.0 to 62.5) | 90.0 (90.0 to 90.0) |')
    assert lines[-1].endswith('| 100 % | 93.8 (87.5 to 100.0) | - |')


@pytest.mark.parametrize('name', TABLES)
def test_the_configs_of_a_table_are_there_and_write_its_scores(name):
    folder = Path(__file__).resolve().parents[2] / 'configs'
    table = TABLES[name]
    for config in table.configs.values():
        assert (folder / f'{config}.py').is_file()
    assert list(table.configs.values())[-1].endswith('full') or not table.ratio


def test_unknown_table_names_the_known_ones(tmp_path):
    with pytest.raises(ConfigError, match=r"no table 'x'; there are: .*kitti-demo"):
        reproduce('x', [0], tmp_path)
