"""Synthetic ScanNet files, read back by a parser that shares nothing with the writer."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from rm3d_plugin.datasets.synthetic import make_scannet_rooms, scannet_writer
from rm3d_plugin.datasets.synthetic.rooms import make_room

SPACING = 0.12
TYPES = {'float': '<f4', 'uchar': 'u1', 'ushort': '<u2', 'int': '<i4'}


def read_ply(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices as a structured array and triangles of a binary ply."""
    data = path.read_bytes()
    end = data.index(b'end_header\n') + len(b'end_header\n')
    header = data[:end].decode('ascii').splitlines()
    assert header[:2] == ['ply', 'format binary_little_endian 1.0']
    counts = {line.split()[1]: int(line.split()[2]) for line in header if line.startswith('element')}
    columns = [(line.split()[2], TYPES[line.split()[1]]) for line in header if re.match(r'property (?!list)', line)]
    vertices = np.frombuffer(data, np.dtype(columns), counts['vertex'], end)
    assert 'property list uchar int vertex_indices' in header
    start = end + vertices.nbytes
    faces = np.frombuffer(data, np.dtype([('n', 'u1'), ('v', '<i4', 3)]), counts['face'], start)
    assert (faces['n'] == 3).all() and start + faces.nbytes == len(data)
    return vertices, faces['v']


@pytest.fixture(scope='module')
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp('scannet') / 'demo'
    return make_scannet_rooms(root, 2, 1, 1, seed=3, spacing=SPACING, progress=False)


def test_layout_and_lists(demo: Path) -> None:
    assert (demo / 'scannetv2_train.txt').read_text() == 'scene0000_00\nscene0001_00\n'
    assert (demo / 'scannetv2_val.txt').read_text() == 'scene0002_00\n'
    assert (demo / 'scannetv2_test.txt').read_text() == 'scene0003_00\n'
    assert sorted(p.name for p in (demo / 'scans').iterdir()) == ['scene0000_00', 'scene0001_00', 'scene0002_00']
    assert sorted(p.name for p in (demo / 'scans' / 'scene0001_00').iterdir()) == [
        'scene0001_00.aggregation.json', 'scene0001_00.txt', 'scene0001_00_vh_clean_2.0.010000.segs.json',
        'scene0001_00_vh_clean_2.labels.ply', 'scene0001_00_vh_clean_2.ply',
    ]  # fmt: skip
    hidden = demo / 'scans_test' / 'scene0003_00'
    assert sorted(p.name for p in hidden.iterdir()) == ['scene0003_00.txt', 'scene0003_00_vh_clean_2.ply']
    assert 'SYNTHETIC' in (demo / 'README.txt').read_text()
    assert json.loads((demo / 'demo.json').read_text())['synthetic'] is True


@pytest.mark.parametrize('number', [0, 1, 2])
def test_a_scene_reads_back_exactly(demo: Path, number: int) -> None:
    room = make_room(3, number, SPACING)
    name = f'scene{number:04d}_00'
    base = demo / 'scans' / name
    vertices, faces = read_ply(base / f'{name}_vh_clean_2.ply')
    np.testing.assert_array_equal(np.stack([vertices[k] for k in 'xyz'], axis=1), room.xyz)
    np.testing.assert_array_equal(np.stack([vertices[k] for k in ('red', 'green', 'blue')], axis=1), room.colors)
    np.testing.assert_array_equal(faces, room.faces)
    labelled, same = read_ply(base / f'{name}_vh_clean_2.labels.ply')
    np.testing.assert_array_equal(labelled['label'], room.nyu40)
    np.testing.assert_array_equal(same, room.faces)
    np.testing.assert_array_equal(labelled['x'], room.xyz[:, 0])


def label_map(demo: Path) -> dict[str, dict[str, str]]:
    lines = (demo / 'scannetv2-labels.combined.tsv').read_text().splitlines()
    keys = lines[0].split('\t')
    rows = [dict(zip(keys, line.split('\t'), strict=True)) for line in lines[1:]]
    assert [int(row['id']) for row in rows] == list(range(1, len(rows) + 1))
    return {row['raw_category']: row for row in rows}


@pytest.mark.parametrize('number', [0, 1, 2])
def test_instances_and_classes_from_segments_equal_the_room(demo: Path, number: int) -> None:
    room = make_room(3, number, SPACING)
    name = f'scene{number:04d}_00'
    base = demo / 'scans' / name
    content = json.loads((base / f'{name}_vh_clean_2.0.010000.segs.json').read_text())
    segments = np.array(content['segIndices'])
    assert content['sceneId'] == name and len(segments) == len(room)
    groups = json.loads((base / f'{name}.aggregation.json').read_text())['segGroups']
    assert [group['objectId'] for group in groups] == list(range(len(groups)))
    table = label_map(demo)
    instance, nyu40 = np.full(len(room), -1), np.zeros(len(room), dtype=int)
    for group in groups:
        members = np.isin(segments, group['segments'])
        assert (instance[members] == -1).all()
        instance[members] = group['objectId']
        nyu40[members] = int(table[group['label']]['nyu40id'])
    np.testing.assert_array_equal(nyu40, room.nyu40)
    # One to one between annotated things and groups; the rest is in no group.
    pairs = np.unique(np.stack([instance, room.instance])[:, room.nyu40 > 0], axis=1)
    assert pairs.shape[1] == len(groups) == len(np.unique(pairs[1]))
    np.testing.assert_array_equal(instance == -1, room.nyu40 == 0)


def test_the_axis_alignment_puts_the_floor_at_zero_and_walls_on_the_axes(demo: Path) -> None:
    room = make_room(3, 0, SPACING)
    text = (demo / 'scans' / 'scene0000_00' / 'scene0000_00.txt').read_text()
    numbers = re.search(r'^axisAlignment = (.*)$', text, re.MULTILINE)
    assert numbers is not None
    matrix = np.array([float(value) for value in numbers[1].split()]).reshape(4, 4)
    xyz = room.xyz.astype(float) @ matrix[:3, :3].T + matrix[:3, 3]
    assert np.quantile(np.abs(xyz[room.names == 'floor', 2]), 0.95) < 0.1  # some segments reach up furniture
    np.testing.assert_allclose(xyz, room.aligned, atol=1e-9)
    normals = np.abs(room.normals @ matrix[:3, :3].T)[room.names == 'wall']
    assert np.median(normals.max(axis=1)) > 0.999


def test_a_finished_demo_is_left_alone_and_a_broken_one_goes_on(demo: Path, tmp_path: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in demo.rglob('*') if path.is_file()}
    make_scannet_rooms(demo, 2, 1, 1, seed=3, spacing=SPACING, progress=False)
    assert before == {path: path.stat().st_mtime_ns for path in demo.rglob('*') if path.is_file()}

    root = tmp_path / 'broken'
    make_scannet_rooms(root, 1, 1, seed=3, spacing=SPACING, progress=False)
    mesh = root / 'scans' / 'scene0000_00' / 'scene0000_00_vh_clean_2.ply'
    kept, stamp = mesh.read_bytes(), mesh.stat().st_mtime_ns
    marker = json.loads((root / 'demo.json').read_text())
    (root / 'demo.json').write_text(json.dumps(marker | {'finished': False}))
    lost = root / 'scans' / 'scene0001_00'
    lost.rename(root / 'half')
    make_scannet_rooms(root, 1, 1, seed=3, spacing=SPACING, progress=False)
    assert lost.is_dir() and mesh.stat().st_mtime_ns == stamp
    make_scannet_rooms(root, 1, 0, seed=4, spacing=SPACING, progress=False)  # another seed: made afresh
    assert mesh.read_bytes() != kept and not lost.exists()


def test_two_processes_make_the_same_bytes(demo: Path, tmp_path: Path) -> None:
    other = make_scannet_rooms(tmp_path / 'demo', 2, 1, 1, seed=3, spacing=SPACING, workers=2, progress=False)
    for path in sorted(demo.rglob('*')):
        if path.is_file():
            assert (other / path.relative_to(demo)).read_bytes() == path.read_bytes(), path


def test_foreign_folders_and_bad_numbers_are_refused(tmp_path: Path) -> None:
    (tmp_path / 'scans').mkdir()
    with pytest.raises(ValueError, match='holds files but no demo.json'):
        make_scannet_rooms(tmp_path, 1, 0, progress=False)
    with pytest.raises(ValueError, match='expected rooms, got num_train=0'):
        make_scannet_rooms(tmp_path / 'x', 0, 0, progress=False)
    with pytest.raises(ValueError, match='workers: expected at least 1, got 0'):
        make_scannet_rooms(tmp_path / 'x', 1, 0, workers=0, progress=False)
    assert not (tmp_path / 'x').exists()


def test_the_label_map_knows_every_annotated_name() -> None:
    lines = scannet_writer.label_map_text().splitlines()
    rows = {line.split('\t')[1]: line.split('\t') for line in lines[1:]}
    assert rows['office chair'][4:] == ['5', 'chair'] and rows['refrigerator'][4:] == ['24', 'refridgerator']
    assert 'object' not in rows
