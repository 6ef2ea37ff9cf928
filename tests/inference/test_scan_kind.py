"""The kind of a scan: a room, a street and a tile from the air that are made here, and real ones where they are."""

import os
from pathlib import Path

import numpy as np
import pytest
from reference.toy_scenes import make_scene

from rm3d_plugin.datasets.synthetic import make_streets
from rm3d_plugin.inference.scan_kind import plan_evenness, scan_kind, share_covered
from rm3d_plugin.storage.scans import read_cloud
from rm3d_plugin.structures import PointCloud

REAL = Path(os.environ.get('RM3D_REAL_DATA', Path(__file__).resolve().parents[3] / 'shared' / 'data'))
EXPECTED = {
    'oakland/*.xyz_label_conf': ('streets', 13),
    'semantickitti/sequences/*/velodyne/*.bin': ('streets', 6),
    'kitti/training/velodyne/*.bin': ('streets', 12),
    'las/*.laz': ('airborne', 1),
}


def read(path):
    if path.suffix == '.xyz_label_conf':
        return PointCloud(np.loadtxt(path, comments='#', usecols=(0, 1, 2)))
    if path.suffix == '.laz':
        pytest.importorskip('laspy')
    return read_cloud(path)


@pytest.mark.parametrize('pattern', EXPECTED)
def test_real_scans(pattern):
    paths = sorted(REAL.glob(pattern))
    if not paths:
        pytest.skip(f'no {pattern} in {REAL}; RM3D_REAL_DATA names the folder')
    kind, count = EXPECTED[pattern]
    found = [scan_kind(read(path)) for path in paths]
    print(
        *(
            f'{path.name}: {each.text()}; {each.covered:.2f} under one level'
            for path, each in zip(paths, found, strict=True)
        ),
        sep='\n',
    )
    assert [each.kind for each in found] == [kind] * count
    assert max(each.covered for each in found) < 0.2


def test_a_room():
    found = scan_kind(make_scene(0).cloud)
    assert found.kind == 'rooms'
    assert found.text() == f'rooms: the scan is {found.length:.0f} m long, up to 25 m are'


def test_a_street(tmp_path):
    make_streets(tmp_path, num_train=1, num_val=0, seed=1, azimuth_step=1.0, progress=False)
    (path,) = tmp_path.rglob('velodyne/*.bin')
    found = scan_kind(read_cloud(path))
    assert found.kind == 'streets' and found.evenness < 0.4
    assert found.text().endswith('from the air it is 0.65 up')


def aerial(rng, size=60.0, count=20000):
    """Ground, a roof 8 m high, and trees with several returns of a pulse."""
    xyz = rng.uniform(0, size, (count, 3))
    xyz[:, 2] = np.where((np.abs(xyz[:, :2] - size / 3) < 8).all(axis=1), 8.0, rng.normal(0, 0.03, count))
    tree = np.linalg.norm(xyz[:, :2] - size * 2 / 3, axis=1) < 10
    crown = np.repeat(xyz[tree], 2, axis=0)
    crown[:, 2] = rng.uniform(2, 12, len(crown))
    return np.concatenate([xyz, crown])


def test_a_tile_from_the_air():
    found = scan_kind(PointCloud(aerial(np.random.default_rng(0))))
    assert found.kind == 'airborne' and found.evenness > 0.65
    assert found.text().startswith('airborne: points are spread over the plan with an evenness of ')


def storey(rng, height, holes=0.0, count=40000):
    """Floor, ceiling and walls of 40 m by 15 m."""
    xyz = rng.uniform(0, 1, (count, 3)) * [40, 15, 0]
    part = rng.integers(0, 3, count)
    xyz[part == 1, 2] = height
    wall = part == 2
    xyz[wall, 0] = rng.choice(np.arange(0, 41, 5.0), wall.sum())
    xyz[wall, 2] = rng.uniform(0, height, wall.sum())
    return xyz[~((part == 1) & (rng.random(count) < holes)) & ~((part > 0) & (xyz[:, 0] < 40 * holes))]


@pytest.mark.parametrize('height', [2.5, 6.0])
def test_a_storey_is_indoors_however_long_it_is(height):
    found = scan_kind(PointCloud(storey(np.random.default_rng(0), height)))
    assert found.kind == 'rooms' and found.length > 25 and found.covered > 0.9
    assert found.text().endswith('% of the plan lies under one ceiling, from 50 % on')


def test_an_open_yard_is_not_indoors():
    open_roof = storey(np.random.default_rng(0), 3.0, holes=0.7)
    assert scan_kind(PointCloud(open_roof)).kind != 'rooms'
    low, high = np.zeros(2), np.full(2, 60.0)
    assert share_covered(aerial(np.random.default_rng(0)), low, high) == 0
    assert share_covered(storey(np.random.default_rng(0), 12.0), low, high) == 0, 'too high for a ceiling'
    assert share_covered(np.zeros((1, 3)), low, high) == 0


def test_strays_and_the_place_of_a_scan_change_nothing():
    xyz = aerial(np.random.default_rng(0))
    stray = np.array([[5e3, -5e3, 400.0]])
    alone, far = scan_kind(PointCloud(xyz)), scan_kind(PointCloud(np.concatenate([xyz - 30.0, stray])))
    assert far.kind == alone.kind
    np.testing.assert_allclose(far[1:], alone[1:], rtol=0.02)


def test_evenness_against_counts_by_hand():
    """Squares of 4 m, since 128 points on 8 x 8 m are 32 on each: 62, 64, 1 and 1 points are there."""
    corners = np.array([[0.0, 0.0], [8.0, 8.0]])
    rest = np.repeat([[1.0, 1.0], [5.0, 1.0], [1.0, 5.0]], [61, 64, 1], axis=0)
    counts = np.array([62, 64, 1, 1])
    expected = counts.sum() ** 2 / (4 * np.square(counts).sum())
    # the corner at 8 m is a square of its own at its edge, as if it lay in the fourth
    assert plan_evenness(np.concatenate([corners, rest]), corners[0], corners[1]) == pytest.approx(expected)


def test_one_point_and_a_line_are_rooms():
    assert scan_kind(PointCloud(np.zeros((1, 3)))).kind == 'rooms'
    line = np.zeros((100, 3))
    line[:, 0] = np.linspace(0, 5, 100)
    assert scan_kind(PointCloud(line)).kind == 'rooms'
