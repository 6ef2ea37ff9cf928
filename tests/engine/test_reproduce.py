"""The table of a few finished runs, worked out by hand; no training."""

import json

import pytest

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.reproduce import Table, render, reproduce, run_dir

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


def test_finished_runs_are_not_trained_again(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__('rm3d_plugin.engine.reproduce', fromlist=['TABLES']).TABLES, 'tiny', TABLE)
    for config in ('few_cfg', 'all_cfg'):
        finish(tmp_path, config, 3, car=10.0, mean=10.0)
    told = []
    text = reproduce('tiny', [3], tmp_path, log=told.append)
    assert [line.endswith('finished before') for line in told] == [True, True]
    assert (tmp_path / 'tiny.md').read_text() == text + '\n'


def test_unknown_table_names_the_known_ones(tmp_path):
    with pytest.raises(ConfigError, match=r"no table 'x'; there are: .*kitti-demo"):
        reproduce('x', [0], tmp_path)
