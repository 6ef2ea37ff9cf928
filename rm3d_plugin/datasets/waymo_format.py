"""Waymo Open Dataset, perception v2: parquet files, one a segment and component, and the points of range images.

Frames: *laser* is that of one lidar; *vehicle* (x forward, y left, z up, origin on the ground) is the scene frame;
*world* is fixed. Needs pyarrow, the extra ``waymo``.
"""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.structures import SceneError

SPLITS = {'train': 'training', 'val': 'validation', 'test': 'testing'}
TOP = 1  # laser that turns on the roof; 2 front, 3 side left, 4 side right, 5 rear
TYPES = {'Vehicle': 1, 'Pedestrian': 2, 'Cyclist': 4}  # 3 are signs
SEGMENT, TIME, LASER = 'key.segment_context_name', 'key.frame_timestamp_micros', 'key.laser_name'
LIDAR, CALIBRATION = '[LiDARComponent]', '[LiDARCalibrationComponent]'
PIXEL_POSE, POSE, BOX = '[LiDARPoseComponent]', '[VehiclePoseComponent]', '[LiDARBoxComponent]'
CHANNELS = 4  # of a range image: range in metres, intensity, elongation, whether in a no-label zone
FEW_POINTS = 5  # a box with so few points is of level 2, where nobody said otherwise
_ROWS_AT_ONCE = 16  # a range image of the top laser is 2.7 MB

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


def parquet() -> Any:
    """The module pyarrow.parquet.

    Raises:
        SceneError: It is not installed.
    """
    try:
        import pyarrow.parquet
    except ImportError:
        raise SceneError("Waymo's parquet files need pyarrow: pip install 'rm3d_plugin[waymo]'") from None
    return pyarrow.parquet


# ------------------------------------------------------------------ tables


@lru_cache(maxsize=256)
def _times(path: Path, stamp: tuple[int, int]) -> Int[np.ndarray, ' rows']:
    table = _open(path).read(columns=[TIME])
    return np.asarray(table.column(TIME).to_numpy(), dtype=np.int64)


def _open(path: Path) -> Any:
    if not path.is_file():
        component, segment = path.parent.name, path.stem
        raise SceneError(
            f'{path}: no such file; segment {segment} lacks the component {component!r}: download it, or take the '
            'segment off the list'
        )
    try:
        return parquet().ParquetFile(path)
    except Exception as error:  # pyarrow raises errors of its own for every kind of damage
        raise SceneError(f'{path}: not a parquet file ({error}); download it again') from error


def frame_times(path: Path) -> Int[np.ndarray, ' rows']:
    """Time of each row of a file, microseconds.

    Raises:
        SceneError: The file is missing, damaged, or has no such column.
    """
    if path.is_file():
        _check_columns(_open(path), (TIME,), path)
    else:
        _open(path)  # tells what is missing
    state = path.stat()
    return _times(path, (state.st_mtime_ns, state.st_size))


def _check_columns(file: Any, columns: Sequence[str], path: Path) -> None:
    there = set(file.schema_arrow.names)
    if missing := [name for name in columns if name not in there]:
        raise SceneError(
            f'{path}: no column {missing[0]!r}; expected perception v2 of the Waymo Open Dataset, got '
            f'{", ".join(sorted(there)[:6])} ...'
        )


def read_rows(path: Path, columns: Sequence[str], time: int | None = None) -> dict[str, list[Any]]:
    """Columns of the rows of one frame, or of all rows.

    Args:
        path: ``SPLIT/COMPONENT/SEGMENT.parquet``.
        columns: Their names.
        time: Microseconds; None: every row.

    Raises:
        SceneError: The file or a column is missing.
    """
    file = _open(path)
    _check_columns(file, columns, path)
    if time is None:
        return file.read(columns=list(columns)).to_pydict()
    wanted = np.flatnonzero(frame_times(path) == time)
    found: dict[str, list[Any]] = {name: [] for name in columns}
    ends = np.cumsum([file.metadata.row_group(g).num_rows for g in range(file.metadata.num_row_groups)])
    groups = np.unique(np.searchsorted(ends, wanted, side='right'))
    for group in groups.tolist():
        first = 0 if group == 0 else int(ends[group - 1])
        for batch in file.iter_batches(_ROWS_AT_ONCE, row_groups=[group], columns=list(columns)):
            here = wanted[(wanted >= first) & (wanted < first + len(batch))] - first
            for name in columns if len(here) else ():
                found[name] += [batch.column(name)[row] for row in here.tolist()]
            first += len(batch)
    return found


def _image(values: Any, shape: Any, where: str) -> Float[np.ndarray, 'rows columns channels'] | None:
    """A range image; None where a frame has none."""
    if not values.is_valid or len(values.values) == 0:
        return None
    size = tuple(shape.as_py() or ())
    numbers = np.asarray(values.values, dtype=np.float32)
    if len(size) != 3 or int(np.prod(size)) != len(numbers):
        raise SceneError(f'{where}: shape {size} does not fit {len(numbers)} values')
    return numbers.reshape(size)


# ------------------------------------------------------------------ components


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
            beams = inclinations(rows_of[laser], low, high, values)
            found[laser] = LaserCalibration(np.array(extrinsic, dtype=np.float64).reshape(4, 4), beams)
    if missing := sorted(set(rows_of) - set(found)):
        raise SceneError(f'{path}: no calibration of laser {missing[0]}; got {sorted(found)}')
    return found


def inclinations(
    rows: int, low: float, high: float, values: Sequence[float] | None = None
) -> Float[np.ndarray, ' rows']:
    """Radians of the rows of an image, the highest beam first.

    Args:
        rows: Of the image.
        low: Least.
        high: Greatest.
        values: Of each beam, ascending; None or empty: they divide low to high evenly, at the middle of the cells.
    """
    if values is not None and len(values):
        if len(values) != rows:
            raise SceneError(f'lidar_calibration: {len(values)} beam inclinations for an image of {rows} rows')
        return np.asarray(values, dtype=np.float64)[::-1].copy()
    middles = (np.arange(rows) + 0.5) / rows
    return (low + middles * (high - low))[::-1].copy()


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
    for row, laser in enumerate(int(name.as_py()) for name in columns[LASER]):
        for number in returns if laser in lasers else ():
            values, shape = (columns[f'{LIDAR}.range_image_return{number}.{part}'][row] for part in ('values', 'shape'))
            image = _image(values, shape, f'{path}, laser {laser}, return {number}')
            if image is not None:
                images[laser, number] = image
    calibration = read_calibration(
        files.component('lidar_calibration'), {laser: len(image) for (laser, _), image in images.items()}
    )
    moving = _poses(files, time) if any(laser == TOP for laser, _ in images) else (None, None)
    still = (None, None)
    return [
        image_points(image, calibration[laser], *(moving if laser == TOP else still))
        for (laser, _), image in sorted(images.items())
    ]


def _poses(files: FrameFiles, time: int) -> tuple[np.ndarray, np.ndarray]:
    """Pose of the vehicle at each pixel of the top laser, and at the time of the frame."""
    path, part = files.component('lidar_pose'), f'{PIXEL_POSE}.range_image_return1'
    rows = read_rows(path, (LASER, f'{part}.values', f'{part}.shape'), time)
    top = [row for row, laser in enumerate(rows[LASER]) if laser.as_py() == TOP]
    if not top:
        raise SceneError(f'{path}: no pose of laser {TOP} at {time} microseconds')
    image = _image(rows[f'{part}.values'][top[0]], rows[f'{part}.shape'][top[0]], str(path))
    if image is None:
        raise SceneError(f'{path}: the pose of laser {TOP} at {time} microseconds is empty')
    return image, read_vehicle_pose(files, time)


def read_vehicle_pose(files: FrameFiles, time: int) -> Float[np.ndarray, '4 4']:
    """World from vehicle at the time of a frame."""
    path, column = files.component('vehicle_pose'), f'{POSE}.world_from_vehicle.transform'
    found = read_rows(path, (column,), time)[column]
    if not found:
        raise SceneError(f'{path}: no pose at {time} microseconds')
    return np.array(found[0].as_py(), dtype=np.float64).reshape(4, 4)


def read_boxes(files: FrameFiles, time: int) -> WaymoBoxes:
    """Every labelled box of a frame that holds a lidar point, signs among them.

    Raises:
        SceneError: The component or a column is missing, or a box is not valid.
    """
    path = files.component('lidar_box')
    rows = read_rows(path, BOX_COLUMNS, time)
    table = np.array([[value.as_py() or 0.0 for value in rows[name]] for name in BOX_COLUMNS], dtype=np.float64).T
    table = table.reshape(-1, len(BOX_COLUMNS))
    if not np.isfinite(table).all() or (table[:, 3:6] <= 0).any():
        raise SceneError(f'{path}: a box at {time} microseconds has a size that is not above 0 or a number that is NaN')
    types, points, given = table[:, 7:10].astype(np.int64).T
    level = np.where(given > 0, given, np.where(points <= FEW_POINTS, 2, 1))
    return WaymoBoxes(table[:, :7], types, points, level).select(points > 0)
