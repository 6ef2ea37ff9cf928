"""SemanticKITTI files as they are on disk: raw label ids, the 19 classes, label files, calibration and poses."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.datasets.kitti_format import is_rotation
from rm3d_plugin.storage.plain_files import read_text
from rm3d_plugin.structures import UNLABELLED, SceneError

CLASSES = (
    'car', 'bicycle', 'motorcycle', 'truck', 'other-vehicle', 'person', 'bicyclist', 'motorcyclist', 'road', 'parking',
    'sidewalk', 'other-ground', 'building', 'fence', 'vegetation', 'trunk', 'terrain', 'pole', 'traffic-sign',
)  # fmt: skip
NUM_THINGS = 8  # the first classes have instances
# The benchmark's merge: raw id -> class name, None = ignored. Moving things count as their resting kind.
RAW_TO_NAME: dict[int, str | None] = {
    0: None, 1: None, 10: 'car', 11: 'bicycle', 13: 'other-vehicle', 15: 'motorcycle', 16: 'other-vehicle',
    18: 'truck', 20: 'other-vehicle', 30: 'person', 31: 'bicyclist', 32: 'motorcyclist', 40: 'road', 44: 'parking',
    48: 'sidewalk', 49: 'other-ground', 50: 'building', 51: 'fence', 52: None, 60: 'road', 70: 'vegetation',
    71: 'trunk', 72: 'terrain', 80: 'pole', 81: 'traffic-sign', 99: None, 252: 'car', 253: 'bicyclist', 254: 'person',
    255: 'motorcyclist', 256: 'other-vehicle', 257: 'other-vehicle', 258: 'truck', 259: 'other-vehicle',
}  # fmt: skip
# What a submission says for each class: the benchmark's inverse map.
CLASS_TO_RAW = np.array([10, 11, 15, 18, 20, 30, 31, 32, 40, 44, 48, 49, 50, 51, 70, 71, 72, 80, 81])
_UNKNOWN = -2
CLIPPED = 0.01  # share of remissions that may lie outside of 0 to 1


class RawLabels(NamedTuple):
    """A label file.

    Attributes:
        semantic: (N,) int64 raw ids, the low 16 bits.
        instance: (N,) int64, the high 16 bits; 0 = none.
    """

    semantic: Int[np.ndarray, ' points']
    instance: Int[np.ndarray, ' points']


def read_labels(path: str | Path, num_points: int) -> RawLabels:
    """Read one ``.label`` file.

    Args:
        path: The file: one little-endian uint32 a point.
        num_points: Points of its scan.

    Raises:
        SceneError: The file is missing, cut off within a label, or of another number of points.
    """
    path = Path(path)
    if not path.is_file():
        raise SceneError(f'{path}: no such file; expected the labels of a scan')
    data = path.read_bytes()
    if len(data) % 4:
        raise SceneError(f'{path}: {len(data)} bytes are no multiple of 4 (uint32 a point); cut off? copy it again')
    if len(data) != 4 * num_points:
        raise SceneError(f'{path}: {len(data) // 4} labels, but the scan has {num_points} points; copy both again')
    packed = np.frombuffer(data, dtype='<u4')
    return RawLabels((packed & 0xFFFF).astype(np.int64), (packed >> 16).astype(np.int64))


def merge_ids(raw: Int[np.ndarray, ' points'], where: str | Path) -> Int[np.ndarray, ' points']:
    """Class 0 .. 18 of raw ids, -1 where the benchmark ignores them.

    Args:
        raw: Raw ids.
        where: Named in the error.

    Raises:
        SceneError: Ids that SemanticKITTI does not have, listed with their counts.
    """
    table = np.full(1 << 16, _UNKNOWN, dtype=np.int64)
    for number, name in RAW_TO_NAME.items():
        table[number] = UNLABELLED if name is None else CLASSES.index(name)
    merged = table[raw]
    strange, count = np.unique(raw[merged == _UNKNOWN], return_counts=True)
    if len(strange):
        found = ', '.join(f'{i} ({n} points)' for i, n in zip(strange, count, strict=True))
        raise SceneError(f'{where}: label ids that SemanticKITTI does not have: {found}; another format?')
    return merged


def number_instances(
    semantic: Int[np.ndarray, ' points'], instance: Int[np.ndarray, ' points']
) -> Int[np.ndarray, ' points']:
    """Instances 0, 1, ... in ascending order of (class, raw instance), -1 elsewhere.

    Args:
        semantic: Classes; instances of other classes than the first NUM_THINGS do not count.
        instance: Raw instance numbers, which may repeat between classes; 0 = none.
    """
    thing = (semantic >= 0) & (semantic < NUM_THINGS) & (instance > 0)
    numbers = np.full(len(semantic), UNLABELLED, dtype=np.int64)
    _, inverse = np.unique(semantic[thing] << 16 | instance[thing], return_inverse=True)
    numbers[thing] = inverse.reshape(-1)
    return numbers


def unit_remission(remission: Float[np.ndarray, ' points'], path: Path) -> Float[np.ndarray, ' points']:
    """Remissions in [0, 1]; a few may lie outside and are clipped.

    Raises:
        SceneError: More do: they are counted otherwise.
    """
    outside = float(((remission < 0) | (remission > 1)).mean())
    if outside > CLIPPED:
        raise SceneError(
            f'{path}: remission: expected 0 to 1, got {remission.min():g} to {remission.max():g}; divide it by its '
            'greatest value, or leave it out: use_intensity=False'
        )
    return np.clip(remission, 0.0, 1.0)


def pack_labels(semantic: Int[np.ndarray, ' points'], instance: Int[np.ndarray, ' points']) -> bytes:
    """The bytes of a label file from raw ids and raw instance numbers, both below 65536."""
    return (semantic.astype('<u4') | instance.astype('<u4') << 16).tobytes()


def read_lidar_poses(folder: str | Path) -> Float[np.ndarray, 'scans 4 4'] | None:
    """World from lidar for each scan of a sequence, where ``calib.txt`` and ``poses.txt`` are both there, else None.

    ``poses.txt`` is about the left camera: world = poses (camera from lidar), and the first scan's lidar frame is the
    world: inverse(Tr) pose Tr.

    Raises:
        SceneError: A file is there but cannot be read.
    """
    folder = Path(folder)
    if not (folder / 'poses.txt').is_file() or not (folder / 'calib.txt').is_file():
        return None
    lines = read_text(folder / 'calib.txt', strict=False).split('\n')
    rows = [line.partition(':')[2] for line in lines if line.startswith('Tr:')]
    if len(rows) != 1:
        raise SceneError(f'{folder / "calib.txt"}: expected one line "Tr:", got {len(rows)}')
    camera_from_lidar = _matrices(rows, folder / 'calib.txt')[0]
    if not is_rotation(camera_from_lidar[:3, :3]):
        raise SceneError(f'{folder / "calib.txt"}: Tr: its first three columns are no rotation; copy the file again')
    text = read_text(folder / 'poses.txt', strict=False)
    poses = _matrices([line for line in text.split('\n') if line.strip()], folder / 'poses.txt')
    if bad := [number for number, pose in enumerate(poses, start=1) if not is_rotation(pose[:3, :3])]:
        raise SceneError(
            f'{folder / "poses.txt"}: row {bad[0]}: its first three columns are no rotation; copy the file again'
        )
    return np.linalg.inv(camera_from_lidar) @ poses @ camera_from_lidar


def _matrices(rows: list[str], path: Path) -> Float[np.ndarray, 'rows 4 4']:
    matrices = np.tile(np.eye(4), (len(rows), 1, 1))
    for number, row in enumerate(rows):
        try:
            matrices[number, :3] = np.array(row.split(), dtype=np.float64).reshape(3, 4)
        except ValueError:
            raise SceneError(f'{path}: row {number + 1}: expected 12 numbers, got {row.strip()[:60]!r}') from None
    if not np.isfinite(matrices).all():
        raise SceneError(f'{path}: a number is NaN or infinite')
    return matrices
