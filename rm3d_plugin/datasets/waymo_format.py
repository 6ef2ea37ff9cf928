"""Waymo Open Dataset, perception v2: parquet files, one a segment and component, and the points of range images.

Frames: *laser* is that of one lidar; *vehicle* (x forward, y left, z up, origin on the ground) is the scene frame;
*world* is fixed. Needs pyarrow, the extra ``waymo``.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.datasets.kitti_format import is_rotation
from rm3d_plugin.datasets.waymo_tables import LASER, read_rows
from rm3d_plugin.structures import SceneError

SPLITS = {'train': 'training', 'val': 'validation', 'test': 'testing'}
TOP = 1  # laser that turns on the roof; 2 front, 3 side left, 4 side right, 5 rear
TYPES = {'Vehicle': 1, 'Pedestrian': 2, 'Cyclist': 4}  # 3 are signs
OTHER_TYPES = (0, 3)  # unknown, signs
LIDAR, CALIBRATION = '[LiDARComponent]', '[LiDARCalibrationComponent]'
PIXEL_POSE, POSE, BOX = '[LiDARPoseComponent]', '[VehiclePoseComponent]', '[LiDARBoxComponent]'
CHANNELS = 4  # of a range image: range in metres, intensity, elongation, whether in a no-label zone
POSE_NUMBERS = 6  # roll, pitch, yaw, x, y, z of a pixel
FEW_POINTS = 5  # a box with so few points is of level 2, where nobody said otherwise

BOX_COLUMNS = (
    *(f'{BOX}.box.center.{axis}' for axis in 'xyz'),
    *(f'{BOX}.box.size.{axis}' for axis in 'xyz'),
    f'{BOX}.box.heading',
    f'{BOX}.type',
    f'{BOX}.num_lidar_points_in_box',
    f'{BOX}.difficulty_level.detection',
)


class LaserCalibration(NamedTuple):
    """How one laser is mounted.

    Attributes:
        extrinsic: (4, 4) vehicle from laser, metres.
        inclinations: Radians, one for each row of an image, the highest beam first.
    """

    extrinsic: Float[np.ndarray, '4 4']
    inclinations: Float[np.ndarray, ' rows']


class LaserPoints(NamedTuple):
    """Points of one return.

    Attributes:
        xyz: (N, 3) float64 metres, vehicle frame.
        intensity: (N,) float32, unbounded.
        in_no_label_zone: (N,) bool.
        sensor: (3,) where the laser is mounted, metres, vehicle frame.
    """

    xyz: Float[np.ndarray, 'points 3']
    intensity: Float[np.ndarray, ' points']
    in_no_label_zone: Bool[np.ndarray, ' points']
    sensor: Float[np.ndarray, '3']


class WaymoBoxes(NamedTuple):
    """Labelled boxes of one frame, every type.

    Attributes:
        boxes: (M, 7) rows as :class:`~rm3d_plugin.structures.Boxes3D`, vehicle frame.
        types: (M,) 1 vehicle, 2 pedestrian, 3 sign, 4 cyclist.
        points: (M,) lidar points in each box, as the labellers counted.
        level: (M,) difficulty of detection: 1 or 2.
    """

    boxes: Float[np.ndarray, 'boxes 7']
    types: Int[np.ndarray, ' boxes']
    points: Int[np.ndarray, ' boxes']
    level: Int[np.ndarray, ' boxes']

    def select(self, index: np.ndarray) -> 'WaymoBoxes':
        """The boxes that ``index`` names."""
        return WaymoBoxes(*(values[index] for values in self))


def _image(values: Any, shape: Any, where: str, channels: int) -> Float[np.ndarray, 'rows columns channels'] | None:
    """A range image; None where a frame has none.

    Raises:
        SceneError: It has another shape, or its first channel holds NaN.
    """
    if not values.is_valid or len(values.values) == 0:
        return None
    size = tuple(shape.as_py() or ())
    numbers = np.asarray(values.values, dtype=np.float32)
    if len(size) != 3 or int(np.prod(size)) != len(numbers):
        raise SceneError(f'{where}: shape {size} does not fit {len(numbers)} values')
    if size[2] != channels:
        raise SceneError(f'{where}: shape {size}; expected {channels} numbers a pixel')
    image = numbers.reshape(size)
    if not np.isfinite(image[..., 0]).all():
        raise SceneError(f'{where}: {int((~np.isfinite(image[..., 0])).sum())} pixels are NaN, infinite or empty')
    return image


def read_matrix(values: Sequence[float] | None, where: str) -> Float[np.ndarray, '4 4']:
    """A transform, row by row.

    Raises:
        SceneError: It is not 16 finite numbers that turn and move.
    """
    numbers = np.array(() if values is None else values, dtype=np.float64)
    if numbers.shape != (16,) or not np.isfinite(numbers).all():
        raise SceneError(f'{where}: expected 16 finite numbers, got {numbers.size}; download the file again')
    matrix = numbers.reshape(4, 4)
    if not is_rotation(matrix[:3, :3]):
        raise SceneError(f'{where}: its first three columns are no rotation; download the file again')
    return matrix


def read_calibration(path: Path, rows_of: dict[int, int]) -> dict[int, LaserCalibration]:
    """Mounting of each laser.

    Args:
        path: ``SPLIT/lidar_calibration/SEGMENT.parquet``.
        rows_of: Laser -> rows of its images.

    Raises:
        SceneError: The calibration of a laser is missing.
    """
    angles = f'{CALIBRATION}.beam_inclination'
    columns = (LASER, f'{CALIBRATION}.extrinsic.transform', f'{angles}.min', f'{angles}.max', f'{angles}.values')
    found = {}
    for laser, extrinsic, low, high, values in zip(*read_rows(path, columns).values(), strict=True):
        if laser in rows_of:
            where = f'{path}, laser {laser}'
            mounted = read_matrix(extrinsic, f'{where}, extrinsic')
            found[laser] = LaserCalibration(mounted, inclinations(rows_of[laser], low, high, values, where))
    if missing := sorted(set(rows_of) - set(found)):
        raise SceneError(f'{path}: no calibration of laser {missing[0]}; got {sorted(found)}')
    return found


def inclinations(
    rows: int,
    low: float | None,
    high: float | None,
    values: Sequence[float] | None = None,
    where: str = 'lidar_calibration',
) -> Float[np.ndarray, ' rows']:
    """Radians of the rows of an image, the highest beam first.

    Args:
        rows: Of the image.
        low: Least.
        high: Greatest.
        values: Of each beam, ascending; None or empty: they divide low to high evenly, at the middle of the cells.
        where: For messages.

    Raises:
        SceneError: There are more or fewer values than rows, or an angle is missing.
    """
    if values is not None and len(values):
        if len(values) != rows:
            raise SceneError(f'{where}: {len(values)} beam inclinations for an image of {rows} rows')
        angles = np.asarray(values, dtype=np.float64)
    else:
        least, greatest = (np.nan if end is None else end for end in (low, high))
        angles = least + (np.arange(rows) + 0.5) / rows * (greatest - least)
    if not np.isfinite(angles).all():
        raise SceneError(f'{where}: a beam inclination is NaN or missing; download the file again')
    return angles[::-1].copy()


def rotations(roll: np.ndarray, pitch: np.ndarray, yaw: np.ndarray) -> Float[np.ndarray, 'points 3 3']:
    """Turns about x, then y, then z."""
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (np.cos, np.sin))
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def image_points(
    image: Float[np.ndarray, 'rows columns channels'],
    calibration: LaserCalibration,
    pixel_pose: Float[np.ndarray, 'rows columns 6'] | None = None,
    frame_pose: Float[np.ndarray, '4 4'] | None = None,
) -> LaserPoints:
    """Points of a range image, row by row.

    Args:
        image: Range (metres; 0 or less: nothing), intensity, elongation, in no-label zone.
        calibration: Of its laser.
        pixel_pose: Roll, pitch, yaw (radians) and x, y, z (metres) of the vehicle in the world when each pixel was
            measured; None: the vehicle stood still.
        frame_pose: World from vehicle at the time of the frame; needed with ``pixel_pose``.
    """
    rows, columns = image.shape[:2]
    row, column = np.nonzero(image[..., 0] > 0)
    distance = image[row, column, 0].astype(np.float64)
    extrinsic = calibration.extrinsic
    turn = ((columns - column - 0.5) / columns * 2.0 - 1.0) * np.pi - np.arctan2(extrinsic[1, 0], extrinsic[0, 0])
    tilt = calibration.inclinations[row]
    ray = np.stack([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)], axis=1)
    xyz = (distance[:, None] * ray) @ extrinsic[:3, :3].T + extrinsic[:3, 3]
    if pixel_pose is not None:
        assert frame_pose is not None
        pose = pixel_pose[row, column].astype(np.float64)
        world = np.einsum('nij,nj->ni', rotations(pose[:, 0], pose[:, 1], pose[:, 2]), xyz) + pose[:, 3:6]
        xyz = (world - frame_pose[:3, 3]) @ frame_pose[:3, :3]
    return LaserPoints(xyz, image[row, column, 1], image[row, column, 3] > 0, extrinsic[:3, 3])


class FrameFiles(NamedTuple):
    """The files of one segment; ``component('lidar')`` is one of them."""

    root: Path
    segment: str

    def component(self, name: str) -> Path:
        """``SPLIT/COMPONENT/SEGMENT.parquet``."""
        return self.root / name / f'{self.segment}.parquet'


def read_points(files: FrameFiles, time: int, returns: Sequence[int], lasers: Sequence[int]) -> list[LaserPoints]:
    """Points of a frame, laser by laser, return by return.

    Raises:
        SceneError: A component, a column or the frame is missing.
    """
    path = files.component('lidar')
    parts = [f'{LIDAR}.range_image_return{number}.{part}' for number in returns for part in ('values', 'shape')]
    columns = read_rows(path, (LASER, *parts), time)
    if not columns[LASER]:
        raise SceneError(f'{path}: no frame at {time} microseconds')
    images: dict[tuple[int, int], np.ndarray] = {}
    for row, laser in enumerate(_laser(name, path) for name in columns[LASER]):
        for number in returns if laser in lasers else ():
            values, shape = (columns[f'{LIDAR}.range_image_return{number}.{part}'][row] for part in ('values', 'shape'))
            image = _image(values, shape, f'{path}, laser {laser}, return {number}', CHANNELS)
            if image is None and number == 1:
                raise SceneError(f'{path}, laser {laser}, return 1: no range image; download the file again')
            if image is not None:
                images[laser, number] = image
    calibration = read_calibration(
        files.component('lidar_calibration'), {laser: len(image) for (laser, _), image in images.items()}
    )
    moving = _poses(files, time) if any(laser == TOP for laser, _ in images) else (None, None)
    still = (None, None)
    for (laser, number), image in images.items():
        if laser == TOP and moving[0] is not None and moving[0].shape[:2] != image.shape[:2]:
            raise SceneError(
                f'{files.component("lidar_pose")}: poses of {moving[0].shape[:2]} pixels, but return {number} of laser '
                f'{TOP} has {image.shape[:2]}; download both again'
            )
    return [
        image_points(image, calibration[laser], *(moving if laser == TOP else still))
        for (laser, _), image in sorted(images.items())
    ]


def _laser(name: Any, path: Path) -> int:
    number = name.as_py()
    if not isinstance(number, int):
        raise SceneError(f'{path}: {LASER}: expected 1 to 5, got {number!r}; download the file again')
    return number


def _poses(files: FrameFiles, time: int) -> tuple[np.ndarray, np.ndarray]:
    """Pose of the vehicle at each pixel of the top laser, and at the time of the frame."""
    path, part = files.component('lidar_pose'), f'{PIXEL_POSE}.range_image_return1'
    rows = read_rows(path, (LASER, f'{part}.values', f'{part}.shape'), time)
    top = [row for row, laser in enumerate(rows[LASER]) if laser.as_py() == TOP]
    if not top:
        raise SceneError(f'{path}: no pose of laser {TOP} at {time} microseconds')
    image = _image(rows[f'{part}.values'][top[0]], rows[f'{part}.shape'][top[0]], str(path), POSE_NUMBERS)
    if image is None:
        raise SceneError(f'{path}: the pose of laser {TOP} at {time} microseconds is empty')
    return image, read_vehicle_pose(files, time)


def read_vehicle_pose(files: FrameFiles, time: int) -> Float[np.ndarray, '4 4']:
    """World from vehicle at the time of a frame."""
    path, column = files.component('vehicle_pose'), f'{POSE}.world_from_vehicle.transform'
    found = read_rows(path, (column,), time)[column]
    if not found:
        raise SceneError(f'{path}: no pose at {time} microseconds')
    return read_matrix(found[0].as_py(), f'{path}, at {time} microseconds')


def read_boxes(files: FrameFiles, time: int) -> WaymoBoxes:
    """Every labelled box of a frame that holds a lidar point, signs among them.

    Raises:
        SceneError: The component or a column is missing, or a box is not valid.
    """
    path = files.component('lidar_box')
    rows = read_rows(path, BOX_COLUMNS, time)
    columns = [[value.as_py() for value in rows[name]] for name in BOX_COLUMNS]
    columns[-1] = [level or 0 for level in columns[-1]]  # most boxes have none
    table = np.array([_numbers(column, f'{path}: {name}') for name, column in zip(BOX_COLUMNS, columns, strict=True)]).T
    table = table.reshape(-1, len(BOX_COLUMNS))
    if (table[:, 3:6] <= 0).any():
        raise SceneError(f'{path}: a box at {time} microseconds has a size that is not above 0; download it again')
    types, points, given = table[:, 7:10].astype(np.int64).T
    if strange := sorted(set(types.tolist()) - {*TYPES.values(), *OTHER_TYPES}):
        raise SceneError(f'{path}: {BOX}.type: expected 0 to 4, got {strange[0]}; download it again')
    level = np.where(given > 0, given, np.where(points <= FEW_POINTS, 2, 1))
    return WaymoBoxes(table[:, :7], types, points, level).select(points > 0)


def _numbers(values: Sequence[Any], where: str) -> Float[np.ndarray, ' boxes']:
    """One field of all boxes.

    Raises:
        SceneError: One is empty, NaN or no number.
    """
    for row, value in enumerate(values):
        if not isinstance(value, int | float) or not np.isfinite(value):
            raise SceneError(f'{where}: expected a finite number, got {value!r} in box {row}; download the file again')
    return np.array(values, dtype=np.float64)
