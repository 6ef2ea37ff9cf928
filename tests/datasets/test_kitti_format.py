"""KITTI files: numbers worked by hand, exact round trips, errors that name file and field, and real frames."""

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rm3d_plugin.datasets import kitti_format as kf
from rm3d_plugin.structures import Boxes3D, SceneError

CLASSES = ('Car', 'Pedestrian', 'Cyclist', 'Van', 'Truck', 'Misc')
AXES = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])  # lidar (forward, left, up) to camera (right, down, forward)


def straight_calib() -> kf.KittiCalib:
    return kf.KittiCalib(
        P2=np.array([[100.0, 0, 50, 0], [0, 100, 40, 0], [0, 0, 1, 0]]),
        R0_rect=np.eye(3),
        Tr_velo_to_cam=np.concatenate([AXES, np.zeros((3, 1))], axis=1),
    )


def tilted_calib() -> kf.KittiCalib:
    a, b = 0.02, -0.015
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    nod = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    velo = np.concatenate([turn @ AXES, np.array([[0.01], [-0.07], [-0.3]])], axis=1)
    p2 = np.array([[715.0, 0, 609, 44], [0, 715, 175, 0.3], [0, 0, 1, 0.005]])
    return kf.KittiCalib(P2=p2, R0_rect=nod, Tr_velo_to_cam=velo)


CAR = kf.KittiObject('Car', 0.0, 0, 0.0, (1.0, 2.0, 3.0, 4.0), 1.5, 1.6, 4.0, 2.0, 1.5, 10.0, -np.pi / 2)


def test_projects_by_hand() -> None:
    # (10, -2, 1) ahead, right, up is (2, -1, 10) in the camera: u = 50 + 100 * 2 / 10, v = 40 - 100 / 10.
    uv, depth = straight_calib().project(np.array([[10.0, -2, 1], [-10, -2, 1]]))
    np.testing.assert_allclose(uv[0], [70, 30])
    np.testing.assert_allclose(depth, [10, -10])


def test_in_camera_view_needs_the_image_and_the_front() -> None:
    points = np.array([[10.0, -2, 1, 0.5], [-10, 2, -1, 0.5], [10, 6, 0, 0.5], [10, 5, 0, 0.5], [10, -5, 0, 0.5]])
    seen = kf.in_camera_view(points, straight_calib(), (100, 80))
    assert seen.tolist() == [
        True,
        False,
        False,
        True,
        False,
    ]  # u = 70, behind, -10, 0 (first pixel), 100 (past the last)
    assert kf.in_camera_view(np.zeros((0, 4)), straight_calib()).shape == (0,)


def test_box_by_hand() -> None:
    boxes = kf.objects_to_boxes(
        [CAR, replace(CAR, type='Tram'), replace(CAR, type='DontCare', h=-1)], straight_calib(), CLASSES
    )
    np.testing.assert_allclose(boxes.tensor, [[10, -2, -0.75, 4, 1.6, 1.5, 0]], atol=1e-12)
    assert boxes.labels.tolist() == [0]
    assert len(kf.objects_to_boxes([], straight_calib(), CLASSES)) == 0


def test_result_by_hand() -> None:
    (item,) = kf.boxes_to_objects(
        Boxes3D(np.array([[10.0, 0, 0, 4, 2, 2, 0]]), np.array([1]), np.array([0.25])),
        straight_calib(),
        CLASSES,
        (100, 80),
    )
    assert (item.type, item.score, item.truncated, item.occluded) == ('Pedestrian', 0.25, -1, -1)
    assert (item.h, item.w, item.l) == (2, 2, 4)
    np.testing.assert_allclose(
        [item.x, item.y, item.z, item.ry, item.alpha], [0, 1, 10, -np.pi / 2, -np.pi / 2], atol=1e-12
    )
    # The near face is 8 m away and reaches 1 m to every side.
    np.testing.assert_allclose(item.bbox, [37.5, 27.5, 62.5, 52.5])


def test_boxes_beside_and_behind_the_camera() -> None:
    boxes = Boxes3D(np.array([[0.0, 2.5, 0, 4, 2, 1, 0], [-9, 0, 0, 4, 2, 1, 0]]), np.array([0, 0]))
    beside, behind = kf.boxes_to_objects(boxes, straight_calib(), CLASSES, (1000, 80))
    assert np.isfinite(beside.bbox).all() and beside.bbox[0] == 0
    assert behind.bbox == (0, 0, 0, 0)


@pytest.mark.parametrize(
    ('angle', 'wrapped'), [(0.0, 0.0), (np.pi, -np.pi), (-np.pi, -np.pi), (4.0, 4 - 2 * np.pi), (-9.0, -9 + 2 * np.pi)]
)
def test_angles_wrap_into_the_half_open_turn(angle: float, wrapped: float) -> None:
    assert float(kf.wrap_angle(angle)) == pytest.approx(wrapped, abs=1e-12)


number = st.floats(-70, 70)
size = st.floats(0.1, 15)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.tuples(number, number, number, size, size, size, st.floats(-np.pi, np.pi - 1e-9)))
def test_boxes_survive_the_way_to_the_camera_and_back(row: tuple[float, ...]) -> None:
    boxes = Boxes3D(np.array([row]), np.array([2]), np.array([0.5]))
    again = kf.objects_to_boxes(kf.boxes_to_objects(boxes, tilted_calib(), CLASSES), tilted_calib(), CLASSES)
    difference = again.tensor - boxes.tensor
    difference[:, 6] = kf.wrap_angle(difference[:, 6])
    np.testing.assert_allclose(difference, 0, atol=1e-9)
    assert again.labels.tolist() == [2] and again.scores is not None and again.scores.tolist() == [0.5]


def test_inverse_of_a_rotation_that_is_not_quite_one() -> None:
    calib = tilted_calib()
    scaled = calib.rect_from_lidar.copy()
    scaled[:3, :3] *= 1.001
    np.testing.assert_allclose(kf.invert_affine(scaled) @ scaled, np.eye(4), atol=1e-12)


def test_calib_round_trip(tmp_path: Path) -> None:
    calib = replace(tilted_calib(), P0=np.arange(12.0).reshape(3, 4))
    kf.write_calib(tmp_path / 'c.txt', calib)
    again = kf.read_calib(tmp_path / 'c.txt')
    np.testing.assert_allclose(again.rect_from_lidar, calib.rect_from_lidar, atol=1e-11)
    np.testing.assert_array_equal(again.P0, calib.P0)
    assert again.P3 is None


def test_objects_are_written_as_kitti_writes_them(tmp_path: Path) -> None:
    dont_care = kf.KittiObject('DontCare', -1, -1, -10, (1.5, 2, 3, 4), -1, -1, -1, -1000, -1000, -1000, -10)
    result = replace(CAR, truncated=-1, occluded=-1, score=0.123456)
    kf.write_objects(tmp_path / 'o.txt', [CAR, dont_care, result])
    assert (tmp_path / 'o.txt').read_text().splitlines() == [
        'Car 0.00 0 0.00 1.00 2.00 3.00 4.00 1.50 1.60 4.00 2.00 1.50 10.00 -1.57',
        'DontCare -1 -1 -10 1.50 2.00 3.00 4.00 -1 -1 -1 -1000 -1000 -1000 -10',
        'Car -1 -1 0.00 1.00 2.00 3.00 4.00 1.50 1.60 4.00 2.00 1.50 10.00 -1.57 0.1235',
    ]
    kf.write_objects(tmp_path / 'full.txt', [CAR, result], full_precision=True)
    assert kf.read_objects(tmp_path / 'full.txt') == [CAR, result]


def test_an_empty_label_file_holds_no_object(tmp_path: Path) -> None:
    (tmp_path / 'o.txt').write_text('\n')
    assert kf.read_objects(tmp_path / 'o.txt') == []


@pytest.mark.parametrize(
    ('line', 'message'),
    [
        ('Car 0 0 0 1 2 3 4 1 1 1 0 0 9', r'line 2: expected 15 fields \(16 with a score\), got 14'),
        ('Car 0 0 0 1 2 3 4 1 1 1 0 0 9 0 1 1', r'line 2: expected 15 fields .* got 17'),
        ('Car 0 0 0 1 2 3 4 1 wide 1 0 0 9 0', r"line 2: w is 'wide', expected a number"),
        ('Car 0 0 0 1 2 3 4 1 1 1 nan 0 9 0', r"line 2: x is 'nan', expected a finite number"),
    ],
)
def test_bad_label_lines_are_named(tmp_path: Path, line: str, message: str) -> None:
    (tmp_path / '7.txt').write_text(f'{kf.format_object(CAR)}\n{line}\n')
    with pytest.raises(SceneError, match=f'7.txt, {message}'):
        kf.read_objects(tmp_path / '7.txt')


@pytest.mark.parametrize(
    ('drop', 'add', 'message'),
    [
        ('R0_rect', '', 'no line R0_rect'),
        ('P2', 'P2: 1 2 3', 'P2: expected 12 numbers, got 3'),
        ('Tr_velo_to_cam', 'Tr_velo_to_cam: 1 x', r"line 3, Tr_velo_to_cam: number 2 is 'x'"),
    ],
)
def test_bad_calibrations_are_named(tmp_path: Path, drop: str, add: str, message: str) -> None:
    path = tmp_path / 'c.txt'
    kf.write_calib(path, straight_calib())
    lines = [line for line in path.read_text().splitlines() if not line.startswith(drop)]
    path.write_text('\n'.join([*lines, add]) + '\n')
    with pytest.raises(SceneError, match=message):
        kf.read_calib(path)


def test_missing_files_are_named(tmp_path: Path) -> None:
    for reader in (kf.read_calib, kf.read_objects, kf.read_velodyne):
        with pytest.raises(SceneError, match='nowhere.txt: no such file'):
            reader(tmp_path / 'nowhere.txt')


def test_scans(tmp_path: Path) -> None:
    points = np.array([[1, 2, 3, 0.5], [np.nan, 0, 0, 0], [4, np.inf, 0, 0]], dtype=np.float32)
    path = tmp_path / 'a.bin'
    path.write_bytes(points.tobytes())
    read = kf.read_velodyne(path)
    np.testing.assert_array_equal(read, points)
    assert read.dtype == np.float32
    with pytest.raises(SceneError, match=r'a.bin: 2 of 3 points hold NaN'):
        kf.check_points(read, path)
    kf.check_points(read[:1], path)
    path.write_bytes(points.tobytes()[:-3])
    with pytest.raises(SceneError, match='a.bin: 45 bytes are no multiple of 16'):
        kf.read_velodyne(path)
    path.write_bytes(b'')
    with pytest.raises(SceneError, match='a.bin: holds no points'):
        kf.read_velodyne(path)


def test_image_size_from_the_header(tmp_path: Path) -> None:
    path = tmp_path / 'a.png'
    assert kf.read_image_size(path) == kf.IMAGE_SIZE
    path.write_bytes(b'\x89PNG\r\n\x1a\n' + struct.pack('>I', 13) + b'IHDR' + struct.pack('>II', 1224, 370) + b'rest')
    assert kf.read_image_size(path) == (1224, 370)
    path.write_bytes(b'GIF89a')
    with pytest.raises(SceneError, match='not a PNG'):
        kf.read_image_size(path)


def frames(real_data: Path) -> list[Path]:
    found = sorted((real_data / 'kitti' / 'training' / 'label_2').glob('*.txt'))
    assert found
    return found


def test_real_labels_round_trip_to_the_last_character(real_data: Path) -> None:
    for path in frames(real_data):
        text = [kf.format_object(item) for item in kf.read_objects(path)]
        assert text == path.read_text().splitlines(), path


def test_real_boxes_hold_points_and_come_back(real_data: Path) -> None:
    training = real_data / 'kitti' / 'training'
    for path in frames(real_data):
        calib = kf.read_calib(training / 'calib' / path.name)
        points = kf.read_velodyne(training / 'velodyne' / f'{path.stem}.bin')
        kf.check_points(points, path)
        objects = [item for item in kf.read_objects(path) if item.type in CLASSES]
        boxes = kf.objects_to_boxes(objects, calib, CLASSES)
        for item, again, row in zip(objects, kf.boxes_to_objects(boxes, calib, CLASSES), boxes.tensor, strict=True):
            c, s = np.cos(row[6]), np.sin(row[6])
            dx, dy, dz = (points[:, :3] - row[:3]).T
            local = np.stack([c * dx + s * dy, -s * dx + c * dy, dz], axis=1)
            assert (np.abs(local) <= row[3:6] / 2).all(axis=1).any(), (path, item)
            for name in ('h', 'w', 'l', 'x', 'y', 'z', 'ry'):
                assert getattr(again, name) == pytest.approx(getattr(item, name), abs=1e-9)
            assert float(kf.wrap_angle(again.alpha - item.alpha)) == pytest.approx(0, abs=0.04)


def test_real_2d_boxes_agree_with_the_projected_ones(real_data: Path) -> None:
    path = real_data / 'kitti' / 'training' / 'label_2' / '000007.txt'
    calib = kf.read_calib(real_data / 'kitti' / 'training' / 'calib' / path.name)
    objects = [item for item in kf.read_objects(path) if item.type in CLASSES]
    again = kf.boxes_to_objects(kf.objects_to_boxes(objects, calib, CLASSES), calib, CLASSES)
    for item, other in zip(objects, again, strict=True):
        np.testing.assert_allclose(other.bbox, item.bbox, atol=2)


def test_a_calibration_that_flattens_space_is_told(tmp_path):
    kf.write_calib(tmp_path / 'a.txt', straight_calib())
    text = (tmp_path / 'a.txt').read_text().splitlines()
    flat = [line.split(':')[0] + ': ' + ' '.join(['0'] * 12) if line.startswith('Tr_velo') else line for line in text]
    (tmp_path / 'b.txt').write_text('\n'.join(flat))
    with pytest.raises(SceneError, match='b.txt, Tr_velo_to_cam: its first three columns are no rotation'):
        kf.read_calib(tmp_path / 'b.txt')


@pytest.mark.parametrize(
    ('row', 'told'),
    [
        ('R0_rect: 1000 0 0 0 1000 0 0 0 1000', 'R0_rect: its first three columns are no rotation'),
        ('R0_rect: 1 0 0 0 1 0 0 0 -1', 'R0_rect: its first three columns are no rotation'),
        ('P2: ' + '0 ' * 12, 'P2: it maps all points onto a line or a point'),
        ('P2: 1_0 0 0 0 0 1 0 0 0 0 1 0', "P2: number 1 is '1_0', expected a number"),
    ],
)
def test_matrices_that_cannot_be(tmp_path: Path, row: str, told: str) -> None:
    path = tmp_path / 'a.txt'
    kf.write_calib(path, straight_calib())
    kept = [line for line in path.read_text().splitlines() if not line.startswith(row[:3])]
    path.write_text('\n'.join([*kept, row]))
    with pytest.raises(SceneError, match=told):
        kf.read_calib(path)
    path.write_text('\n'.join([*kept, row, row]))
    with pytest.raises(SceneError, match=f'line 4: a second line {row[: row.find(":")]}|1_0'):
        kf.read_calib(path)


@pytest.mark.parametrize(
    ('line', 'told'),
    [
        ('Car 0 0.5 0 1 2 3 4 1.5 1.6 4 2 1.5 10 -1.57', 'line 1: occluded is 0.5, expected a whole number, 0 to 3'),
        ('Car 0 0 0 1 2 3 4 1.5 1.6 4 2 1.5 10 -90', 'line 1: ry is -90, expected radians; degrees'),
    ],
)
def test_fields_that_cannot_be(tmp_path: Path, line: str, told: str) -> None:
    (tmp_path / 'a.txt').write_text(line)
    with pytest.raises(SceneError, match=told):
        kf.read_objects(tmp_path / 'a.txt')


def test_texts_of_other_programs(tmp_path: Path) -> None:
    line = kf.format_object(CAR)
    (tmp_path / 'a.txt').write_bytes(line.encode('utf-16'))
    assert kf.read_objects(tmp_path / 'a.txt') == [kf.read_objects(written(tmp_path, line))[0]]
    (tmp_path / 'a.png').write_bytes(b'\x89PNG\r\n\x1a\n' + struct.pack('>I4sII', 13, b'IHDR', 0, 0))
    with pytest.raises(SceneError, match='an image of 0 x 0 pixels'):
        kf.read_image_size(tmp_path / 'a.png')


def written(folder: Path, line: str) -> Path:
    (folder / 'b.txt').write_text(line)
    return folder / 'b.txt'
