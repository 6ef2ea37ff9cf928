"""Smaller tables for a given time, and all tables in one go; runs are faked, costs are made up."""

from dataclasses import replace

import pytest
from experiments.fake_commands import command

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments import TABLES, make_all, scale
from rm3d_plugin.experiments.runner import Commands
from rm3d_plugin.experiments.scale import (
    Cost,
    Size,
    choose_scale,
    cost_of,
    fewer_rows,
    fitting,
    kind_of,
    ladder,
    needed_seconds,
    probe_row,
    scaled_request,
    scaled_table,
    seconds_of,
    size_of,
    sized,
    spread_rows,
)
from rm3d_plugin.experiments.spec import WHOLE, MeasuredTable, PaperTable, Part, Request, Row, Scale, Table
from rm3d_plugin.experiments.tables.pseudo_boxes import trained_row
from rm3d_plugin.experiments.tables.pseudo_label_rounds import synthetic_rows
from rm3d_plugin.experiments.tables.transfer import boxes_of, points_test

ROOMS, STREETS = Row('rooms', 'rm3d_sem_scannet_0p2pct'), Row('streets', 'rm3d_votenet_kitti_1pct')
OTHER = Row('other', 'rm3d_votenet_scannet_1pct', boxes_of('s3dis'))
TURNED = Row('turned', 'rm3d_sem_scannet_0p2pct', test=points_test('s3dis', 'scannet'))


def test_what_a_smaller_run_is():
    half = Scale(0.25, 0.5, 3)
    assert sized(ROOMS, Scale(1.0, 1.0, 1)) == {}
    assert sized(ROOMS, half) == {
        'demo_data.num_train': 18,
        'demo_data.num_val': 4,
        'data_root': 'data/scannet_rooms_x0.25',
        'sigma': 2,
        'periods': [8],
    }
    assert sized(STREETS, half)['periods'] == [28]  # fourteen rounds of two epochs
    assert sized(OTHER, half)['demo_data.rooms_per_area'] == 1
    assert size_of(ROOMS, Scale(1.0, 1.0, 1)) == Size(72, 20, 4)
    assert size_of(ROOMS, half) == Size(18, 8, 4)
    assert size_of(OTHER, half).scenes == 5
    table = scaled_table(PaperTable('T', (Part('P', (TURNED,), ('mIoU',), 'turned'),)), half)
    assert table.parts[0].rows[0].test['val_dataloader.dataset.data_root'] == 'data/s3dis_rooms_x0.25'
    assert table.notes == ('Smaller than the demo: 0.25 of the scenes, 0.5 of the epochs, 3 seeds.',)
    with pytest.raises(ConfigError, match='real data are as large as they are'):
        sized(Row('real', 'rm3d_sem_scannet_0p2pct', train=()), half)


def test_costs_by_hand():
    epochs = {str(number): {'wall': wall, 'round': 0} for number, wall in ((1, 9.0), (2, 4.0))}
    labels = {'0': {'wall': 7.0}, '1': {'wall': 2.0}}
    cost = cost_of('sem_scannet', {'epochs': epochs, 'labels': labels}, 30.0, 4)
    assert cost == Cost('sem_scannet', 30.0 - 13.0 - 9.0 + 5.0 + 5.0, 1.0, 0.5)
    assert seconds_of(cost, Size(10, 20, 3)) == 18.0 + 10 * (20 * 1.0 + 3 * 0.5)
    assert kind_of(ROOMS) == 'sem_scannet' and kind_of(Row('a', 'sup_sem_scannet_full')) == 'sem_scannet_full'
    assert kind_of(Row('a', 'viewpoint_bottleneck_votenet_kitti_1pct')) == 'votenet_kitti'
    tiny = probe_row(ROOMS)
    assert tiny.options['demo_data.num_train'] == 4 and tiny.options['sigma'] == 1 and tiny.options['periods'] == [4]


def test_the_first_rung_that_fits(tmp_path):
    told = []
    request, costs = Request(tmp_path, log=told.append), {'sem_scannet': Cost('sem_scannet', 10.0, 1.0, 0.5)}
    rows = (ROOMS, Row('same run', ROOMS.config), Row('paper', ROOMS.config, {'strategy': 'paper'}))
    tables = [PaperTable('T', (Part('P', rows, ('mIoU',), 'rooms'), Part('Q', (TURNED,), ('mIoU',), 'turned')))]
    each = 10 + 72 * (20 + 4 * 0.5)
    whole = 3 * (2 * each + 10)  # two trainings and a test, three seeds
    assert needed_seconds(tables, request, costs, WHOLE) == whole
    measured = MeasuredTable('M', lambda request: None, (ROOMS, Row('one', ROOMS.config, {'budget': 'onept'})))
    assert needed_seconds([*tables, measured], request, costs, WHOLE) == whole + each  # on one seed
    assert fitting(tables, request, costs, whole) == Scale(1.0, 1.0, 3)
    assert fitting(tables, request, costs, whole - 1) == Scale(0.5, 1.0, 3)
    smallest = 10 + 9 * (4 * 1.0 + 4 * 0.5)  # 9 rooms, 4 epochs, 4 times labels
    assert fitting(tables, request, costs, 3 * 2 * smallest) == Scale(0.125, 0.25, 3, 1)  # without the test
    assert fitting(tables, request, costs, 2 * smallest) == Scale(0.125, 0.25, 1, 1)
    assert not told
    assert fitting(tables, request, costs, 1.0) == Scale(0.125, 0.25, 1, 1, 3) == ladder(3)[-1]
    assert 'even the smallest takes' in told[0]


def test_fewer_rows_keep_what_differences_are_told_to():
    rows = tuple(Row(str(number), 'rm3d_sem_scannet_0p2pct', {'budget': number}) for number in range(9))
    assert [row.name for row in spread_rows(rows, {'6'}, 4)] == ['0', '4', '6', '8']
    assert spread_rows(rows, {'6'}, 20) == rows and [row.name for row in spread_rows(rows, {'6', '7'}, 1)] == ['6', '7']
    against = replace(rows[2], against='5')
    table = Table('T', (*rows[:2], against, *rows[3:]), {'mIoU': 'mIoU'}, reference='8')
    small = fewer_rows(table, Scale(rows=3))
    assert [row.name for row in small.rows] == ['0', '5', '8']
    first, others = Part('P', rows, ('mIoU',), '6'), tuple(replace(row, options={'seed': 1}) for row in rows)
    table = PaperTable('T', (first, replace(first, rows=others), replace(first, title='free', score=('IoU',))))
    told = scaled_table(table, Scale(1.0, 1.0, 1, 1, 3))
    assert [part.title for part in told.parts] == ['P', 'free']  # the same runs tell both
    assert [row.name for row in told.rows] == ['0', '6', '8'] * 2
    assert told.notes[0].endswith('1 of the scenes, 1 of the epochs, 1 seeds, 1 parts of a table, 3 rows of a part.')


def test_a_smaller_request(tmp_path):
    request = Request(tmp_path, seeds=(4, 5, 6), scenes=2, points=20000)
    small = scaled_request(request, Scale(0.125, 0.25, 2))
    assert (small.seeds, small.scenes, small.points, small.scale) == ((4, 5), 1, 3000, Scale(0.125, 0.25, 2))
    assert scaled_request(replace(request, scenes=8, points=None), Scale(0.5)).scenes == 4
    assert scaled_request(replace(request, points=None), Scale(0.5)).points is None


def test_measured_tables_train_smaller_runs(tmp_path):
    small = Request(tmp_path, scale=Scale(0.125, 0.25))
    assert trained_row(small).options['demo_data.num_train'] == 9
    rows = synthetic_rows('rooms', small.scale)
    assert {row.options['sigma'] for own in rows.values() for row in own.values()} == {1}


def test_all_tables_in_a_given_time(tmp_path, monkeypatch):
    part = Part('P', (ROOMS, Row('less', ROOMS.config, {'strategy': 'paper'})), ('mIoU',), 'rooms')
    monkeypatch.setitem(TABLES, 'one', PaperTable('One', (part,)))
    monkeypatch.setitem(TABLES, 'two', PaperTable('Two', (part,)))
    measured = []

    def costs(rows, request, commands):
        measured.append(len(rows))
        return {'sem_scannet': Cost('sem_scannet', 10.0, 1.0, 0.5)}

    monkeypatch.setattr(scale, 'measure_costs', costs)
    told, fake = [], Commands(lambda config: command('train', config))
    request = Request(tmp_path, seeds=(3, 4), log=told.append)
    text = make_all(request, fake, 20.0, ('one', 'two'))
    assert text == (tmp_path / 'all.md').read_text() and text.startswith('# Tables, ')
    assert '## one\n\nOne; mean of seeds 3, 4' in text and '## two' in text
    assert '| rooms | 3.5 (3.0 to 4.0) | - |' in text and '0.25 of the scenes' in text
    assert sum('training' in line for line in told) == 4  # the second table has the runs of the first
    again = make_all(request, fake, 20.0, ('one', 'two'))
    assert again == text and measured == [4]  # the scale is kept, nothing is trained or timed again
    assert sum('training' in line for line in told) == 4
    assert choose_scale([TABLES['one']], request, 20.0) == Scale(0.25, 0.5, 2)
