"""Waymo's parquet files: range images become points, what is missing is named, the demo writes what is read."""

import numpy as np
import pytest

from rm3d_plugin.datasets import DatasetNotFoundError, WaymoDataset
from rm3d_plugin.datasets.waymo_format import (
    BOX,
    CALIBRATION,
    LIDAR,
    FrameFiles,
    LaserCalibration,
    image_points,
    inclinations,
    read_matrix,
    read_points,
    rotations,
)
from rm3d_plugin.datasets.waymo_tables import LASER, SEGMENT, TIME
from rm3d_plugin.structures import SceneError

pytest.importorskip('pyarrow', reason="needs pyarrow: pip install 'rm3d_plugin[waymo]'")

from rm3d_plugin.datasets.synthetic import make_waymo_streets  # noqa: E402
from rm3d_plugin.datasets.synthetic.lidar import SpinningLidar  # noqa: E402
from rm3d_plugin.datasets.synthetic.waymo_writer import make_segment, write_table  # noqa: E402


@pytest.fixture(scope='session')
def waymo(tmp_path_factory):
    root = tmp_path_factory.mktemp('waymo')
    return make_waymo_streets(root, 1, 1, seed=3, azimuth_step=1.0, frames_per_segment=2, progress=False)


# ---------------------------------------------------------------------- geometry, pixel by pixel


def slow_points(image, extrinsic, beams, pixel_pose, frame_pose):
    """The formulas of the data set's description, one pixel at a time."""
    rows, columns = image.shape[:2]
    out = []
    for r in range(rows):
        for c in range(columns):
            distance = float(image[r, c, 0])
            if distance <= 0:
                continue
            turn = ((columns - c - 0.5) / columns * 2 - 1) * np.pi - np.arctan2(extrinsic[1, 0], extrinsic[0, 0])
            ray = [np.cos(turn) * np.cos(beams[r]), np.sin(turn) * np.cos(beams[r]), np.sin(beams[r])]
            point = extrinsic @ np.r_[distance * np.array(ray), 1.0]
            if pixel_pose is not None:
                roll, pitch, yaw, *place = pixel_pose[r, c].astype(np.float64)
                world = np.eye(4)
                world[:3, :3] = turn_z(yaw) @ turn_y(pitch) @ turn_x(roll)
                world[:3, 3] = place
                point = np.linalg.inv(frame_pose) @ world @ point
            out.append(point[:3])
    return np.array(out)


def turn_x(a):
    return np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])


def turn_y(a):
    return np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])


def turn_z(a):
    return np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])


def pose(rng):
    matrix = np.eye(4)
    matrix[:3, :3] = turn_z(rng.normal()) @ turn_y(0.1 * rng.normal()) @ turn_x(0.1 * rng.normal())
    matrix[:3, 3] = rng.normal(0, 5, 3)
    return matrix


@pytest.mark.parametrize('moving', [False, True])
def test_points_of_a_range_image_as_the_slow_twin(moving):
    rng = np.random.default_rng(5)
    image = rng.uniform(-5, 30, (4, 6, 4)).astype(np.float32)
    extrinsic, frame = pose(rng), pose(rng)
    beams = np.sort(rng.uniform(-0.4, 0.1, 4))[::-1]
    pixel = rng.normal(0, 1, (4, 6, 6)).astype(np.float32) if moving else None
    found = image_points(image, LaserCalibration(extrinsic, beams), pixel, frame if moving else None)
    np.testing.assert_allclose(found.xyz, slow_points(image, extrinsic, beams, pixel, frame), atol=1e-9)
    np.testing.assert_array_equal(found.intensity, image[..., 1][image[..., 0] > 0])
    np.testing.assert_array_equal(found.in_no_label_zone, image[..., 3][image[..., 0] > 0] > 0)
    assert found.sensor.tolist() == extrinsic[:3, 3].tolist()


def test_rotations_turn_about_x_then_y_then_z():
    roll, pitch, yaw = np.array([0.3]), np.array([-0.2]), np.array([1.1])
    np.testing.assert_allclose(rotations(roll, pitch, yaw)[0], turn_z(1.1) @ turn_y(-0.2) @ turn_x(0.3))


def test_inclinations_from_a_list_or_evenly_at_the_middles_of_cells():
    assert inclinations(3, 0, 0, [-0.3, -0.1, 0.2]).tolist() == [0.2, -0.1, -0.3]
    np.testing.assert_allclose(inclinations(4, -0.4, 0.4), [0.3, 0.1, -0.1, -0.3])
    with pytest.raises(SceneError, match='2 beam inclinations for an image of 3 rows'):
        inclinations(3, 0, 0, [0.1, 0.2])


# ---------------------------------------------------------------------- the demo, written and read


def test_the_points_of_the_demo_are_those_of_its_lidar_and_lie_in_its_boxes(waymo):
    data = WaymoDataset(waymo)
    assert data.scene_ids == tuple(f'synthetic_03_0000000_1500000000{step}00000' for step in (0, 1))
    frames = make_segment(3, 0, 2, SpinningLidar(1.0))
    for index, frame in enumerate(frames):
        cloud, truth, labelled = data.load_cloud(index), data.load_truth(index), data.annotation(index)
        assert len(cloud) == sum(int((image[..., 0] > 0).sum()) for image in frame.images)
        assert 0 < (frame.images[1][..., 0] > 0).sum() < len(cloud) / 20  # second returns
        seen = frame.points > 0
        np.testing.assert_allclose(labelled.boxes, frame.boxes[seen])
        assert labelled.level.tolist() == [2 if n <= 5 else 1 for n in frame.points[seen]]
        inside = np.bincount(truth.instance[truth.instance >= 0], minlength=len(truth.boxes))
        assert np.abs(inside - labelled.points).max() <= 4  # grazing points, and second returns behind things
        assert inside.max() > 100 and cloud.intensity.max() == 1 and cloud.sensor[2] > 1
    only = WaymoDataset(waymo, returns=(1,), classes=('Cyclist', 'Vehicle'))
    assert len(only.load_cloud(0)) == (frames[0].images[0][..., 0] > 0).sum()
    kinds = labelled_types(only)
    assert only.load_truth(0).boxes.labels.tolist() == [{4: 0, 1: 1}[kind] for kind in kinds if kind in (1, 4)]


def labelled_types(data):
    return data.annotation(0).types.tolist()


def test_splits_lists_and_steps(waymo):
    assert len(WaymoDataset(waymo, every=2)) == 1
    val = WaymoDataset(waymo, split='val', labels='truth')
    assert val.scene_ids[0].startswith('synthetic_03_1000000_')
    (waymo / 'list.txt').write_text('synthetic_03_0000000\n')
    assert len(WaymoDataset(waymo, ann_file='list.txt')) == 2
    (waymo / 'list.txt').write_text('nowhere\n')
    with pytest.raises(SceneError, match='list.txt: segment nowhere is not in .*lidar; download it'):
        len(WaymoDataset(waymo, ann_file='list.txt'))
    with pytest.raises(DatasetNotFoundError, match='lidar_calibration/  SEGMENT.parquet'):
        len(WaymoDataset(waymo / 'nothing'))
    with pytest.raises(ValueError, match='expected one of Vehicle, Pedestrian, Cyclist'):
        WaymoDataset(waymo, classes=['Sign'])
    with pytest.raises(ValueError, match='returns of 1, 2'):
        WaymoDataset(waymo, returns=(3,))


def tiny(root, drop=(), lasers=(2,), **changes):
    """A frame of side lasers of 2 x 4 pixels, written column by column; without the tables or columns in ``drop``."""
    image = np.zeros((2, 4, 4), dtype=np.float32)
    image[0, 1] = [10.0, 0.5, 0.1, 0.0]
    image[1, 2] = [20.0, 0.7, 0.1, 1.0]
    one, two = (f'{LIDAR}.range_image_return{number}' for number in (1, 2))
    rows = len(lasers)
    lidar = {SEGMENT: 's', TIME: [7] * rows, LASER: list(lasers), f'{one}.values': [image.ravel()] * rows}
    lidar |= {f'{one}.shape': [[2, 4, 4]] * rows, f'{two}.values': [image.ravel()[:0]] * rows}
    lidar |= {f'{two}.shape': [[0, 0, 0]] * rows}
    angles = f'{CALIBRATION}.beam_inclination'
    calibration = {SEGMENT: 's', LASER: [2], f'{CALIBRATION}.extrinsic.transform': [np.eye(4).ravel()]}
    calibration |= {f'{angles}.min': [-0.2], f'{angles}.max': [0.2], f'{angles}.values': [np.zeros(0)]}
    box = {SEGMENT: 's', TIME: [7], f'{BOX}.type': [1], f'{BOX}.num_lidar_points_in_box': [9]}
    box |= {f'{BOX}.difficulty_level.detection': [0], f'{BOX}.box.heading': [0.0]}
    box |= {f'{BOX}.box.{part}.{axis}': [2.0] for part in ('center', 'size') for axis in 'xyz'}
    tables = {'lidar': lidar | changes, 'lidar_calibration': calibration, 'lidar_box': box}
    tables |= {
        'vehicle_pose': {
            SEGMENT: 's',
            TIME: [7],
            '[VehiclePoseComponent].world_from_vehicle.transform': [np.eye(4).ravel()],
        }
    }
    for name, columns in tables.items():
        if name not in drop:
            kept = {column: values for column, values in columns.items() if column not in drop}
            write_table(root / 'training' / name / 's.parquet', kept)
    return WaymoDataset(root)


def test_a_side_laser_needs_no_pose_and_points_of_no_label_zones_are_left_out(tmp_path):
    data = tiny(tmp_path)
    cloud = data.load_cloud(0)
    assert len(cloud) == 1
    turn, tilt = ((4 - 1 - 0.5) / 4 * 2 - 1) * np.pi, 0.1
    expected = 10 * np.array([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)])
    np.testing.assert_allclose(cloud.xyz[0], expected, rtol=1e-6)
    assert [len(part.xyz) for part in read_points(FrameFiles(tmp_path / 'training', 's'), 7, (1, 2), (1, 2))] == [2]


@pytest.mark.parametrize(
    ('changes', 'told'),
    [
        (dict(drop=['lidar_calibration']), "segment s lacks the component 'lidar_calibration': download it"),
        (dict(drop=[LASER]), "lidar/s.parquet: no column 'key.laser_name'; expected perception v2"),
        (dict(lasers=(2, 4)), 'no calibration of laser 4; got'),
        (dict(lasers=(1,)), 'no calibration of laser 1'),
        (
            {f'{LIDAR}.range_image_return1.shape': [[3, 4, 4]]},
            r'laser 2, return 1: shape \(3, 4, 4\) does not fit 32 values',
        ),
    ],
)
def test_what_is_missing_or_wrong_is_named(changes, told, tmp_path):
    with pytest.raises(SceneError, match=told):
        tiny(tmp_path, **changes).load_cloud(0)


def test_the_top_laser_needs_the_pose_of_its_pixels(waymo, tmp_path):
    copy = tmp_path / 'copy'
    for name in ('lidar', 'lidar_calibration', 'vehicle_pose'):
        (copy / 'training' / name).mkdir(parents=True)
        source = next((waymo / 'training' / name).glob('*.parquet'))
        (copy / 'training' / name / source.name).write_bytes(source.read_bytes())
    with pytest.raises(SceneError, match="lacks the component 'lidar_pose'"):
        WaymoDataset(copy).load_cloud(0)
    with pytest.raises(SceneError, match="lacks the component 'lidar_box'"):
        WaymoDataset(copy).annotation(0)


def test_a_damaged_file_and_a_bad_box_are_told(tmp_path):
    data = tiny(tmp_path)
    write_table(
        tmp_path / 'training' / 'lidar_box' / 's.parquet',
        {SEGMENT: 's', TIME: [7], f'{BOX}.type': [1], f'{BOX}.num_lidar_points_in_box': [9]}
        | {f'{BOX}.box.heading': [0.0]}
        | {f'{BOX}.difficulty_level.detection': [2]}
        | {f'{BOX}.box.{part}.{axis}': [0.0] for part in ('center', 'size') for axis in 'xyz'},
    )
    with pytest.raises(SceneError, match='a box at 7 microseconds has a size that is not above 0'):
        data.load_truth(0)
    (tmp_path / 'training' / 'lidar' / 's.parquet').write_bytes(b'PAR1')
    with pytest.raises(SceneError, match='lidar/s.parquet: not a parquet file'):
        data.load_cloud(0)


def test_the_same_seed_gives_the_same_bytes_and_other_folders_are_refused(waymo, tmp_path):
    again = make_waymo_streets(tmp_path / 'again', 1, 0, seed=3, azimuth_step=1.0, frames_per_segment=2, progress=False)
    for path in sorted(waymo.glob('training/*/synthetic*.parquet')):
        assert path.read_bytes() == (again / path.relative_to(waymo)).read_bytes()
    (tmp_path / 'mine').mkdir()
    (tmp_path / 'mine' / 'thesis.txt').write_text('mine')
    with pytest.raises(ValueError, match='not made here'):
        make_waymo_streets(tmp_path / 'mine', 1, 1)
    with pytest.raises(ValueError, match='an even number of times makes 360'):
        make_waymo_streets(tmp_path / 'odd', 1, 1, azimuth_step=0.7)


def put(root, component, column, values):
    """Write other values into one column of a component."""
    import pyarrow.parquet

    path = root / 'training' / component / 's.parquet'
    table = pyarrow.parquet.read_table(path)
    columns = {name: table.column(name).to_pylist() for name in table.column_names} | {column: values}
    pyarrow.parquet.write_table(pyarrow.table(columns), path)


POSE_COLUMN = '[VehiclePoseComponent].world_from_vehicle.transform'
MOUNTED = f'{CALIBRATION}.extrinsic.transform'
RANGES = f'{LIDAR}.range_image_return1'


@pytest.mark.parametrize(
    ('component', 'column', 'values', 'told'),
    [
        ('lidar', SEGMENT, ['t'], 'lidar/s.parquet: its rows are of segment t; download the file again'),
        ('lidar_box', SEGMENT, ['t'], 'lidar_box/s.parquet: its rows are of segment t'),
        ('lidar', LASER, [None], 'key.laser_name: expected 1 to 5, got None'),
        ('lidar', f'{RANGES}.shape', [[2, 16, 1]], r'shape \(2, 16, 1\); expected 4 numbers a pixel'),
        ('lidar', f'{RANGES}.values', [[np.nan] + [1.0] * 31], 'return 1: 1 pixels are NaN, infinite or empty'),
        ('lidar', f'{RANGES}.values', [[None] + [1.0] * 31], 'return 1: 1 pixels are NaN, infinite or empty'),
        ('lidar', f'{RANGES}.values', [None], 'laser 2, return 1: no range image; download the file again'),
        ('lidar_calibration', MOUNTED, [[1.0] * 12], 'laser 2, extrinsic: expected 16 finite numbers, got 12'),
        ('lidar_calibration', MOUNTED, [[0.0] * 16], 'extrinsic: its first three columns are no rotation'),
        ('lidar_calibration', f'{CALIBRATION}.beam_inclination.min', [None], 'laser 2: a beam inclination is NaN or'),
        (
            'lidar_calibration',
            f'{CALIBRATION}.beam_inclination.values',
            [[0.1]],
            '1 beam inclinations for an image of 2',
        ),
        ('vehicle_pose', TIME, [None], 'expected whole microseconds, got null, 1 empty'),
        ('vehicle_pose', TIME, [7.5], 'expected whole microseconds, got double'),
        ('lidar_box', f'{BOX}.type', [9], 'type: expected 0 to 4, got 9'),
        ('lidar_box', f'{BOX}.type', ['TYPE_VEHICLE'], "type: expected a finite number, got 'TYPE_VEHICLE' in box 0"),
        ('lidar_box', f'{BOX}.box.heading', [None], 'heading: expected a finite number, got None in box 0'),
        ('lidar_box', f'{BOX}.num_lidar_points_in_box', [None], 'points_in_box: expected a finite number, got None'),
    ],
)
def test_values_that_no_file_has_are_told(component, column, values, told, tmp_path):
    data = tiny(tmp_path)
    put(tmp_path, component, column, values)
    with pytest.raises(SceneError, match=told):
        data.load_truth(0)


def test_a_box_without_a_level_has_that_of_its_points(tmp_path):
    data = tiny(tmp_path)
    put(tmp_path, 'lidar_box', f'{BOX}.difficulty_level.detection', [None])
    assert data.annotation(0).level.tolist() == [1]


def test_a_transform_turns_and_moves():
    with pytest.raises(SceneError, match='first three columns are no rotation'):
        read_matrix(np.diag([1.0, 1, 0, 1]).ravel(), 'pose')
    np.testing.assert_array_equal(read_matrix(np.eye(4).ravel(), 'pose'), np.eye(4))


def test_intensities_that_are_nan_count_as_0(tmp_path):
    data = tiny(tmp_path)
    image = np.zeros((2, 4, 4))
    image[0, 1], image[1, 1] = [10.0, np.nan, 0, 0], [10.0, 0.5, 0, 0]
    put(tmp_path, 'lidar', f'{RANGES}.values', [image.ravel().tolist()])
    with pytest.warns(UserWarning, match='the intensities of 1 of 2 points are NaN or infinite; they count as 0'):
        intensity = data.read_cloud(0).intensity
    assert intensity.tolist() == [0.0, 0.5]


def test_hidden_files_and_segments_without_frames(tmp_path):
    data = tiny(tmp_path)
    (tmp_path / 'training/lidar/._s.parquet').write_bytes(b'\0\5')
    assert data.scene_ids == ('s_7',)
    write_table(
        tmp_path / 'training/vehicle_pose/s.parquet', {SEGMENT: np.array([], dtype=str), TIME: np.array([], dtype=int)}
    )
    with pytest.raises(SceneError, match='vehicle_pose/s.parquet: holds no frame; download it again, or take'):
        len(WaymoDataset(tmp_path))
