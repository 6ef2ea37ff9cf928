"""Which scans label propagation takes, and how regions alone are scored."""

import numpy as np
import pytest
from experiments.fake_commands import command
from mmengine.registry import init_default_scope

from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.experiments.render import to_markdown
from rm3d_plugin.experiments.run_commands import config_path
from rm3d_plugin.experiments.runner import Commands
from rm3d_plugin.experiments.spec import Request
from rm3d_plugin.experiments.tables import propagation
from rm3d_plugin.experiments.tables.propagation import (
    Scan,
    labels_alone,
    oakland_scans,
    propagation_table,
    semantickitti_scans,
    write_leaf,
)
from rm3d_plugin.registry import SCOPE
from rm3d_plugin.storage import LabelStore
from rm3d_plugin.structures import Boxes3D, PseudoLabels


def test_every_tile_and_every_scan_is_taken_by_itself(tmp_path):
    for name in ('oakland_part2_ac', 'oakland_part3_ao'):
        (tmp_path / f'{name}.xyz_label_conf').touch()
    assert [scan.options['train_tiles'] for scan in oakland_scans(tmp_path)] == [['part2_ac'], ['part3_ao']]
    for sequence, number, remission in (('01', '000001', 0.0), ('01', '000000', 0.3), ('99', '000700', 0.0)):
        folder = tmp_path / 'kitti' / 'sequences' / sequence
        for part in ('velodyne', 'labels'):
            (folder / part).mkdir(parents=True, exist_ok=True)
        np.array([[float(number), 0, 0, remission]], dtype='<f4').tofile(folder / 'velodyne' / f'{number}.bin')
        (folder / 'labels' / f'{number}.label').write_text(f'{sequence} {number}')
    scans = semantickitti_scans(tmp_path / 'kitti', tmp_path / 'out')
    assert [scan.name for scan in scans] == [
        f'SemanticKITTI {name}' for name in ('01/000000', '01/000001', '99/000700')
    ]
    alone = tmp_path / 'out' / '01_000001' / 'sequences' / '00'
    assert np.fromfile(alone / 'velodyne' / '000001.bin', dtype='<f4').tolist() == [1, 0, 0, 0]
    assert (alone / 'labels' / '000001.label').read_text() == '01 000001'
    assert len(list(alone.glob('*/*'))) == 2 and scans[1].options['val_sequences'] == [0]
    assert [scan.options.get('use_intensity', False) for scan in scans] == [True, False, False]


def test_every_scan_gets_the_settings_of_own_scans(tmp_path):
    own = load_config(config_path('rm3d_sem_files_streets_clicks'), tmp_path)
    for name, data in (('rm3d_sem_oakland_1pct', 'Oakland'), ('rm3d_sem_semantickitti_few_1pct', 'SemanticKitti')):
        leaf = write_leaf(Scan(f'A scan/{data}', name, {'threads': 1}), tmp_path)
        assert leaf.name == f'a_scan_{data.lower()}.py'
        config = load_config(leaf, tmp_path)
        for key in ('sigma', 'voxel_size', 'propagation', 'region_prior', 'ground', 'train_pipeline', 'point_columns'):
            assert config[key] == own[key]
        assert config.oversegmenter.rest == own.oversegmenter.rest
        dataset = config.val_dataloader.dataset
        assert dataset.type == f'{data}Dataset' and dataset.pipeline == own.val_dataloader.dataset.pipeline
        assert config.budget == '20pts_class' and config.voxel_downsample is None
        assert [metric.keep_labels for metric in config.val_evaluator if 'prefix' not in metric] == [True]


def test_what_needs_no_network_is_scored_on_hidden_points(tmp_path):
    """Ten points a metre apart: 0 and 9 are annotated, a region passes the first to 1 .. 4; the truth changes at 6."""
    rows = np.arange(10)
    tile = tmp_path / 'oakland_a.xyz_label_conf'
    ids = np.where(rows < 6, 1200, 1501)  # ground, vehicle
    tile.write_text(''.join(f'{x} 0 0 {label} 1\n' for x, label in zip(rows, ids, strict=True)))
    options = {'data_root': str(tmp_path), 'val_tiles': ['a'], 'threads': 1, 'cache_dir': str(tmp_path / 'cache')}
    init_default_scope(SCOPE)
    config = load_config(write_leaf(Scan('a', 'rm3d_sem_oakland_1pct', options), tmp_path), tmp_path / 'run')
    store, paper = LabelStore(tmp_path / 'run' / 'labels'), LabelStore(tmp_path / 'paper' / 'labels')
    semantic = np.where(rows < 5, 3, np.where(rows == 9, 5, -1))
    nobody, true = np.full(10, -1), (rows == 0) | (rows == 9)
    for number, last in (
        (0, semantic),
        (1, np.where(rows == 6, 5, semantic)),
    ):  # the next round finds that 6 is a vehicle
        store.begin_round(number)
        sure = (last >= 0).astype(np.float32)
        store.write(number, 'a', PseudoLabels(last, nobody, true, sure, Boxes3D.empty(), true[:0]))
        store.finish_round(number)
    paper.begin_round(0)
    paper.write(0, 'a', PseudoLabels(semantic, nobody, true, (semantic >= 0) * 1.0, Boxes3D.empty(), true[:0]))
    paper.finish_round(0)
    got = labels_alone(config, tmp_path / 'run', tmp_path / 'paper')
    assert got['paper_filled'] == got['paper_first'] == got['first_filled']
    assert all(0 <= got[name] <= 100 for name in ('walker', 'solver'))
    assert got['nearest'] == pytest.approx(100 * (4 / 5 + 3 / 4) / 2)  # 5 is nearer to 9: taken for a vehicle
    assert got['first'] == pytest.approx(100 * (4 / 5 + 0) / 2)
    assert got['first_filled'] == pytest.approx(100 * (5 / 6 + 2 / 3) / 2)  # 6 is nearer to 4 than to 9
    assert got['rm3d_filled'] == pytest.approx(100.0)


def test_a_row_a_scan_and_their_mean(tmp_path, monkeypatch):
    for name in ('a', 'b'):
        (tmp_path / 'oakland' / f'oakland_{name}.xyz_label_conf').parent.mkdir(exist_ok=True)
        (tmp_path / 'oakland' / f'oakland_{name}.xyz_label_conf').touch()
    alone = {'nearest': 10.0, 'walker': 12.0, 'solver': 15.0, 'paper_first': 18.0, 'first': 20.0, 'first_filled': 30.0}
    alone |= {'paper_filled': 70.0, 'rm3d_filled': 80.0}
    monkeypatch.setattr(propagation, 'labels_alone', lambda config, folder, paper: alone)
    request = Request(tmp_path / 'out', seed=3, data_root=tmp_path, scenes=5, options=('threads=1',))
    table = propagation_table(request, Commands(lambda config: command('train', config)))
    lines = to_markdown(table).splitlines()
    assert lines[0].endswith('at most 20 labelled points a class, seed 3')
    assert lines[-3:] == [
        f'| {name} | 3.0 | 10.0 | 12.0 | 15.0 | 18.0 | 6.0 | 3.0 | 70.0 | 20.0 | 30.0 | 6.0 | 3.0 | 80.0 |'
        for name in ('Oakland a', 'Oakland b', 'mean')
    ]
    rows = [line for line in lines[4:] if line.startswith('|')][:10]
    assert rows[0] == '| method | network alone | labels, the rest as the run says | labels, the rest as the nearest |'
    assert rows[2:5] == [
        '| nearest labelled point | - | - | 10.0 |',
        '| plain random walker | - | - | 12.0 |',
        '| rm3d label | - | - | 15.0 |',
    ]
    assert rows[-4:] == [
        '| RM3D as in the paper, round 0 | - | - | 18.0 |',
        '| RM3D as in the paper | 6.0 | 3.0 | 70.0 |',
        '| RM3D, round 0 | - | - | 30.0 |',
        '| RM3D | 6.0 | 3.0 | 80.0 |',
    ]
    assert table.records[0] == {'scan': 'Oakland a', 'seed': 3, 'labelled_only': 3.0, **alone} | {
        'paper': 3.0, 'paper_network': 6.0, 'network': 6.0, 'rm3d': 3.0
    }  # fmt: skip
    assert table.figure().startswith(b'\x89PNG')
    folders = sorted(path.name for path in (tmp_path / 'out').glob('*_seed3'))
    assert folders == [
        f'oakland_{name}{what}_seed3'
        for name in ('a', 'b')
        for what in ('_label_refreshes-1_propagate-False', '', '_strategy-paper')
    ]


def test_without_real_scans_it_says_where_it_looked(tmp_path):
    with pytest.raises(ConfigError, match=r'no oakland/\*\.xyz_label_conf'):
        propagation_table(Request(tmp_path / 'out', data_root=tmp_path))
