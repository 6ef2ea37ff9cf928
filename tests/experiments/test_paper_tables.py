"""The paper's numbers, our differences beside them, and the specs of its tables: built, never trained."""

import copy
import json
import math

import pytest

from rm3d_plugin.engine import config as configs
from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.experiments.compare import compare, fill_paper_table, paired_p, sign_of
from rm3d_plugin.experiments.paper import paper_table, paper_value
from rm3d_plugin.experiments.render import to_csv, to_format, to_json, to_latex, to_markdown
from rm3d_plugin.experiments.run_commands import config_path, parse_options
from rm3d_plugin.experiments.runner import plan, run_folder
from rm3d_plugin.experiments.spec import PaperTable, Part, Request, Row
from rm3d_plugin.experiments.tables import ALL, TABLES
from rm3d_plugin.experiments.tables.octree import fill_octree, rows_of
from rm3d_plugin.experiments.tables.paper_rows import DEFAULT, PAPER, descriptor_names, method_rows_of

PAPER_TABLES = {name: table for name, table in TABLES.items() if isinstance(table, PaperTable)}
BASE, LESS = Row('all', 'a', paper='7'), Row('without', 'a', {'x': 1}, paper='3')
PART = Part('Rooms', (BASE, LESS, Row('ours alone', 'b')), ('mIoU',), 'all', 'table_ablation_fea_i:sem_scannet')
SCORES = {'all': {0: 60.0, 1: 62.0, 2: 61.0}, 'without': {0: 50.0, 1: 53.0, 2: 51.0}, 'ours alone': {0: 61.0, 1: 61.0}}


def test_the_papers_numbers_as_printed():
    assert paper_value('table_ablation_fea_i:sem_s3dis', '8') == 47.3
    assert paper_value('table_ablation_detect_o:waymo', '2') == 43.1
    assert paper_value('table_inseg:s3dis_0p2pct_turned', 'Predator') == 55.3
    assert paper_value('tablewslresults_sem_indoor:ins_scannet', 'psd onept') == 45.3
    assert paper_value('tablewslresults_det:waymo_cyclist', 'labelled_only 0p5pct') == 35.1
    assert paper_value('table_ablation_loss_i:ins_scannet', '1') is None  # N.A.
    assert paper_value('', '1') is None and paper_value('tab_twist:1pct', '') is None
    assert len(paper_table('table_des_no_ro')) == 14 and len(paper_table('tablewslresults_sem_outdoor')) == 25
    with pytest.raises(ConfigError, match="no table 'nothing' of the paper"):
        paper_table('nothing')


def test_differences_seed_by_seed_and_their_paired_test():
    found = compare(PART, SCORES)
    less = found['without']
    assert less.deltas == (-10.0, -9.0, -10.0) and less.paper == 51.1
    assert less.paper_delta == pytest.approx(51.1 - 65.2)
    mean, spread = -29 / 3, math.sqrt(((1 / 3) ** 2 * 2 + (2 / 3) ** 2) / 2)  # by hand: t with two degrees of freedom
    t = mean / (spread / math.sqrt(3))
    assert less.p == pytest.approx(1 - abs(t) / math.sqrt(2 + t * t))
    assert less.sign == 'agrees'
    assert found['all'].sign == '-' and found['all'].deltas == ()
    assert found['ours alone'].deltas == (1.0, -1.0) and found['ours alone'].sign == '-'  # not in the paper


@pytest.mark.parametrize(
    ('deltas', 'paper', 'sign'),
    [
        ((-10.0, -9.0, -10.0), -14.1, 'agrees'),
        ((10.0, 9.0, 10.0), -14.1, 'differs'),
        ((-1.0, 4.0, -2.0), -14.1, 'within noise'),
        ((0.0, 0.0), -14.1, 'within noise'),
        ((-2.0, -2.0), -14.1, 'agrees'),
        ((-2.0,), -14.1, 'one seed'),
        ((-2.0, -2.0), 0.0, '-'),
        ((), -14.1, '-'),
    ],
)
def test_signs(deltas, paper, sign):
    assert sign_of(deltas, paired_p(deltas), paper) == sign


def finish(request, row, seed, value):
    folder = run_folder(request.out, row, seed)
    folder.mkdir(parents=True)
    (folder / 'metrics.json').write_text(json.dumps({'losses': {}, 'validation': {}, 'final': {'mIoU': value}}))


def test_the_table_in_every_format(tmp_path):
    request = Request(tmp_path, seeds=(0, 1, 2))
    for row, values in ((BASE, (60, 62, 61)), (LESS, (50, 53, 51))):
        for seed, value in enumerate(values):
            finish(request, row, seed, float(value))
    table = fill_paper_table(
        PaperTable('Features', (Part(PART.title, (BASE, LESS), *PART_REST),), ('a note',)), request
    )
    lines = to_markdown(table).splitlines()
    assert lines[0] == 'Features; mean of seeds 0, 1, 2' and lines[1] == 'a note'
    assert lines[2].startswith('Sign: ') and 'paired t-test over the seeds' in lines[2]
    assert lines[-2] == '| 7. all | 61.0 (60.0 to 62.0) | - | - | 65.2 | - | - |'
    assert lines[-1] == '| 3. without | 51.3 (50.0 to 53.0) | -9.7 | 0.0012 | 51.1 | -14.1 | agrees |'
    assert to_csv(table).splitlines()[1] == 'Rooms,all,0,60.0'
    assert json.loads(to_json(table))['sections'][0]['rows'][1]['cells'][1]['values'] == [-10.0, -9.0, -10.0]
    assert r'\caption{Features; mean of seeds 0, 1, 2; Rooms; differences to: all}' in to_latex(table)
    assert to_format(table, 'png')[:4] == b'\x89PNG'


PART_REST = (PART.score, PART.base, PART.paper)


@pytest.mark.parametrize('name', PAPER_TABLES)
def test_every_part_has_the_papers_method_ours_and_the_labels_alone(name):
    for part in PAPER_TABLES[name].parts:
        names = [row.name for row in part.rows]
        assert DEFAULT in names and any(name.startswith('labelled ') for name in names)
        assert any(row.options.get('strategy') == 'paper' for row in part.rows)
        if part.paper:
            told = [row for row in part.rows if paper_value(part.paper, row.paper) is not None]
            assert len(told) >= 4 or (name == 'scenes' and len(told) == 3)


def test_rows_of_the_papers_ablations_are_complete():
    numbers = {
        name: [row.paper for row in PAPER_TABLES[name].parts[0].rows if row.paper.isdigit()]
        for name in PAPER_TABLES
        if name.startswith(('features', 'losses', 'detection-losses'))
    }
    assert {name: len(own) for name, own in numbers.items()} == {
        'features-indoor': 9,
        'features-outdoor': 8,
        'losses-segmentation': 5,
        'losses-detection': 5,
        'detection-losses-indoor': 4,
        'detection-losses-outdoor': 4,
    }
    instances = PAPER_TABLES['losses-segmentation'].parts[1].rows
    assert [row.paper for row in instances][:5] == ['6', '7', '8', '9', '10']
    cases = {row.paper for part in PAPER_TABLES['transfer'].parts for row in part.rows if row.paper}
    assert cases >= {'1', '2', '3', '4', '6', '7', '8', '9'}  # 5 and 10 with the descriptor Predator
    twins = {row.paper: dict(row.options) for row in PAPER_TABLES['features-indoor'].parts[0].rows if row.paper}
    assert twins['3'] == {'merge.without': ['descriptor'], 'strategy': 'paper'}
    assert twins['8'] == twins['3'] | {'oversegmenter.affinity_descriptor_weight': 0.0}


def test_rows_follow_the_registries(monkeypatch):
    from rm3d_plugin.baselines import BASELINES, LABELLED_ONLY
    from rm3d_plugin.baselines.base import Baseline

    other = Baseline('redal', 'ReDAL', LABELLED_ONLY.leaf, LABELLED_ONLY.options)
    monkeypatch.delitem(BASELINES, 'redal')
    monkeypatch.setitem(BASELINES, 'redal', other)  # the last now
    rows = {row.name: row for row in method_rows_of('sem', 'scannet', 'onept')}
    names = list(rows)
    assert names[:3] == [PAPER, DEFAULT, 'labelled points alone'] and names[-2:] == ['ReDAL', 'all points']
    assert paper_value('tablewslresults_sem_indoor:sem_scannet', rows['ReDAL'].paper) == 57.8
    assert 'AdaptedPFH' in descriptor_names() and 'External' not in descriptor_names()
    assert dict(method_rows_of('votenet', 'kitti', '3pct')[2].options) == {'budget': '3pct'}  # it has no such leaf


@pytest.fixture(scope='module')
def read_once():
    """Configs whose files are read once: only options differ from row to row."""
    known, read = {}, configs._read

    def reading(path):
        if path not in known:
            known[path] = read(path)
        return copy.deepcopy(known[path])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(configs, '_read', reading)
        yield


@pytest.mark.parametrize('name', PAPER_TABLES)
def test_every_row_is_a_config_with_its_options(name, read_once, tmp_path):
    runs = plan(PAPER_TABLES[name].rows, Request(tmp_path, seeds=(0,)))
    for number, run in enumerate(runs):
        for test in ({}, *run.tests.values()):
            options = parse_options({**run.options, **test})
            config = configs._read(config_path(run.config))
            config.merge_from_dict(config.pop('demo').to_dict())
            configs._apply(config, options)
            for key, value in options.items():
                if key.split('.')[-1] != '_delete_':
                    assert taken(config, key) == value
        if number == 0 and name in ('losses-segmentation', 'transfer'):
            load_config(config_path(run.config), tmp_path, True, parse_options({**run.options, **test}))


def taken(config, key):
    for part in key.split('.'):
        config = config[int(part)] if part.isdigit() else config[part]
    return config


def test_all_names_tables():
    assert set(ALL) <= set(TABLES) and set(PAPER_TABLES) <= set(ALL)


def test_the_octrees_table():
    found = {
        'seconds': {'rm3d': {'cpu_s': 2.0, 'times_ours': 1.0}, 'scipy_lists': {'cpu_s': 5.0, 'times_ours': 2.5}},
        'rules': {'none': {'visits': 90.0, 'microseconds': 8.0}, 'all': {'visits': 30.0, 'microseconds': 3.0}},
    }
    table = fill_octree(rows_of(found), 1000)
    assert [row.name for row in table.sections[1].rows] == ['none', 'all']
    assert '| scipy_lists | 5 | 2.5 |' in to_markdown(table) and '| all | 3 | 30 |' in to_markdown(table)
