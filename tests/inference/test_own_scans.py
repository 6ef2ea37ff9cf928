"""Scans of one's own in UTM coordinates, without labels: clicks, training, a refresh, a report, predictions."""

import csv
import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from reference.toy_scenes import CLASSES, make_scene
from runs import tiny_runs

from rm3d_plugin.engine.hooks.run_record_hook import final_records, read_record
from rm3d_plugin.reporting.scores import final_text
from rm3d_plugin.storage import LabelStore, write_npz
from rm3d_plugin.storage.ply import write_ply
from rm3d_plugin.storage.scans import read_scan

CONFIG = Path(__file__).resolve().parents[2] / 'configs' / 'rm3d_sem_files_streets_clicks.py'
UTM = np.array([500_123.456789, 5_411_932.765432, 312.9])  # m
OPTIONS = {
    'class_names': list(CLASSES),
    'num_classes': len(CLASSES),
    'point_columns': ['rgb', 'shape', 'place'],
    'widths': [8, 16],
    'voxel_size': 0.2,
    'rounds': 2,
    'sigma': 6,
    'periods': [6, 6],
    'restart_weights': [1, 1],
    'val_rounds': 2,
    'threads': 1,
    'descriptor': {'_delete_': True, 'type': 'AdaptedPFH', 'radius': 0.15, 'max_neighbors': 16},
    'oversegmenter': {'_delete_': True, 'type': 'RegionGrowing', 'threshold': 0.9, 'max_edge': 0.25, 'min_region': 10},
}


def world(number: int) -> np.ndarray:
    return make_scene(number).cloud.xyz.astype(np.float64) + UTM + [100.0 * number, 0, 0]


def make_scans(folder: Path) -> Path:
    """Two rooms as .ply and .npz with float64 coordinates, and five clicks on each class of each."""
    (folder / 'scans').mkdir(parents=True)
    rows = []
    for number, name in enumerate(('a', 'b')):
        scene, xyz = make_scene(number), world(number)
        colors = np.round(scene.cloud.colors * 255).astype(np.uint8)
        if name == 'a':
            columns = {axis: xyz[:, i] for i, axis in enumerate('xyz')}
            columns |= {axis: colors[:, i] for i, axis in enumerate(('red', 'green', 'blue'))}
            write_ply(folder / 'scans' / 'a.ply', columns)
        else:
            write_npz(folder / 'scans' / 'b.npz', {'xyz': xyz, 'colors': colors})
        for label in range(len(CLASSES)):
            chosen = np.random.default_rng(label).choice(np.flatnonzero(scene.semantic == label), 5, replace=False)
            rows += [[name, *(f'{value:.4f}' for value in xyz[point]), CLASSES[label]] for point in chosen]
    with (folder / 'clicks.csv').open('w', newline='') as file:
        csv.writer(file).writerows([['scene', 'x', 'y', 'z', 'class'], *rows])
    return folder


def train(folder: Path) -> None:
    from mmengine.registry import init_default_scope

    from rm3d_plugin.engine.config import load_config
    from rm3d_plugin.engine.run import set_threads
    from rm3d_plugin.engine.run import train as train_config
    from rm3d_plugin.registry import SCOPE

    own = {
        'data_root': str(folder / 'scans'),
        'cache_dir': str(folder / 'geometry'),
        'budget.clicks': str(folder / 'clicks.csv'),
    }
    config = load_config(CONFIG, folder / 'run', options=OPTIONS | own)
    set_threads(1)
    init_default_scope(SCOPE)
    tiny_runs._skip_pretty_printing()
    train_config(config, False)


@pytest.fixture(scope='module')
def run(tmp_path_factory) -> tuple[Path, str]:
    folder = make_scans(tmp_path_factory.mktemp('own'))
    code, log = tiny_runs.run(folder / 'log.txt', partial(train, folder))
    assert code == 0, log
    return folder, log


def test_clicks_in_the_world_become_labels_of_the_scans(run):
    folder, log = run
    store = LabelStore(folder / 'run' / 'labels')
    assert store.rounds() == (0, 1) and '30 clicked points in 2 of 2 scenes' in log and 'Config:' not in log
    told = [int(store.read(name, 0).point_is_annotated.sum()) for name in ('a', 'b')]
    assert sum(told) == 24  # a fifth of the ten clicks of each class is kept back to judge the network
    for number, name in enumerate(('a', 'b')):
        truth = make_scene(number).semantic
        first, last = store.read(name, 0), store.read(name, 1)
        assert (first.semantic == truth)[first.point_is_annotated].all()
        assert last.point_is_annotated.sum() == 15 and (last.semantic == truth)[last.point_is_annotated].all()
        known = (last.semantic >= 0) & (truth >= 0)
        assert known.mean() > 0.5 and (last.semantic == truth)[known].mean() > 0.9
        assert last.coverage > 0.95 * first.coverage


def test_the_report_needs_no_truth(run):
    page = (run[0] / 'run' / 'report.html').read_text()
    assert 'Pseudo labels' in page and 'Labels / training' in page
    assert not re.search(r'"name": ?"(truth|errors)"', page)


def test_agreement_with_its_own_labels_is_no_score(run):
    page, record = (run[0] / 'run' / 'report.html').read_text(), read_record(run[0] / 'run')
    assert '>about ' in page and 'of your clicks' in page and not re.search(r'>(m?IoU|correct points)<', page)
    assert list(record['final']) == ['agreement_not_accuracy'] and not re.search(
        r'mIoU|correct points', re.sub(r'about .* mIoU, from \d+ of your clicks', '', run[1])
    )
    assert final_text(final_records(record), {}).splitlines()[1].endswith('not accuracy')


def test_predictions_lie_where_the_scans_do(run, tmp_path):
    from rm3d_plugin.inference.predict import predict_files
    from rm3d_plugin.inference.predict_points import PointOptions

    pytest.importorskip('laspy')
    (checkpoint,) = (run[0] / 'run').glob('epoch_12.pth')
    for kind, error in (('ply', 1e-6), ('npz', 1e-6), ('las', 1e-4)):
        files = list(predict_files(checkpoint, [run[0] / 'scans'], tmp_path, options=PointOptions(format=kind)))
        for number, path in enumerate(files):
            found = read_scan(path, labels=True)
            there = found.cloud.xyz.astype(np.float64) + found.cloud.origin
            np.testing.assert_allclose(there, world(number), atol=error, rtol=0)
            truth = make_scene(number).semantic
            assert (found.label == truth)[truth >= 0].mean() > 0.7
