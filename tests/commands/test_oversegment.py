import base64
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from reference.rooms import make_room

from rm3d_plugin.commands.main import run as run_command
from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.inference.oversegment import SHIPPED, build_part, oversegment_file, read_annotated_labels
from rm3d_plugin.label_budgets import BudgetError
from rm3d_plugin.regions.prepare import prepare_scene
from rm3d_plugin.registry import DESCRIPTORS, OVERSEGMENTERS
from rm3d_plugin.storage import ClickFileError, read_npz
from rm3d_plugin.storage.ply import read_ply
from rm3d_plugin.storage.scans import read_cloud
from rm3d_plugin.structures import PointCloud
from rm3d_plugin.visualization.scene_view import MAX_POINTS

TOOL = Path(__file__).resolve().parents[2] / 'tools' / 'oversegment.py'


@pytest.fixture(scope='module')
def scan(tmp_path_factory):
    path = tmp_path_factory.mktemp('scan') / 'room.npy'
    np.save(path, make_room(density=150)[0])
    return path


def test_npz_and_ply_hold_every_point(scan, tmp_path):
    regions = oversegment_file(scan, tmp_path / 'r.npz', oversegmenter='VCCS', descriptor='SuperpointGraph')
    saved = read_npz(tmp_path / 'r.npz')
    np.testing.assert_array_equal(saved['labels'], regions.labels)
    np.testing.assert_array_equal(saved['xyz'], np.load(scan))
    options = {'seed_size': 1.0, 'voxel_size': 0.1}
    coarse = oversegment_file(scan, tmp_path / 'r.ply', 'SuperpointGraph', 'VCCS', oversegmenter_options=options)
    columns = read_ply(tmp_path / 'r.ply')
    np.testing.assert_array_equal(columns['region'], coarse.labels)
    np.testing.assert_array_equal(columns['x'], np.load(scan)[:, 0])
    colors = np.stack([columns[name] for name in ('red', 'green', 'blue')], axis=1)
    assert len(np.unique(colors[coarse.labels == 3], axis=0)) == 1
    assert 10 < len(coarse) < len(regions)


def test_world_coordinates_come_back(scan, tmp_path):
    world = np.load(scan).astype(np.float64) + [4e5, 5e6, 100]
    np.save(tmp_path / 'world.npy', world)
    oversegment_file(tmp_path / 'world.npy', tmp_path / 'r.ply', preset='indoor')
    columns = read_ply(tmp_path / 'r.ply')
    np.testing.assert_allclose(np.stack([columns[name] for name in 'xyz'], axis=1), world, atol=1e-6)


def test_lidar_preset_takes_the_ground_off(tmp_path):
    grid = np.stack(np.meshgrid(np.arange(3, 20, 0.4), np.arange(-8, 8, 0.4)), axis=-1).reshape(-1, 2)
    rng = np.random.default_rng(0)
    box = rng.uniform(0, 1, (600, 3)) * [0.1, 1.5, 1.5] + [8, 0, -1.2]
    points = np.concatenate([np.c_[grid, np.full(len(grid), -1.7)], box])
    np.c_[points, np.zeros(len(points))].astype('<f4').tofile(tmp_path / 'a.bin')
    regions = oversegment_file(tmp_path / 'a.bin', tmp_path / 'a.npz', preset='lidar')
    assert (regions.labels[: len(grid)] == -1).mean() > 0.95
    assert (regions.labels[len(grid) :] >= 0).mean() > 0.8


@pytest.mark.parametrize('preset', ['outdoor', 'airborne'])
def test_presets_of_shipped_configs(scan, tmp_path, preset):
    label_maker = load_config(SHIPPED[preset]).label_maker
    regions = oversegment_file(scan, tmp_path / 'r.npz', preset=preset)
    parts = DESCRIPTORS.build(label_maker.descriptor), OVERSEGMENTERS.build(label_maker.oversegmenter)
    expected = prepare_scene(PointCloud(np.load(scan)), *parts).regions
    np.testing.assert_array_equal(regions.labels, expected.labels)
    with pytest.raises(ConfigError, match=f"FPFH: preset: expected one of .'indoor', 'lidar'., got '{preset}'"):
        oversegment_file(scan, tmp_path / 'r.npz', 'FPFH', preset=preset)
    assert build_part(DESCRIPTORS, None, preset, {'radius': 3.0}).radius == 3.0


def test_html_is_complete_by_itself(scan, tmp_path):
    regions = oversegment_file(scan, tmp_path / 'r.html', preset='indoor')
    page = (tmp_path / 'r.html').read_text(encoding='utf-8')
    assert f'<h1>room.npy: {len(regions)} regions</h1>' in page and not re.search(r'https?:|src=', page)
    (scene,) = json.loads(re.search(r'id="view-data">(.*?)</script>', page, re.DOTALL)[1])['scenes']
    layer, *others = scene['layers']
    assert [other['name'] for other in others] == ['height'] and 'points are in no region: the ground' in page
    assert (layer['name'], layer['kind'], scene['total']) == ('region', 'number', len(regions.labels))
    drawn = np.frombuffer(base64.b64decode(layer['data']), '<u2').astype(int)
    step = -(-len(regions.labels) // MAX_POINTS)
    np.testing.assert_array_equal(np.where(drawn == 65535, -1, drawn), regions.labels[::step])
    assert page.count('<label hidden>') == 2  # neither truth to compare with nor annotated points


def test_a_missing_package_is_told(scan, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'cut_pursuit_py', None)
    with pytest.raises(ConfigError, match='pip install cut-pursuit-py'):
        oversegment_file(scan, tmp_path / 'r.npz', 'SuperpointGraph', 'CutPursuit')


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['--out', 'r.obj'], "unknown ending '.obj'; expected one of .ply .npz .html"),
        (['--out', 'r.ply', '--descriptor', 'PFG'], "got 'PFG'"),
        (['--out', 'r.ply', '--oversegmenter', 'SLIC'], 'RegionGrowing'),
        (['--out', 'r.ply', '--oversegmenter', 'VCCS', '--oversegmenter-options', 'seed=1'], 'VCCS: '),
        (['--out', 'r.ply', '--descriptor-options', 'radius=abc'], 'AdaptedPFH: a value of the wrong kind'),
        (['--out', 'r.ply', '--descriptor-options', 'radius=-1'], 'error: AdaptedPFH: expected radius > 0'),
        (['--out', 'r.ply', '--oversegmenter', 'VCCS', '--oversegmenter-options', 'seed_size=0.01'], 'seed_size >'),
    ],
)
def test_what_the_user_can_mend_is_one_message(scan, tmp_path, capsys, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert run_command('oversegment', [str(scan), *arguments]) == 2
    told = capsys.readouterr().err
    assert told.startswith('error: ') and message in told and not list(tmp_path.iterdir())


def test_command_line(scan, tmp_path):
    options = ['seed_size=0.8', 'voxel_size=0.1', 'distance=pcl']
    words = ['--descriptor', 'SuperpointGraph', '--oversegmenter', 'VCCS', '--oversegmenter-options', *options]
    done = run(scan, '--out', 'deep/r.npz', *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    labels = read_npz(tmp_path / 'deep' / 'r.npz')['labels']
    assert f'{labels.max() + 1} regions; {(labels < 0).sum()} of {len(labels)} points are in no region' in done.stdout


def test_a_missing_scan_is_named(tmp_path, capsys):
    assert run_command('oversegment', [str(tmp_path / 'none.ply'), '--out', str(tmp_path / 'r.ply')]) == 2
    assert 'none.ply: no such file' in capsys.readouterr().err
    with pytest.raises(SystemExit, match='0'):
        run_command('oversegment', ['--help'])
    assert '--oversegmenter-options' in capsys.readouterr().out


def run(*words, cwd):
    return subprocess.run([sys.executable, TOOL, *map(str, words)], cwd=cwd, capture_output=True, text=True, timeout=60)


def label_lines(scan, truth_of, scene='room', count=60):
    """A CSV of some points by their places, with names of classes."""
    xyz = np.load(scan)
    rows = np.random.default_rng(0).choice(len(xyz), count, replace=False)
    lines = ['scene,x,y,z,class']
    return (
        '\n'.join(lines + [f'{scene},{",".join(f"{v:.4f}" for v in xyz[i])},thing {truth_of[i]}' for i in rows]) + '\n'
    )


def test_tuned_by_a_few_labels(scan, tmp_path):
    truth = make_room(density=150)[1]
    (tmp_path / 'labels.csv').write_text(label_lines(scan, truth))
    told = []
    regions = oversegment_file(
        scan, tmp_path / 'r.npz', 'SuperpointGraph', tune=tmp_path / 'labels.csv', target_regions=30, log=told.append
    )
    assert 15 < len(regions) < 60
    assert told[0].startswith('labels.csv: zeta ') and f'{len(regions)} regions (aimed at 30)' in told[0]
    labelled = read_annotated_labels(tmp_path / 'labels.csv', read_cloud(scan), 'room')
    assert (labelled >= 0).sum() == 60
    known = np.flatnonzero(labelled >= 0)
    pairs = set(zip(labelled[known].tolist(), truth[known].tolist(), strict=True))
    assert len(pairs) == len(np.unique(truth[known]))  # one number for each name


def test_labels_that_cannot_tune(scan, tmp_path):
    labels = tmp_path / 'labels.csv'
    labels.write_text(label_lines(scan, make_room(density=150)[1], scene='hall'))
    with pytest.raises(BudgetError, match="labels no point of scene 'room'"):
        oversegment_file(scan, tmp_path / 'r.npz', 'SuperpointGraph', tune=labels)
    with pytest.raises(ConfigError, match="theta and zeta of RegionGrowing, got 'VCCS'"):
        oversegment_file(scan, tmp_path / 'r.npz', 'SuperpointGraph', 'VCCS', tune=labels)
    with pytest.raises(ClickFileError, match=r'no\.csv: no such file'):
        oversegment_file(scan, tmp_path / 'r.npz', 'SuperpointGraph', tune=tmp_path / 'no.csv')
    labels.write_text(label_lines(scan, make_room(density=150)[1]))
    with pytest.raises(ConfigError, match='tune: .* target >= 1'):
        oversegment_file(scan, tmp_path / 'r.npz', 'SuperpointGraph', tune=labels, target_regions=0)
