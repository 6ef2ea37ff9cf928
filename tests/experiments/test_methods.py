"""Tables of the compared methods: their rows, gains here and elsewhere, and what runs cost."""

import json

import pytest
from experiments.test_reproduce import finish, markdown

from rm3d_plugin.baselines import COMBINATIONS, METHODS
from rm3d_plugin.engine.round_times import total_seconds
from rm3d_plugin.experiments import TABLES
from rm3d_plugin.experiments.runner import run_folder
from rm3d_plugin.experiments.scores import fill_table
from rm3d_plugin.experiments.spec import Request, Row, Table
from rm3d_plugin.experiments.tables.published import PAPER, paper_gain, published_gain

TASKS = {
    'methods-indoor': 'sem',
    'methods-indoor-onept': 'sem',
    'methods-outdoor': 'sem',
    'methods-oakland': 'sem',
    'methods-instances': 'ins',
    'methods-scenes': 'ins',
    'methods-detection': 'votenet',
}


@pytest.mark.parametrize(('name', 'task'), TASKS.items())
def test_rows_follow_from_the_registry(name, task):
    titles = [row.name for row in TABLES[name].rows]
    for method in METHODS:
        assert any(title.startswith(f'{method.title} (') for title in titles) == (task in method.options)
    assert any(title.startswith('RM3D as in the paper (') for title in titles)
    assert any(title.startswith('RM3D (') for title in titles)
    weak = {row.against for row in TABLES[name].rows} - {None}
    assert weak and all(title.startswith('labelled ') for title in weak)


def test_rm3d_stands_with_what_helps():
    titles = [row.name for row in TABLES['methods-indoor'].rows]
    assert all(f'RM3D + {both.title.removeprefix("RM3D + ")} (0.2 % of the points)' in titles for both in COMBINATIONS)


def test_whole_scenes_teach_offsets():
    rows = {row.name: row.options for row in TABLES['methods-scenes'].rows}
    assert rows['CSC (5 % of the scenes)']['offset_weight'] == 1.0
    assert rows['RM3D (5 % of the scenes)'] == {'budget': 'scenes5pct'}


def test_published_gains_are_over_the_baseline_of_their_table():
    assert paper_gain('indoor 0p2pct', 'psd') == pytest.approx(61.5 - 46.5)
    assert published_gain('outdoor 0p2pct', 'gpc') == pytest.approx(42.45 - 35.64)
    assert paper_gain('indoor 0p2pct', 'gpc') is None and published_gain('nowhere', 'gpc') is None
    assert all(paper_gain(part, 'labelled_only') == 0.0 for part in PAPER)
    assert paper_gain('indoor onept', 'redal') == pytest.approx(57.8 - 40.1)
    assert paper_gain('outdoor 0p2pct', 'csc') == pytest.approx(42.5 - 34.5)
    assert paper_gain('instances 0p2pct', 'xu_lee') == pytest.approx(47.9 - 35.3)
    assert paper_gain('detection 1pct', 'pointcontrast') == pytest.approx(38.5 - 33.2)
    assert paper_gain('scenes scenes5pct', 'rm3d_csc') == pytest.approx(58.9 - 47.0)
    assert paper_gain('scenes scenes20pct', 'twist') == pytest.approx(67.8 - 63.0)
    assert paper_gain('scenes scenes5pct', 'rm3d') is None  # it stands with CSC there


def test_gains_and_costs_by_hand(tmp_path):
    weak = Row('weak', 'weak_cfg')
    better = Row('better', 'better_cfg', against='weak', paper_gain=5.0, published_gain=-1.0)
    worse = Row('worse', 'worse_cfg', against='weak', published_gain=-2.0)
    request = Request(tmp_path, seeds=(0, 1))
    for row, scores in ((weak, (10.0, 14.0)), (better, (13.0, 14.0)), (worse, (9.0, 10.0))):
        for seed, score in enumerate(scores):
            finish(request, row, seed, miou=score)
            second = {'wall': 9.0, 'cpu': 4.0 + seed}
            times = {'labels': {'0': second}, 'evaluating': {'0': second}, 'epochs': {'1': {'round': 0, **second}}}
            (run_folder(tmp_path, row, seed) / 'timing.json').write_text(json.dumps(times))
    (run_folder(tmp_path, better, 0) / 'pretraining.json').write_text('{"cpu_seconds": 6.0}')
    assert total_seconds(run_folder(tmp_path, weak, 1)).cpu == 10.0
    table = Table('a title', (weak, better, worse), {'mIoU': 'miou'}, cost=True)
    assert markdown(table, request)[2:] == [
        "| trained on | mIoU | gain | paper's gain | publication's gain | same sign | CPU s | CPU s of pre-training |",
        '|---|---|---|---|---|---|---|---|',
        '| weak | 12.0 (10.0 to 14.0) | - | - | - | - | 9 | - |',
        '| better | 13.5 (13.0 to 14.0) | +1.5 | +5.0 | -1.0 | no | 9 | 3 |',
        '| worse | 9.5 (9.0 to 10.0) | -2.5 | - | -2.0 | yes | 9 | - |',
    ]
    assert fill_table(table, request).records[0]['cpu_seconds'] == 8.0


def test_a_gain_over_no_row_is_refused():
    with pytest.raises(ValueError, match='against: expected one of'):
        Table('a title', (Row('better', 'cfg', against='weak'),), {'mIoU': 'miou'})
