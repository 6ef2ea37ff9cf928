"""Synthetic streets as a Waymo Open Dataset, perception v2: parquet files, one a segment and component."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from rm3d_plugin.datasets.kitti_format import invert_affine, transform, wrap_angle
from rm3d_plugin.datasets.synthetic.lidar import EDGE, Anchor, Hits, Scan, SpinningLidar, cast, make_beams, scan
from rm3d_plugin.datasets.synthetic.road_users import RoadUser
from rm3d_plugin.datasets.synthetic.room_demo import fill_demo
from rm3d_plugin.datasets.synthetic.shapes import Mesh, join
from rm3d_plugin.datasets.synthetic.street_ground import SENSOR_HEIGHT
from rm3d_plugin.datasets.synthetic.street_scans import (
    STREETS_VERSION,
    VAL_STREETS,
    Pose,
    check_counts,
    generator,
    pose_on_road,
    seen_from,
)
from rm3d_plugin.datasets.synthetic.streets import Placed, Street, make_street
from rm3d_plugin.datasets.waymo_format import (
    BOX,
    CALIBRATION,
    CHANNELS,
    LIDAR,
    PIXEL_POSE,
    POSE,
    SPLITS,
    TOP,
    TYPES,
)
from rm3d_plugin.datasets.waymo_tables import LASER, SEGMENT, TIME, parquet
from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.storage import write_bytes

VERSION = 1  # raise whenever the bytes of a frame change; STREETS_VERSION counts, too
README = """This folder is SYNTHETIC. rm3d_plugin made it: parametric streets, scanned by a virtual lidar of 64 beams.
The files have the format of the Waymo Open Dataset (perception v2), but none of the content comes from it, and a score
on them says nothing about real data. demo.json holds the parameters; delete the folder to make it afresh.
"""
FAR = 75.0  # m; further objects are not labelled
STEP = 2.0  # m between two frames of a segment
PERIOD = 100_000  # microseconds between two frames
MOUNTED = 2.6  # radians; how the top laser is turned, whose rows begin behind it
_KINDS = {'Car': 'Vehicle', 'Van': 'Vehicle', 'Pedestrian': 'Pedestrian', 'Person_sitting': 'Pedestrian'}


class WaymoFrame(NamedTuple):
    """One frame as rows of the components.

    Attributes:
        time: Microseconds.
        images: Range images (rows, columns, 4) of the two returns of the top laser.
        extrinsic: (4, 4) vehicle from laser.
        inclinations: Radians, ascending.
        pose: (4, 4) world from vehicle.
        boxes: (M, 7) vehicle frame.
        types: (M,).
        ids: Of the objects, the same through a segment.
        points: (M,) points in each box.
    """

    time: int
    images: tuple[np.ndarray, np.ndarray]
    extrinsic: Float[np.ndarray, '4 4']
    inclinations: np.ndarray
    pose: Float[np.ndarray, '4 4']
    boxes: Float[np.ndarray, 'boxes 7']
    types: np.ndarray
    ids: list[str]
    points: np.ndarray


def make_waymo_streets(
    root: Path | str,
    num_train: int = 100,
    num_val: int = 40,
    seed: int = 0,
    azimuth_step: float = 0.36,
    frames_per_segment: int = 1,
    workers: int = 1,
    progress: bool = True,
) -> Path:
    """Make a synthetic Waymo data set, or leave it as it is where it is complete and of these parameters.

    Args:
        root: Folder to fill; a folder that holds anything else is refused.
        num_train: Training segments.
        num_val: Validation segments.
        seed: Another seed makes other streets.
        azimuth_step: Degrees between two firings, an even part of the turn. Larger: fewer points, faster.
        frames_per_segment: Frames two metres apart on one street.
        workers: Processes, at most one for each split.
        progress: Show a bar.

    Returns:
        The root as a path.

    Raises:
        ValueError: The folder holds files that this function did not make, or a number is out of range.
        SceneError: pyarrow is not installed.
    """
    root = Path(root)
    parquet()  # missing is told before streets are made
    check_counts(num_train=num_train, num_val=num_val)
    columns = 360.0 / azimuth_step
    if abs(columns - round(columns)) > 1e-6 or round(columns) % 2 or not 1 <= frames_per_segment <= 10:
        raise ValueError(
            f'expected an azimuth_step that an even number of times makes 360 and 1 to 10 frames, got {azimuth_step} '
            f'and {frames_per_segment}'
        )
    lidar = SpinningLidar(azimuth_step)
    splits = (('train', 0, num_train), ('val', VAL_STREETS, num_val))
    todo = [
        (root / SPLITS[split], partial(_write_split, seed, range(first, first + count), frames_per_segment, lidar))
        for split, first, count in splits
        if count
    ]
    recipe = {'format': 'waymo', 'version': VERSION, 'streets': STREETS_VERSION, 'synthetic': True, 'seed': seed}
    recipe |= {'azimuth_step': azimuth_step, 'frames_per_segment': frames_per_segment}
    recipe |= {'num_train': num_train, 'num_val': num_val}  # a split is made as a whole
    owned = tuple(SPLITS.values())
    return fill_demo(root, recipe, {}, owned, README, todo, _nothing, workers, progress, 'synthetic Waymo splits')


def _nothing() -> None:
    """There are no lists to write."""


def _write_split(seed: int, streets: Sequence[int], frames: int, lidar: SpinningLidar, folder: Path) -> None:
    for street in streets:
        name = f'synthetic_{seed:02d}_{street:07d}'
        write_segment(folder, name, make_segment(seed, street, frames, lidar))


def make_segment(seed: int, number: int, frames: int, lidar: SpinningLidar) -> list[WaymoFrame]:
    """Frames along one street; depends on nothing but the arguments."""

    def stay(_: RoadUser, x: float, y: float, z: float, yaw: float) -> tuple[np.ndarray, float]:
        return np.round(np.array([x, y, z]), 6), yaw

    street = make_street(generator(seed, number), stay)
    mesh = join([placed.mesh for placed in street.placed] + street.background)
    return [_frame(street, mesh, step, lidar, generator(seed, number, 2 + step)) for step in range(frames)]


def _frame(street: Street, mesh: Mesh, step: int, lidar: SpinningLidar, rng: np.random.Generator) -> WaymoFrame:
    on_road = pose_on_road(street.road, step * STEP)
    half = float(np.deg2rad(lidar.azimuth_step)) / 2  # pixels are told by their middles
    sensor = Pose(on_road.position, on_road.yaw + half)
    seen = seen_from(mesh, sensor)
    hits = cast(seen.corners, make_beams(lidar), lidar.max_range)
    x, y, z = (float(v) for v in sensor.position)
    returned = scan(seen, hits, lidar, rng, Anchor(x, y, z, sensor.yaw))
    pose = on_road.matrix
    pose[2, 3] -= SENSOR_HEIGHT
    boxes, types = _boxes(street.placed, pose)
    ids = [f'object_{number:04d}' for number in range(len(boxes))]
    near = np.hypot(boxes[:, 0], boxes[:, 1]) <= FAR
    vehicle_from_sensor = np.eye(4)
    vehicle_from_sensor[:2, :2] = [[np.cos(half), -np.sin(half)], [np.sin(half), np.cos(half)]]
    vehicle_from_sensor[2, 3] = SENSOR_HEIGHT
    xyz = transform(returned.xyz, vehicle_from_sensor)
    inside = points_in_boxes(xyz, boxes[near])
    return WaymoFrame(
        time=1_500_000_000_000_000 + step * PERIOD,
        images=range_images(returned, hits, lidar),
        extrinsic=_extrinsic(),
        inclinations=np.deg2rad(lidar.elevations)[::-1],
        pose=pose,
        boxes=boxes[near],
        types=types[near],
        ids=[name for name, keep in zip(ids, near.tolist(), strict=True) if keep],
        points=np.bincount(inside[inside >= 0], minlength=int(near.sum())),
    )


def _extrinsic() -> Float[np.ndarray, '4 4']:
    """Vehicle from top laser: upright on the roof, turned."""
    matrix = np.eye(4)
    c, s = np.cos(MOUNTED), np.sin(MOUNTED)
    matrix[:2, :2] = [[c, -s], [s, c]]
    matrix[2, 3] = SENSOR_HEIGHT
    return matrix


def _boxes(placed: Sequence[Placed], pose: Float[np.ndarray, '4 4']) -> tuple[np.ndarray, np.ndarray]:
    """Boxes and types of the road users in the frame of the vehicle."""
    size = np.array([item.user.size for item in placed]).reshape(-1, 3)
    middle = np.array([item.bottom for item in placed]).reshape(-1, 3) + size * [0, 0, 0.5]
    turn = float(np.arctan2(pose[1, 0], pose[0, 0]))
    yaw = wrap_angle(np.array([item.yaw for item in placed]) - turn)
    center = transform(middle, invert_affine(pose))
    types = [TYPES[_KINDS.get(item.user.type, 'Cyclist')] for item in placed]
    return np.concatenate([center, size, yaw[:, None]], axis=1), np.array(types, dtype=np.int64)


def range_images(returned: Scan, hits: Hits, lidar: SpinningLidar) -> tuple[np.ndarray, np.ndarray]:
    """First and second returns as range images, highest beam first.

    A beam at the edge of a thing sends back what lies behind it, too: where the first return lies between two surfaces
    the second is the farther one.
    """
    beams, columns = len(lidar.elevations), len(lidar.azimuths)
    distance = np.linalg.norm(returned.xyz, axis=1)
    tilt = np.arcsin(np.clip(returned.xyz[:, 2] / distance, -1, 1))
    row = np.abs(tilt[:, None] - np.deg2rad(lidar.elevations)[None]).argmin(axis=1)
    turn = np.arctan2(returned.xyz[:, 1], returned.xyz[:, 0]) / np.deg2rad(lidar.azimuth_step)
    number = np.round(turn).astype(np.int64) % columns
    column = (columns // 2 - 1 - number) % columns
    first, second = np.zeros((2, beams, columns, CHANNELS), dtype=np.float32)
    first[row, column, 0], first[row, column, 1] = distance, returned.intensity
    image = hits.distance.reshape(beams, columns)
    behind = np.maximum(np.roll(image, 1, axis=1), np.roll(image, -1, axis=1))[row, number]
    twice = returned.mixed & np.isfinite(behind) & (behind > distance + EDGE)
    second[row[twice], column[twice], 0] = behind[twice]
    second[row[twice], column[twice], 1] = 0.5 * returned.intensity[twice]
    return first, second


# ------------------------------------------------------------------ files


def write_segment(folder: Path, segment: str, frames: Sequence[WaymoFrame]) -> None:
    """Write the five components of a segment below ``folder`` (of a split)."""
    times = [frame.time for frame in frames]
    shapes = [list(frame.images[0].shape) for frame in frames]
    lidar: dict[str, Any] = {SEGMENT: segment, TIME: times, LASER: [TOP] * len(frames)}
    for number in (1, 2):
        part = f'{LIDAR}.range_image_return{number}'
        lidar |= {f'{part}.values': [frame.images[number - 1].ravel() for frame in frames], f'{part}.shape': shapes}
    part = f'{PIXEL_POSE}.range_image_return1'
    poses = [_pixel_pose(frame) for frame in frames]
    pixel = {SEGMENT: segment, TIME: times, LASER: [TOP] * len(frames)}
    pixel |= {f'{part}.values': [pose.ravel() for pose in poses], f'{part}.shape': [list(p.shape) for p in poses]}
    beams = frames[0].inclinations
    angles = f'{CALIBRATION}.beam_inclination'
    calibration = {SEGMENT: segment, LASER: [TOP], f'{CALIBRATION}.extrinsic.transform': [frames[0].extrinsic.ravel()]}
    calibration |= {
        f'{angles}.min': [float(beams[0])],
        f'{angles}.max': [float(beams[-1])],
        f'{angles}.values': [beams],
    }
    pose = {SEGMENT: segment, TIME: times, f'{POSE}.world_from_vehicle.transform': [f.pose.ravel() for f in frames]}
    tables = {'lidar': lidar, 'lidar_pose': pixel, 'lidar_calibration': calibration, 'vehicle_pose': pose}
    for component, columns in {**tables, 'lidar_box': _box_columns(segment, frames)}.items():
        write_table(folder / component / f'{segment}.parquet', columns)


def _pixel_pose(frame: WaymoFrame) -> Float[np.ndarray, 'rows columns 6']:
    """The same pose at each pixel: the car stood still while it scanned, on a level road."""
    yaw = np.arctan2(frame.pose[1, 0], frame.pose[0, 0])
    six = np.array([0.0, 0.0, yaw, *frame.pose[:3, 3]], dtype=np.float32)
    return np.broadcast_to(six, (*frame.images[0].shape[:2], 6))


def _box_columns(segment: str, frames: Sequence[WaymoFrame]) -> dict[str, Any]:
    boxes = np.concatenate([frame.boxes for frame in frames])
    numbers = np.concatenate([frame.points for frame in frames])
    columns: dict[str, Any] = {
        SEGMENT: segment,
        TIME: [frame.time for frame in frames for _ in frame.ids],
        'key.laser_object_id': [name for frame in frames for name in frame.ids],
    }
    names = [f'{BOX}.box.center.{axis}' for axis in 'xyz'] + [f'{BOX}.box.size.{axis}' for axis in 'xyz']
    columns |= {name: boxes[:, i] for i, name in enumerate([*names, f'{BOX}.box.heading'])}
    columns |= {f'{BOX}.type': np.concatenate([frame.types for frame in frames]).astype(np.int8)}
    counts = ('num_lidar_points_in_box', 'num_top_lidar_points_in_box')
    return (
        columns
        | {f'{BOX}.{name}': numbers for name in counts}
        | {f'{BOX}.difficulty_level.detection': np.zeros(len(boxes), dtype=np.int8)}
    )


def write_table(path: Path, columns: dict[str, Any]) -> None:
    """Write one parquet file, atomically; a column that is a word is that word in every row."""
    import pyarrow

    rows = max(len(values) for values in columns.values() if not isinstance(values, str))
    arrays = {name: [values] * rows if isinstance(values, str) else values for name, values in columns.items()}
    buffer = pyarrow.BufferOutputStream()
    parquet().write_table(pyarrow.table({name: _array(values) for name, values in arrays.items()}), buffer)
    write_bytes(path, buffer.getvalue().to_pybytes())


def _array(values: Any) -> Any:
    """Lists of arrays as one list column, without a Python object for each number."""
    import pyarrow

    if not isinstance(values, list) or not values or not isinstance(values[0], np.ndarray):
        return pyarrow.array(values)
    offsets = np.cumsum([0, *map(len, values)]).astype(np.int32)
    return pyarrow.ListArray.from_arrays(offsets, np.concatenate(values))
