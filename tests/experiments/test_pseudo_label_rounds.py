"""Which runs the table of rounds needs, and what it makes of the records of their labels."""

import numpy as np
import pytest
from experiments.fake_commands import command

from rm3d_plugin.datasets.base import Truth
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments.render import to_markdown
from rm3d_plugin.experiments.runner import Commands, run_folder
from rm3d_plugin.experiments.spec import Request
from rm3d_plugin.experiments.tables import pseudo_label_rounds
from rm3d_plugin.experiments.tables.propagation import oakland_scans, scan_rows
from rm3d_plugin.experiments.tables.pseudo_label_rounds import (
    pseudo_label_table,
    real_rows,
    real_scans,
    synthetic_rows,
)
from rm3d_plugin.labeling import LabelSource
from rm3d_plugin.pseudo_labels import AnnotatedLabels
from rm3d_plugin.storage import LabelStore
from rm3d_plugin.structures import Boxes3D, PointCloud, PseudoLabels

FAKE = Commands(lambda config: command('train', config))
NOBODY = np.full(3, -1)
LABELS = PseudoLabels(NOBODY, NOBODY, NOBODY >= 0, np.zeros(3), Boxes3D.empty(), np.zeros(0, bool))
OAKLAND = {  # scan -> strategy -> coverage and precision by round
    'a': {'paper': [(0.25, 0.5), (0.5, 0.75)], 'rm3d': [(0.5, 1.0), (0.75, 0.875)]},
    'b': {'paper': [(0.75, None), (1.0, 0.25)], 'rm3d': [(1.0, 0.5), (1.0, 0.5)]},
}


def write_rounds(folder, rounds):
    store = LabelStore(folder / 'labels')
    for number, (coverage, precision) in enumerate(rounds):
        store.begin_round(number)
        store.write(number, 'scene', LABELS)
        store.finish_round(number, {'coverage': coverage, 'precision': precision})


def asked(tmp_path, **more):
    return Request(tmp_path / 'out', seed=3, data_root=tmp_path, scenes=5, options=('threads=1',), **more)


class Line(LabelSource):
    """Seven points a metre apart, the first and the last are labelled: 1, 2 and 3 are called as the first."""

    classes, scene_ids = ('ground', 'car'), ('line',)

    def load_cloud(self, index):
        return PointCloud(np.arange(7.0)[:, None] * [1, 0, 0])

    def annotated_labels(self, index):
        semantic = np.array([0, -1, -1, -1, -1, -1, 1])
        return AnnotatedLabels(semantic, np.full(7, -1), Boxes3D.empty())

    def truth(self, index):
        return Truth(Boxes3D.empty(), semantic=np.array([0, 0, 1, 1, 0, 1, 1]))


@pytest.fixture(autouse=True)
def source(monkeypatch):
    monkeypatch.setattr(pseudo_label_rounds, 'label_source', lambda folder: Line())


@pytest.fixture
def tiles(tmp_path):
    (tmp_path / 'oakland').mkdir()
    for name in OAKLAND:
        (tmp_path / 'oakland' / f'oakland_{name}.xyz_label_conf').touch()


@pytest.mark.usefixtures('tiles')
def test_real_scans_have_a_row_a_round_and_their_mean_comes_first(tmp_path):
    request = asked(tmp_path, data=('oakland',))
    for scan in real_scans(request):
        for strategy, row in real_rows(scan, request).items():
            write_rounds(run_folder(request.out, row, 3), OAKLAND[scan.name.removeprefix('Oakland ')][strategy])
    table = pseudo_label_table(request, FAKE)
    assert [section.title for section in table.sections] == ['Mean of the real scans', 'Oakland a', 'Oakland b']
    lines = to_markdown(table).splitlines()
    assert lines[4] == (
        '| round | nearest labelled point: coverage | nearest labelled point: precision '
        '| RM3D as in the paper: coverage | RM3D as in the paper: precision '
        '| RM3D: coverage | RM3D: precision |'
    )
    assert lines[6:8] == [
        '| 0 | 100.0 | 40.0 | 50.0 | 50.0 | 75.0 | 75.0 |',
        '| 1 | - | - | 75.0 | 50.0 | 87.5 | 68.8 |',
    ]
    assert lines[-2:] == [
        '| 0 | 100.0 | 40.0 | 75.0 | - | 100.0 | 50.0 |',
        '| 1 | - | - | 100.0 | 25.0 | 100.0 | 50.0 |',
    ]
    assert table.records[1] == {
        'seed': 3, 'data': 'Oakland a', 'method': 'paper', 'round': 1, 'coverage': 50.0, 'precision': 75.0
    }  # fmt: skip
    assert table.figure().startswith(b'\x89PNG')
    begun = (request.out / 'begun.txt').read_text().splitlines()
    assert len(begun) == 4
    pseudo_label_table(request, FAKE)
    assert (request.out / 'begun.txt').read_text().splitlines() == begun, 'finished runs are kept'


@pytest.mark.usefixtures('tiles')
def test_the_runs_are_those_of_the_table_of_propagation(tmp_path):
    request = asked(tmp_path, data=('oakland',))
    (scan, _) = real_scans(request)
    theirs = scan_rows(oakland_scans(tmp_path / 'oakland')[0], request.out / 'configs')
    for strategy, row in real_rows(scan, request).items():
        assert run_folder(request.out, row, 3) == run_folder(request.out, theirs[strategy], 3)


def test_synthetic_scenes_are_trained_with_both_strategies(tmp_path):
    request = asked(tmp_path, data=('streets',))
    for rows in synthetic_rows('streets').values():
        for row in rows.values():
            write_rounds(run_folder(request.out, row, 3), [(0.5, 0.75)])
    table = pseudo_label_table(request, FAKE)
    names = ['streets (synthetic), 0.2 % of the points', 'streets (synthetic), a point a class']
    assert [section.title for section in table.sections] == names
    folders = sorted(path.name for path in request.out.glob('*_seed3'))
    leaves = [f'rm3d_sem_semantickitti_{budget}' for budget in ('0p2pct', 'onept')]
    assert folders == [f'{leaf}{what}_seed3' for leaf in leaves for what in ('', '_strategy-paper')]
    assert len(synthetic_rows('rooms')) == 2


def test_without_data_it_says_so(tmp_path):
    with pytest.raises(ConfigError, match='nothing to train on: none of oakland, semantickitti is there'):
        pseudo_label_table(asked(tmp_path, data=('oakland', 'semantickitti')), FAKE)
