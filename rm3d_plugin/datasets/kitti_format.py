"""KITTI object files as they are on disk: calibration, labels, Velodyne scans, and the frames between them.

Frames: *lidar* (x forward, y left, z up) is the scene frame of :class:`Boxes3D`; *rect* is the rectified camera 0
(x right, y down, z forward), where KITTI writes its labels; *image* is the left colour image in pixels. Every sum is
written out, so that the same file gives the same bits with any BLAS.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from rm3d_plugin.class_names import class_index
from rm3d_plugin.storage import write_text
from rm3d_plugin.storage.float_records import check_float_width
from rm3d_plugin.storage.plain_files import read_number, read_text
from rm3d_plugin.structures import Boxes3D, SceneError

IMAGE_SIZE = (1242, 375)  # pixels, width and height of most KITTI images
NEAR = 0.1  # m; what is closer to the image plane than this is cut off before projecting
DONT_CARE = 'DontCare'
MOST_TURN = 4 * np.pi  # radians that an object's turn may be written with; DontCare has -10
TYPES = ('Car', 'Van', 'Truck', 'Pedestrian', 'Person_sitting', 'Cyclist', 'Tram', 'Misc', DONT_CARE)
_SPELLING = {name.lower(): name for name in TYPES}
_FIELDS = ('truncated', 'occluded', 'alpha', 'x1', 'y1', 'x2', 'y2', 'h', 'w', 'l', 'x', 'y', 'z', 'ry', 'score')
_PNG_SIGNATURE = b'\x89PNG\r\n\x1a\n'


class Projection(NamedTuple):
    """Points seen in the image.

    Attributes:
        uv: (N, 2) float64 pixels; meaningless where depth is not positive.
        depth: (N,) float64 metres along the optical axis.
    """

    uv: Float[np.ndarray, 'points 2']
    depth: Float[np.ndarray, ' points']


def transform(points: Float[np.ndarray, '*batch 3'], matrix: Float[np.ndarray, 'rows 4']) -> Float[np.ndarray, '...']:
    """Apply the first three rows of an affine (3, 4) or (4, 4) matrix; float64, sums written out."""
    p, m = np.asarray(points, dtype=np.float64), np.asarray(matrix, dtype=np.float64)
    x, y, z = p[..., 0], p[..., 1], p[..., 2]
    return np.stack([m[i, 0] * x + m[i, 1] * y + m[i, 2] * z + m[i, 3] for i in range(3)], axis=-1)


def wrap_angle(angle: Float[np.ndarray, '...'] | float) -> Float[np.ndarray, '...']:
    """Turn radians into [-pi, pi)."""
    wrapped = np.asarray(angle) - 2 * np.pi * np.floor((np.asarray(angle) + np.pi) / (2 * np.pi))
    return np.where(wrapped >= np.pi, -np.pi, wrapped)


def invert_affine(matrix: Float[np.ndarray, '4 4']) -> Float[np.ndarray, '4 4']:
    """Inverse of an affine matrix by cofactors; the rotation need not be orthonormal (KITTI's printed ones are not)."""
    a, t = matrix[:3, :3], matrix[:3, 3]
    cofactor = np.stack([np.cross(a[1], a[2]), np.cross(a[2], a[0]), np.cross(a[0], a[1])], axis=1)
    determinant = a[0, 0] * cofactor[0, 0] + a[0, 1] * cofactor[1, 0] + a[0, 2] * cofactor[2, 0]
    inverse = np.eye(4)
    inverse[:3, :3] = cofactor / determinant
    for i in range(3):
        inverse[i, 3] = -(inverse[i, 0] * t[0] + inverse[i, 1] * t[1] + inverse[i, 2] * t[2])
    return inverse


@dataclass(frozen=True, eq=False)
class KittiCalib:
    """Calibration of one frame.

    Attributes:
        P2: (3, 4) rect frame to the left colour image, pixels.
        R0_rect: (3, 3) camera 0 to rect.
        Tr_velo_to_cam: (3, 4) lidar to camera 0, metres.
        P0, P1, P3: (3, 4) the other cameras, or None where the file has none.
        Tr_imu_to_velo: (3, 4) or None.
    """

    P2: Float[np.ndarray, '3 4']
    R0_rect: Float[np.ndarray, '3 3']
    Tr_velo_to_cam: Float[np.ndarray, '3 4']
    P0: Float[np.ndarray, '3 4'] | None = None
    P1: Float[np.ndarray, '3 4'] | None = None
    P3: Float[np.ndarray, '3 4'] | None = None
    Tr_imu_to_velo: Float[np.ndarray, '3 4'] | None = None
    rect_from_lidar: Float[np.ndarray, '4 4'] = field(init=False, repr=False)
    lidar_from_rect: Float[np.ndarray, '4 4'] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        matrix = np.eye(4)
        r, t = self.R0_rect, self.Tr_velo_to_cam
        for i in range(3):
            matrix[i] = r[i, 0] * t[0] + r[i, 1] * t[1] + r[i, 2] * t[2]
        object.__setattr__(self, 'rect_from_lidar', matrix)
        object.__setattr__(self, 'lidar_from_rect', invert_affine(matrix))

    def project_rect(self, points: Float[np.ndarray, 'points 3']) -> Projection:
        """Pixels and depths of points in the rect frame."""
        image = transform(points, self.P2)
        depth = image[..., 2]
        safe = np.where(np.abs(depth) < 1e-9, 1e-9, depth)
        return Projection(image[..., :2] / safe[..., None], depth)

    def project(self, points: Float[np.ndarray, 'points 3']) -> Projection:
        """Pixels and depths of points in the lidar frame."""
        return self.project_rect(transform(points, self.rect_from_lidar))


@dataclass(frozen=True)
class KittiObject:
    """One line of a KITTI label or result file; the names and the order are KITTI's.

    Attributes:
        type: Class name, of :data:`TYPES` or another; files may spell these in small letters.
        truncated: Share of the object outside the image, in [0, 1]; -1 where unknown.
        occluded: 0 visible, 1 partly, 2 largely occluded, 3 unknown; -1 in DontCare and in results.
        alpha: Observation angle in radians, [-pi, pi].
        bbox: (left, top, right, bottom) in pixels.
        h, w, l: Height, width, length in metres.
        x, y, z: Centre of the *bottom* face in metres, rect frame.
        ry: Turn about the rect frame's y axis in radians; 0 heads along +x.
        score: Confidence of a result, None in a label.
    """

    type: str
    truncated: float
    occluded: int
    alpha: float
    bbox: tuple[float, float, float, float]
    h: float
    w: float
    l: float  # noqa: E741  KITTI's name
    x: float
    y: float
    z: float
    ry: float
    score: float | None = None


def read_calib(path: Path | str) -> KittiCalib:
    """Read one file of ``calib/``.

    Raises:
        SceneError: The file is missing, a key that every reader needs is missing, a row is not numbers of its shape,
            or flattens space.
    """
    path = Path(path)
    rows: dict[str, np.ndarray] = {}
    for number, line in enumerate(_read_lines(path, 'the calibration of a frame'), start=1):
        key, colon, text = line.partition(':')
        if line.strip() and colon:
            if key.strip() in rows:
                raise SceneError(f'{path}, line {number}: a second line {key.strip()}; leave one of them')
            rows[key.strip()] = _numbers(text.split(), f'{path}, line {number}, {key.strip()}')
    shapes = {'P2': (3, 4), 'R0_rect': (3, 3), 'Tr_velo_to_cam': (3, 4)}
    optional = {'P0': (3, 4), 'P1': (3, 4), 'P3': (3, 4), 'Tr_imu_to_velo': (3, 4)}
    missing = [key for key in shapes if key not in rows]
    if missing:
        raise SceneError(f'{path}: no line {missing[0]}; expected {", ".join(shapes)}, got {", ".join(rows) or "none"}')
    matrices: dict[str, np.ndarray] = {}
    for key, shape in (shapes | optional).items():
        if key in rows:
            if rows[key].size != shape[0] * shape[1]:
                raise SceneError(f'{path}, {key}: expected {shape[0] * shape[1]} numbers, got {rows[key].size}')
            matrices[key] = rows[key].reshape(shape)
    for key in ('R0_rect', 'Tr_velo_to_cam'):
        if not is_rotation(matrices[key][:, :3]):
            raise SceneError(f'{path}, {key}: its first three columns are no rotation; copy the file again')
    if abs(np.linalg.det(matrices['P2'][:, :3])) < 1e-6:
        raise SceneError(f'{path}, P2: it maps all points onto a line or a point; copy the file again')
    return KittiCalib(**matrices)


def is_rotation(matrix: Float[np.ndarray, '3 3']) -> bool:
    """Whether a matrix turns and does no more, as far as printed digits tell."""
    gap = matrix @ matrix.T - np.eye(3)
    return bool(np.abs(gap).max() < 0.01 and np.linalg.det(matrix) > 0)  # NaN compares as False


def write_calib(path: Path | str, calib: KittiCalib) -> None:
    """Write one file of ``calib/`` with KITTI's twelve decimals."""
    lines = []
    for key in ('P0', 'P1', 'P2', 'P3', 'R0_rect', 'Tr_velo_to_cam', 'Tr_imu_to_velo'):
        matrix = getattr(calib, key)
        if matrix is not None:
            lines.append(f'{key}: ' + ' '.join(f'{value:.12e}' for value in matrix.ravel()))
    write_text(path, '\n'.join(lines) + '\n')


def read_objects(path: Path | str) -> list[KittiObject]:
    """Read one file of ``label_2/`` or of results; an empty file holds no object.

    Raises:
        SceneError: The file is missing, or a line has not 15 fields (16 with a score) or a field is no number.
    """
    path = Path(path)
    objects = []
    for number, line in enumerate(_read_lines(path, 'the labels of a frame'), start=1):
        words = line.split()
        if not words:
            continue
        where = f'{path}, line {number}'
        if len(words) not in (15, 16):
            raise SceneError(f'{where}: expected 15 fields (16 with a score), got {len(words)}')
        v = _numbers(words[1:], where, _FIELDS).tolist()
        if v[1] != int(v[1]):
            raise SceneError(f'{where}: occluded is {words[2]}, expected a whole number, 0 to 3')
        if abs(v[13]) > MOST_TURN:
            raise SceneError(f'{where}: ry is {words[14]}, expected radians; degrees?')
        height, width, length, x, y, z, ry = v[7:14]
        score = v[14] if len(v) == 15 else None
        box = (v[3], v[4], v[5], v[6])
        name = _SPELLING.get(words[0].lower(), words[0])
        item = KittiObject(name, v[0], int(v[1]), v[2], box, height, width, length, x, y, z, ry, score)
        objects.append(item)
    return objects


def write_objects(path: Path | str, objects: Sequence[KittiObject], full_precision: bool = False) -> None:
    """Write one file of ``label_2/`` or of results.

    Args:
        path: File to write.
        objects: What to write, in order.
        full_precision: Every digit of every float instead of KITTI's two decimals (four for the score).
    """
    lines = [format_object(item, full_precision) for item in objects]
    write_text(path, ''.join(line + '\n' for line in lines))


def format_object(item: KittiObject, full_precision: bool = False) -> str:
    """One label line, without the end of line. DontCare writes its placeholders as KITTI does (-1, -10, -1000)."""

    def text(value: float, decimals: int = 2, plain: bool = False) -> str:
        if plain and value == int(value):
            return str(int(value))
        return repr(float(value)) if full_precision else f'{value:.{decimals}f}'

    plain = item.type == DONT_CARE
    words = [item.type, text(item.truncated, plain=plain or item.truncated == -1), str(item.occluded)]
    words += [text(item.alpha, plain=plain)] + [text(value) for value in item.bbox]
    words += [text(v, plain=plain) for v in (item.h, item.w, item.l, item.x, item.y, item.z, item.ry)]
    if item.score is not None:
        words.append(text(item.score, decimals=4))
    return ' '.join(words)


def objects_to_boxes(objects: Sequence[KittiObject], calib: KittiCalib, classes: Sequence[str]) -> Boxes3D:
    """Labels as boxes in the lidar frame; objects of other classes are left out, case aside.

    The lidar's z axis and the camera's -y axis are not exactly parallel. As in mmdetection3d the bottom centre moves
    exactly, the box then stands upright in the lidar frame, and yaw = -ry - pi/2.

    Raises:
        ValueError: A size is not positive.
    """
    numbers = [class_index(item.type, classes) for item in objects]
    kept = [item for item, number in zip(objects, numbers, strict=True) if number is not None]
    if not kept:
        return Boxes3D.empty()
    bottom = transform(np.array([[o.x, o.y, o.z] for o in kept]), calib.lidar_from_rect)
    size = np.array([[o.l, o.w, o.h] for o in kept])
    yaw = wrap_angle(-np.array([o.ry for o in kept]) - np.pi / 2)
    center = bottom + np.stack([np.zeros(len(kept)), np.zeros(len(kept)), size[:, 2] / 2], axis=1)
    labels = np.array([number for number in numbers if number is not None], dtype=np.int64)
    scores = np.array([1.0 if o.score is None else o.score for o in kept])
    return Boxes3D(np.concatenate([center, size, yaw[:, None]], axis=1), labels, scores)


def boxes_to_objects(
    boxes: Boxes3D, calib: KittiCalib, classes: Sequence[str], image_size: tuple[int, int] = IMAGE_SIZE
) -> list[KittiObject]:
    """Boxes as result lines, one a box; the inverse of :func:`objects_to_boxes`.

    The 2D box holds the projected corners, clipped to the image (all zero where nothing lies before the camera); alpha
    is computed, truncation and occlusion are -1 as in result files.
    """
    assert boxes.scores is not None
    half = np.zeros((len(boxes), 3))
    half[:, 2] = boxes.tensor[:, 5] / 2
    bottom = transform(boxes.tensor[:, :3] - half, calib.rect_from_lidar)
    objects = []
    for row, (x, y, z), label, score in zip(boxes.tensor, bottom.tolist(), boxes.labels, boxes.scores, strict=True):
        ry = float(wrap_angle(-row[6] - np.pi / 2))
        length, width, height = row[3:6].tolist()
        box = clip_box(project_object_box((height, width, length), (x, y, z), ry, calib), image_size)
        alpha = observation_angle(x, z, ry)
        objects.append(
            KittiObject(
                classes[int(label)], -1.0, -1, alpha, box, height, width, length, x, y, z, ry, score=float(score)
            )
        )
    return objects


def observation_angle(x: float, z: float, ry: float) -> float:
    """Alpha: the turn of an object as seen along the ray to it, radians in [-pi, pi)."""
    return float(wrap_angle(ry - np.arctan2(x, z)))


def object_corners(
    size_hwl: tuple[float, float, float], bottom: tuple[float, float, float], ry: float
) -> Float[np.ndarray, '8 3']:
    """Corners in the rect frame, metres: the bottom four in a circle, then the top four above them."""
    height, width, length = size_hwl
    along = np.array([0.5, 0.5, -0.5, -0.5]) * length
    across = np.array([0.5, -0.5, -0.5, 0.5]) * width
    c, s = np.cos(ry), np.sin(ry)
    x, z = bottom[0] + c * along + s * across, bottom[2] - s * along + c * across
    return np.concatenate(
        [np.stack([x, np.full(4, bottom[1] - up), z], axis=1) for up in (0.0, height)],
    )


_EDGES = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)])


def project_object_box(
    size_hwl: tuple[float, float, float], bottom: tuple[float, float, float], ry: float, calib: KittiCalib
) -> tuple[float, float, float, float] | None:
    """(left, top, right, bottom) in pixels, not clipped to the image; None where nothing lies before the camera.

    What reaches behind the near plane is cut there, so that a car beside the camera has a finite 2D box.
    """
    corners = object_corners(size_hwl, bottom, ry)
    near = NEAR - calib.P2[2, 3]
    a, b = corners[_EDGES[:, 0]], corners[_EDGES[:, 1]]
    cut = (a[:, 2] < near) != (b[:, 2] < near)
    t = (near - a[cut, 2]) / (b[cut, 2] - a[cut, 2])
    visible = np.concatenate([corners[corners[:, 2] >= near], a[cut] + t[:, None] * (b[cut] - a[cut])])
    if len(visible) == 0:
        return None
    uv = calib.project_rect(visible).uv
    low, high = uv.min(axis=0).tolist(), uv.max(axis=0).tolist()
    return low[0], low[1], high[0], high[1]


def clip_box(
    box: tuple[float, float, float, float] | None, image_size: tuple[int, int]
) -> tuple[float, float, float, float]:
    """Clip a 2D box to the pixels of the image; zeros for None, zero width or height where it lies outside."""
    if box is None:
        return 0.0, 0.0, 0.0, 0.0
    right, bottom = image_size[0] - 1.0, image_size[1] - 1.0
    left, top = min(max(box[0], 0.0), right), min(max(box[1], 0.0), bottom)
    return left, top, min(max(box[2], 0.0), right), min(max(box[3], 0.0), bottom)


def read_velodyne(path: Path | str) -> Float[np.ndarray, 'points 4']:
    """Read one scan: float32 x, y, z (metres, lidar frame) and reflectance. Nothing is dropped, see check_points.

    Raises:
        SceneError: The file is missing, empty, or cut off within a point.
    """
    path = Path(path)
    if not path.is_file():
        raise SceneError(f'{path}: no such file; expected a Velodyne scan')
    data = path.read_bytes()
    if len(data) == 0:
        raise SceneError(f'{path}: holds no points')
    check_float_width(data, 4, path)
    return np.frombuffer(data, dtype='<f4').reshape(-1, 4).astype(np.float32)


def check_points(points: Float[np.ndarray, 'points channels'], path: Path | str) -> None:
    """Raise where a number of a scan is NaN or infinite.

    Raises:
        SceneError: Names the file and how many points are affected.
    """
    bad = int((~np.isfinite(points).all(axis=1)).sum())
    if bad:
        raise SceneError(f'{path}: {bad} of {len(points)} points hold NaN or infinite numbers; drop them first')


def in_camera_view(
    points: Float[np.ndarray, 'points channels'], calib: KittiCalib, image_size: tuple[int, int] = IMAGE_SIZE
) -> Bool[np.ndarray, ' points']:
    """True where a point (lidar frame, further channels ignored) projects into the image, before the camera."""
    uv, depth = calib.project(points[:, :3])
    inside = (uv[:, 0] >= 0) & (uv[:, 0] < image_size[0]) & (uv[:, 1] >= 0) & (uv[:, 1] < image_size[1])
    return (depth > 0) & inside


def read_image_size(path: Path | str) -> tuple[int, int]:
    """Width and height of a frame's image from its PNG header; IMAGE_SIZE where there is no such file.

    Raises:
        SceneError: The file is there but is no PNG.
    """
    path = Path(path)
    if not path.is_file():
        return IMAGE_SIZE
    with path.open('rb') as stream:
        header = stream.read(24)
    if len(header) < 24 or header[:8] != _PNG_SIGNATURE or header[12:16] != b'IHDR':
        raise SceneError(f'{path}: not a PNG image; expected the frame of image_2')
    width, height = struct.unpack('>II', header[16:24])
    if not (width and height):
        raise SceneError(f'{path}: an image of {width} x {height} pixels; copy it again')
    return int(width), int(height)


def _read_lines(path: Path, what: str) -> list[str]:
    if not path.is_file():
        raise SceneError(f'{path}: no such file; expected {what}')
    return read_text(path, strict=False).split('\n')


def _numbers(words: Sequence[str], where: str, names: Sequence[str] | None = None) -> Float[np.ndarray, ' numbers']:
    values = np.zeros(len(words))
    for i, word in enumerate(words):
        name = names[i] if names else f'number {i + 1}'
        try:
            values[i] = read_number(word)
        except ValueError:
            raise SceneError(f'{where}: {name} is {word!r}, expected a number') from None
        if not np.isfinite(values[i]):
            raise SceneError(f'{where}: {name} is {word!r}, expected a finite number')
    return values
