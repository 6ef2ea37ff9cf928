"""Synthetic S3DIS files, read back by plain numpy."""

from pathlib import Path

import numpy as np
import pytest

from rm3d_plugin.datasets.synthetic import make_s3dis_rooms, s3dis_writer
from rm3d_plugin.datasets.synthetic.room_things import CATEGORIES, S3DIS_CLASSES
from rm3d_plugin.datasets.synthetic.rooms import make_room

SPACING = 0.15


@pytest.fixture(scope='module')
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_s3dis_rooms(tmp_path_factory.mktemp('s3dis') / 'demo', 1, seed=2, spacing=SPACING, progress=False)


def test_six_areas_of_rooms(demo: Path) -> None:
    areas = sorted(path.name for path in demo.iterdir() if path.is_dir())
    assert areas == [f'Area_{k}' for k in range(1, 7)]
    rooms = [next((demo / area).iterdir()).name for area in areas]
    assert rooms == ['office_1', 'conferenceRoom_1', 'lounge_1', 'hallway_1', 'office_1', 'openspace_1']
    for area, room in zip(areas, rooms, strict=True):
        assert (demo / area / room / f'{room}.txt').is_file()
    names = [path.stem.rsplit('_', 1)[0] for path in demo.rglob('Annotations/*.txt')]
    assert set(names) <= set(S3DIS_CLASSES) and {'ceiling', 'floor', 'wall', 'door', 'table', 'chair'} <= set(names)


def test_a_room_reads_back_exactly(demo: Path) -> None:
    room = make_room(2, 0, SPACING, 'office', 'tripod', structure=0.6)
    base = demo / 'Area_1' / 'office_1'
    whole = np.loadtxt(base / 'office_1.txt')
    assert whole.shape == (len(room), 6)
    np.testing.assert_allclose(whole[:, :3] - [-20, -30, 0], room.aligned, atol=6e-4)
    np.testing.assert_array_equal(whole[:, 3:], room.colors)
    rows = {}
    for number, line in enumerate((base / 'office_1.txt').read_text().splitlines()):
        rows.setdefault(line, []).append(number)
    assert all(len(numbers) == 1 for numbers in rows.values())
    thing, kind, files = np.full(len(room), -1), np.full(len(room), '', dtype='U16'), 0
    for path in sorted((base / 'Annotations').glob('*.txt')):
        members = [rows[line][0] for line in path.read_text().splitlines()]
        assert (thing[members] == -1).all()
        thing[members], kind[members] = files, path.stem.rsplit('_', 1)[0]
        files += 1
    np.testing.assert_array_equal(kind, room.s3dis)
    pairs = np.unique(np.stack([thing, room.instance]), axis=1)
    assert pairs.shape[1] == files == len(room.things)


def test_names_are_numbered_by_type() -> None:
    assert s3dis_writer.room_names(0, 6) == [
        'office_1', 'conferenceRoom_1', 'lounge_1', 'hallway_1', 'office_2', 'openspace_1'
    ]  # fmt: skip
    assert s3dis_writer.room_names(4, 2) == ['office_1', 'openspace_1']


def test_lines() -> None:
    lines = s3dis_writer.point_lines(np.array([[1.23456, -2.0, 0.0004]]), np.array([[0, 128, 255]]))
    assert lines == ['1.235 -2.000 0.000 0 128 255\n']
    assert s3dis_writer.point_lines(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)) == []


def test_finished_and_foreign_folders(demo: Path, tmp_path: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in demo.rglob('*') if path.is_file()}
    make_s3dis_rooms(demo, 1, seed=2, spacing=SPACING, progress=False)
    assert before == {path: path.stat().st_mtime_ns for path in demo.rglob('*') if path.is_file()}
    (tmp_path / 'mine.txt').write_text('x')
    with pytest.raises(ValueError, match='holds files but no demo.json'):
        make_s3dis_rooms(tmp_path, 1, progress=False)
    with pytest.raises(ValueError, match='rooms_per_area: expected at least 1, got 0'):
        make_s3dis_rooms(tmp_path / 'x', 0, progress=False)


def test_every_class_of_s3dis_can_be_named() -> None:
    assert {item.s3dis for item in CATEGORIES.values()} == set(S3DIS_CLASSES)
