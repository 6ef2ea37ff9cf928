"""Synthetic streets: ray casting against a slow twin, labels that fit their points, and bytes that never change."""

import hashlib
import json
import os
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from rm3d_plugin.datasets import kitti_format as kf
from rm3d_plugin.datasets.synthetic import kitti_writer, make_streets, road_users, shapes, streets
from rm3d_plugin.datasets.synthetic.lidar import SpinningLidar, cast, count_hits, directions, make_beams, scan

COARSE = SpinningLidar(azimuth_step=2.0)
SCAN_HASH = '1cfdab02d91c41aa6b50022a75aeef64678a79f361c33884ee51ebe15d298ffa'
LABEL_HASH = 'be80bf4ea5eb048ea2499f193faa5fac314a49e6b4b461d7e7713831c0882519'
QUIET = SpinningLidar(azimuth_step=2.0, range_noise=0.0, lost=0.0, mixed=0.0, hidden=0.0)


QUIET_FINE = SpinningLidar(azimuth_step=0.1, range_noise=0.0, lost=0.0, mixed=0.0, hidden=0.0)
FLAT = streets.Road(5.0, -5.0, 3.0, 0.0, 0.0, 0.0, (0.0, 0.2, 0.0), False, False)


def first_hits(corners: np.ndarray, rays: np.ndarray, max_range: float) -> tuple[np.ndarray, np.ndarray]:
    """Slow twin: every ray against every triangle (Moeller and Trumbore)."""
    best, owner = np.full(len(rays), max_range), np.full(len(rays), -1)
    for number, (a, b, c) in enumerate(corners):
        e1, e2 = b - a, c - a
        p = np.cross(rays, e2)
        det = p @ e1
        with np.errstate(divide='ignore', invalid='ignore'):
            u = (p @ -a) / det
            q = np.cross(-a, e1)
            v = (rays @ q) / det
            t = (q @ e2) / det
        hit = (np.abs(det) > 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < best)
        best[hit], owner[hit] = t[hit], number
    return owner, np.where(owner >= 0, best, np.inf)


@pytest.mark.parametrize('spread', [0.6, 6.0, 40.0])
def test_casting_equals_the_slow_twin(spread: float) -> None:
    rng = np.random.default_rng(3)
    centers = rng.uniform(-25, 25, (250, 1, 3)) * np.array([1, 1, 0.15])
    corners = centers + rng.uniform(-1, 1, (250, 3, 3)) * spread * np.array([1, 1, 0.3])
    beams = make_beams(COARSE)
    owner, distance = first_hits(corners, directions(beams), 80.0)
    hits = cast(corners, beams)
    assert (owner >= 0).sum() > 50
    np.testing.assert_array_equal(hits.triangle, owner)
    np.testing.assert_allclose(hits.distance, distance, rtol=1e-9)


def test_nothing_slips_between_triangles_and_ties_go_to_the_lowest() -> None:
    # The sensor in a closed room of 8 x 6 x 4 m: every beam meets a wall, at the distance that the room says.
    room = shapes.box((0, 0, 0), (8, 6, 4), 0.5).corners
    for step in (0.35, 2.0, 7 / 11):
        beams = make_beams(SpinningLidar(azimuth_step=step))
        rays = directions(beams)
        with np.errstate(divide='ignore'):
            expected = np.min(np.array([4.0, 3.0, 2.0]) / np.abs(rays), axis=1)
        hits = cast(np.concatenate([room, room]), beams)
        np.testing.assert_allclose(hits.distance, expected, rtol=1e-9)
        assert hits.triangle.max() < len(room)


def test_triangles_around_the_axis_and_degenerate_ones() -> None:
    beams = make_beams(COARSE)
    floor = np.array([[[-60.0, -60, -2], [120, 0, -2], [-60, 60, -2]]])
    hits = cast(floor, beams, max_range=20.0)
    down = directions(beams)[:, 2]
    np.testing.assert_array_equal(hits.triangle >= 0, (down < 0) & (2 / np.maximum(-down, 1e-9) < 20))
    line = np.array([[[5.0, 0, -1], [5, 0, -1], [5, 0, 0]], [[0, 0, 0], [0, 0, 0], [0, 0, 0]]])
    assert (cast(line, beams).triangle == -1).all()
    assert (cast(np.zeros((0, 3, 3)), beams).triangle == -1).all()
    assert count_hits(floor, beams, 20.0) == (hits.triangle >= 0).sum()


def wall(reflectance: float, dropout: float = 0.0) -> shapes.Mesh:
    return shapes.quads(np.array([[[10.0, -50, -5], [10, 50, -5], [10, 50, 5], [10, -50, 5]]]), reflectance, dropout)


def test_scan_without_noise_lies_on_the_wall() -> None:
    mesh = wall(0.5)
    returned = scan(mesh, cast(mesh.corners, make_beams(QUIET)), QUIET, np.random.default_rng(0))
    assert len(returned.xyz) > 1000
    np.testing.assert_allclose(returned.xyz[:, 0], 10, atol=6e-4)
    np.testing.assert_array_equal(returned.xyz, np.round(returned.xyz, 3))
    assert returned.intensity.min() >= 0 and returned.intensity.max() <= 0.99


def test_noise_and_lost_returns_have_the_asked_size() -> None:
    sensor = SpinningLidar(azimuth_step=0.35, range_noise=0.02, lost=0.1, mixed=0.0, hidden=0.0)
    mesh = wall(0.9)
    hits = cast(mesh.corners, make_beams(sensor))
    straight = directions(make_beams(sensor))[:, 0] > 0.7  # grazing returns are lost more often
    returned = scan(mesh, hits, sensor, np.random.default_rng(0))
    reach = np.sqrt((returned.xyz**2).sum(axis=1))
    off = (reach - 10 * reach / returned.xyz[:, 0])[returned.xyz[:, 0] / reach > 0.7]
    assert abs(off.mean()) < 0.002 and abs(off.std() - 0.02) < 0.002
    assert abs(len(off) / ((hits.triangle >= 0) & straight).sum() - 0.9) < 0.02
    glass = scan(wall(0.9, dropout=0.85), hits, sensor, np.random.default_rng(0))
    assert abs(len(glass.xyz) / len(returned.xyz) - 0.15) < 0.02


def test_the_sensor_is_checked() -> None:
    assert len(SpinningLidar().azimuths) * len(SpinningLidar().elevations) == 1029 * 64
    np.testing.assert_allclose(SpinningLidar().elevations[[0, -1]], [2, -24.8])
    with pytest.raises(ValueError, match='azimuth_step: expected 0.02 to 5 degrees, got 0'):
        SpinningLidar(azimuth_step=0)


@pytest.mark.parametrize('kind', ['sedan', 'hatchback', 'suv', 'van', 'pedestrian', 'sitting_person', 'cyclist'])
def test_road_users_fill_their_boxes(kind: str) -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        maker = getattr(road_users, kind, None)
        user = maker(rng) if maker else road_users.car(rng, kind)
        low, high = user.mesh.bounds
        length, width, height = user.size
        bounds = np.array([length / 2, width / 2, height])
        assert (low >= [-bounds[0] - 0.006, -bounds[1] - 0.006, -1e-6]).all() and (high <= bounds + 0.006).all()
        assert high[2] - low[2] > height - 0.06
        if maker is None:
            np.testing.assert_allclose(high - low, user.size, atol=0.011)
            assert (user.mesh.dropout > 0).any()
        assert user.size == tuple(round(v, 2) for v in user.size)


@pytest.fixture(scope='module')
def frames() -> list[kitti_writer.Frame]:
    return [kitti_writer.make_frame(0, number, SpinningLidar(azimuth_step=0.7)) for number in range(14)]


def test_every_label_holds_points_and_stays_in_the_image(frames: list[kitti_writer.Frame]) -> None:
    for frame in frames:
        rect = kf.transform(frame.points[:, :3], frame.calib.rect_from_lidar)
        for item in frame.objects:
            left, top, right, bottom = item.bbox
            assert 0 <= left < right <= kf.IMAGE_SIZE[0] - 1 and 0 <= top < bottom <= kf.IMAGE_SIZE[1] - 1
            if item.type == 'DontCare':
                continue
            assert kitti_writer.count_inside(item, rect) >= 1
            assert 0 <= item.truncated <= 0.95 and item.occluded in (0, 1, 2, 3)
            for name in ('h', 'w', 'l', 'x', 'y', 'z', 'ry'):
                assert getattr(item, name) == round(getattr(item, name), 2)
            assert item.alpha == pytest.approx(kf.observation_angle(item.x, item.z, item.ry))


def test_what_kitti_asks_for_is_there(frames: list[kitti_writer.Frame]) -> None:
    kinds = Counter(item.type for frame in frames for item in frame.objects)
    total = sum(kinds.values())
    assert (kinds['Car'] + kinds['Van']) / total == pytest.approx(0.5, abs=0.15)
    assert kinds['Pedestrian'] / total == pytest.approx(0.28, abs=0.12)
    assert kinds['Cyclist'] / total == pytest.approx(0.22, abs=0.12)
    assert {item.occluded for frame in frames for item in frame.objects} >= {0, 1, 2}
    assert 4 <= total / len(frames) <= 12
    assert any(item.truncated > 0.1 for frame in frames for item in frame.objects)


def test_boxes_fit_the_points_of_their_objects() -> None:
    # Without noise each point of a labelled thing lies in the box that its label's decimals say, to a centimetre.
    calib = kitti_writer.demo_calib()

    def snap(user: road_users.RoadUser, x: float, y: float, z: float, yaw: float) -> tuple[np.ndarray, float]:
        return kitti_writer.snap_pose(calib, x, y, z, yaw)

    rng = np.random.default_rng(2)
    for kind in ('sedan', 'van'):
        user = road_users.car(rng, kind)
        bottom, yaw = snap(user, 12.3456, -3.21987, -1.7, 0.77123)
        assert np.abs(bottom - [12.3456, -3.21987, -1.7]).max() < 0.0101 and abs(yaw - 0.77123) < 0.0051
        mesh = user.mesh.moved(bottom, yaw)
        returned = scan(mesh, cast(mesh.corners, make_beams(QUIET)), QUIET, rng)
        x, y, z = kf.transform(bottom, calib.rect_from_lidar)
        item = kf.KittiObject(
            'Car', 0, 0, 0, (0, 0, 0, 0), user.size[2], user.size[1], user.size[0], x, y, z, -yaw - np.pi / 2
        )
        np.testing.assert_allclose([x, y, z, item.ry], np.round([x, y, z, item.ry], 2), atol=1e-9)
        (row,) = kf.objects_to_boxes([item], calib, ('Car',)).tensor
        c, s = np.cos(row[6]), np.sin(row[6])
        dx, dy, dz = (returned.xyz - row[:3]).T
        local = np.stack([c * dx + s * dy, -s * dx + c * dy, dz], axis=1)
        assert len(local) > 20 and (np.abs(local) <= row[3:6] / 2 + 0.01).all()


@pytest.mark.parametrize(('right', 'level'), [(-3.0, 0), (0.0, 1), (0.35, 2), (0.75, 3), (3.0, None)])
def test_occlusion_is_the_hidden_share_of_a_car(right: float, level: int | None) -> None:
    # A car straight ahead, 1.6 m wide; at half its distance a screen hides what lies to the right of `right`.
    calib = kitti_writer.demo_calib()
    rng = np.random.default_rng(4)
    user = road_users.RoadUser('Car', (4.0, 1.6, 1.5), shapes.box((0, 0, 0.75), (4.0, 1.6, 1.5), 0.5))
    bottom, yaw = kitti_writer.snap_pose(calib, 14.0, 0.0, -1.7, 0.0)
    placed = streets.Placed(user, bottom, yaw, user.mesh.moved(bottom, yaw))
    screen = shapes.quads(np.array([[[6.0, -9, -3], [6, right / 2, -3], [6, right / 2, 3], [6, -9, 3]]]), 0.5)
    street = streets.Street(FLAT, placed=[placed])
    mesh = shapes.join([placed.mesh, screen])
    hits = cast(mesh.corners, make_beams(QUIET_FINE))
    returned = scan(mesh, hits, QUIET_FINE, rng)
    rect = kf.transform(returned.xyz, calib.rect_from_lidar)
    objects = kitti_writer.label_street(street, hits.triangle, returned.triangle, QUIET_FINE, rect, calib)
    assert [item.occluded for item in objects] == ([] if level is None else [level])


def test_occlusion_levels() -> None:
    assert [kitti_writer.occlusion_level(share) for share in (1.0, 0.81, 0.5, 0.2, 0.1)] == [0, 0, 1, 2, 3]


def test_bytes_never_change() -> None:
    frame = kitti_writer.make_frame(7, 3, COARSE)
    labels = ''.join(kf.format_object(item) + '\n' for item in frame.objects)
    assert hashlib.sha256(frame.points.astype('<f4').tobytes()).hexdigest() == SCAN_HASH
    assert hashlib.sha256(labels.encode()).hexdigest() == LABEL_HASH, labels


def snapshot(root: Path) -> dict[str, str]:
    files = sorted(path for path in root.rglob('*') if path.is_file())
    return {str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def make(root: Path, **changes: float) -> Path:
    given = {'num_train': 2, 'num_val': 1, 'seed': 7, 'azimuth_step': 3.0} | changes
    return make_streets(root, progress=False, **given)


def test_data_set_reads_as_kitti(tmp_path: Path) -> None:
    root = make(tmp_path / 'demo')
    assert (root / 'ImageSets' / 'train.txt').read_text() == '000000\n000001\n'
    assert (root / 'ImageSets' / 'val.txt').read_text() == '000002\n'
    assert 'SYNTHETIC' in (root / 'README.txt').read_text()
    assert not list(root.rglob('*.tmp*'))
    for name in ('000000', '000001', '000002'):
        calib = kf.read_calib(root / 'training' / 'calib' / f'{name}.txt')
        points = kf.read_velodyne(root / 'training' / 'velodyne' / f'{name}.bin')
        objects = kf.read_objects(root / 'training' / 'label_2' / f'{name}.txt')
        kf.check_points(points, name)
        frame = kitti_writer.make_frame(7, int(name), SpinningLidar(azimuth_step=3.0))
        np.testing.assert_array_equal(points, frame.points)
        np.testing.assert_allclose(calib.rect_from_lidar, frame.calib.rect_from_lidar, atol=1e-12)
        assert [kf.format_object(o) for o in objects] == [kf.format_object(o) for o in frame.objects]
        assert kf.in_camera_view(points, calib).mean() > 0.05


def test_finished_sets_stay_and_interrupted_ones_go_on(tmp_path: Path) -> None:
    root = make(tmp_path / 'demo')
    before, times = snapshot(root), {path: os.stat(path).st_mtime_ns for path in root.rglob('*')}
    make(root)
    assert {path: os.stat(path).st_mtime_ns for path in root.rglob('*')} == times
    # As an interruption leaves it: no lists yet, the marker not finished, a frame without its scan.
    (root / 'ImageSets' / 'val.txt').unlink()
    (root / 'training' / 'velodyne' / '000001.bin').unlink()
    marker = json.loads((root / 'demo.json').read_text())
    (root / 'demo.json').write_text(json.dumps(marker | {'finished': False}))
    kept = root / 'training' / 'velodyne' / '000000.bin'
    make(root)
    assert snapshot(root) == before
    assert os.stat(kept).st_mtime_ns == times[kept]


def test_other_parameters_make_it_anew(tmp_path: Path) -> None:
    root = make(tmp_path / 'demo')
    before = snapshot(root)
    make(root, num_train=3)
    more = snapshot(root)
    assert all(more[name] == value for name, value in before.items() if name.startswith('training'))
    make(root, seed=8)
    other = snapshot(root)
    assert other['training/velodyne/000000.bin'] != before['training/velodyne/000000.bin']
    assert 'training/velodyne/000003.bin' not in other


@pytest.mark.slow
def test_workers_make_the_same_bytes(tmp_path: Path) -> None:
    assert snapshot(make(tmp_path / 'two', workers=2)) == snapshot(make(tmp_path / 'one'))


def test_foreign_folders_and_bad_numbers_are_refused(tmp_path: Path) -> None:
    (tmp_path / 'mine.txt').write_text('keep me')
    with pytest.raises(ValueError, match='holds files but no demo.json'):
        make(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ['mine.txt']
    with pytest.raises(ValueError, match='num_train=0, num_val=0'):
        make(tmp_path / 'a', num_train=0, num_val=0)
    assert not (tmp_path / 'a').exists()
