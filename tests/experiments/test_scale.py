"""Smaller tables for a given time, and all tables in one go; runs are faked, costs are made up."""

import pytest
from experiments.fake_commands import command

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments import TABLES, make_all, scale
from rm3d_plugin.experiments.runner import Commands
from rm3d_plugin.experiments.scale import (
    Cost,
    Scale,
    Size,
    choose_scale,
    cost_of,
    fitting,
    kind_of,
    ladder,
    needed_seconds,
    probe_row,
    scaled_table,
    seconds_of,
    size_of,
    sized,
)
from rm3d_plugin.experiments.spec import PaperTable, Part, Request, Row
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
    assert sized(STREETS, half)['periods'] == [12, 2, 2, 2, 2]  # ten rounds of two epochs
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
    rows = [ROOMS, Row('same run', ROOMS.config), Row('paper', ROOMS.config, {'strategy': 'paper'})]
    whole = 2 * 3 * (10 + 72 * (20 + 4 * 0.5))
    assert needed_seconds(rows, request, costs, Scale(1.0, 1.0, 3)) == whole
    assert fitting(rows, request, costs, whole) == Scale(1.0, 1.0, 3)
    assert fitting(rows, request, costs, whole - 1) == Scale(0.5, 1.0, 3)
    assert not told
    assert fitting(rows, request, costs, 1.0) == Scale(0.125, 0.25, 1) == ladder(3)[-1]
    assert 'the last tables may be left out' in told[0]


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
    assert choose_scale(part.rows, request, 20.0) == Scale(0.25, 0.5, 2)
    late = make_all(request, fake, -1.0, ('one',))
    assert 'not made: the -1 minutes were over' in late
