"""Synthetic streets as a KITTI object data set: training/{velodyne,label_2,calib} and ImageSets (no images)."""

import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from tqdm import tqdm

from rm3d_plugin.datasets.kitti_format import (
    DONT_CARE,
    IMAGE_SIZE,
    KittiCalib,
    KittiObject,
    clip_box,
    format_object,
    observation_angle,
    project_object_box,
    transform,
    write_calib,
)
from rm3d_plugin.datasets.synthetic.lidar import SpinningLidar, cast, count_hits, make_beams, scan
from rm3d_plugin.datasets.synthetic.road_users import RoadUser
from rm3d_plugin.datasets.synthetic.shapes import cos_sin, join
from rm3d_plugin.datasets.synthetic.streets import Placed, Street, make_street
from rm3d_plugin.storage import write_bytes, write_text

VERSION = 3  # raise whenever the bytes of a frame change
MARKER = 'demo.json'
FAR = 66.0  # m; further objects are DontCare
README = """This folder is SYNTHETIC. rm3d_plugin made it: parametric streets, scanned by a virtual lidar of 64 beams.
The files have the format of the KITTI object benchmark, but none of the content comes from KITTI, and a score on them
says nothing about real data. demo.json holds the parameters; delete the folder to make it afresh.
"""


@dataclass(frozen=True, eq=False)
class Frame:
    """One synthetic frame.

    Attributes:
        points: (N, 4) float32 x, y, z in metres (lidar frame), reflectance.
        objects: Its labels.
        calib: Its calibration, the same for every frame.
    """

    points: Float[np.ndarray, 'points 4']
    objects: list[KittiObject]
    calib: KittiCalib


def demo_calib() -> KittiCalib:
    """Calibration of the virtual car: KITTI's arrangement, a camera that looks slightly up and to the side."""
    focal, middle, tilt, turn = 715.0, (609.0, 175.0), 0.009, 0.006
    c, s = (float(v) for v in cos_sin(tilt))
    cy, sy = (float(v) for v in cos_sin(turn))
    # Camera axes in the lidar frame: right, down, forward.
    forward = np.array([c * cy, c * sy, s])
    right = np.array([sy, -cy, 0.0])
    rotation = np.stack([right, np.cross(forward, right), forward])
    offset = np.array([0.0, -0.07, -0.3])
    shift = [0.0, -380.0, 44.0, -335.0]
    cameras = []
    for move in shift:
        cameras.append(np.array([[focal, 0, middle[0], move], [0, focal, middle[1], 0], [0, 0, 1, 0]]))
    velo = np.round(np.concatenate([rotation, offset[:, None]], axis=1), 12)
    return KittiCalib(cameras[2], np.eye(3), velo, cameras[0], cameras[1], cameras[3])


def make_frame(seed: int, number: int, lidar: SpinningLidar) -> Frame:
    """One frame; depends on nothing but the arguments."""
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, number])))
    calib = demo_calib()

    def snap(user: RoadUser, x: float, y: float, z: float, yaw: float) -> tuple[Float[np.ndarray, '3'], float]:
        return snap_pose(calib, x, y, z, yaw)

    street = make_street(rng, snap)
    everything = join([placed.mesh for placed in street.placed] + street.background)
    hits = cast(everything.corners, make_beams(lidar), lidar.max_range)
    returned = scan(everything, hits, lidar, rng)
    points = np.concatenate([returned.xyz, returned.intensity[:, None]], axis=1).astype(np.float32)
    rect = transform(points[:, :3], calib.rect_from_lidar)
    objects = label_street(street, hits.triangle, returned.triangle, lidar, rect, calib)
    return Frame(points, objects, calib)


def make_streets(
    root: Path | str,
    num_train: int = 160,
    num_val: int = 40,
    seed: int = 0,
    azimuth_step: float = 0.35,
    workers: int = 1,
    progress: bool = True,
) -> Path:
    """Make a synthetic KITTI object data set, or leave it as it is where it is complete and of these parameters.

    Frames are independent and written atomically: what was interrupted goes on where it stopped.

    Args:
        root: Folder to fill; a folder that holds anything else is refused.
        num_train: Frames 0 .. num_train - 1.
        num_val: The frames after them.
        seed: Another seed makes other streets.
        azimuth_step: Degrees between two firings. Larger: fewer points, faster.
        workers: Processes; the result does not depend on it.
        progress: Show a bar.

    Returns:
        The root as a path.

    Raises:
        ValueError: The folder holds files that this function did not make, or a number is out of range.
    """
    root = Path(root)
    if num_train < 0 or num_val < 0 or num_train + num_val == 0 or workers < 1:
        raise ValueError(
            f'expected frames and workers, got num_train={num_train}, num_val={num_val}, workers={workers}'
        )
    lidar = SpinningLidar(azimuth_step)
    recipe: dict[str, object] = {'version': VERSION, 'synthetic': True, 'seed': seed, 'azimuth_step': azimuth_step}
    wanted = recipe | {'num_train': num_train, 'num_val': num_val}
    found = _read_marker(root)
    if found == wanted | {'finished': True}:
        return root
    _prepare(root, found, recipe)
    write_text(root / MARKER, json.dumps(wanted | {'finished': False}, indent=2) + '\n')
    todo = [n for n in range(num_train + num_val) if not _frame_paths(root, n)[-1].is_file()]
    for _ in tqdm(_run(root, seed, lidar, todo, workers), 'synthetic streets', len(todo), disable=not progress):
        pass
    sets = root / 'ImageSets'
    write_text(sets / 'train.txt', ''.join(f'{n:06d}\n' for n in range(num_train)))
    write_text(sets / 'val.txt', ''.join(f'{n:06d}\n' for n in range(num_train, num_train + num_val)))
    write_text(root / MARKER, json.dumps(wanted | {'finished': True}, indent=2) + '\n')
    return root


def write_frame(root: Path, number: int, frame: Frame) -> None:
    """Write the three files of a frame, each atomically, the scan last."""
    calib_path, label_path, scan_path = _frame_paths(root, number)
    write_calib(calib_path, frame.calib)
    write_text(label_path, ''.join(format_object(item) + '\n' for item in frame.objects))
    write_bytes(scan_path, frame.points.astype('<f4').tobytes())


def _frame_paths(root: Path, number: int) -> tuple[Path, Path, Path]:
    base = root / 'training'
    name = f'{number:06d}'
    return base / 'calib' / f'{name}.txt', base / 'label_2' / f'{name}.txt', base / 'velodyne' / f'{name}.bin'


def _read_marker(root: Path) -> dict[str, object] | None:
    path = root / MARKER
    if not path.is_file():
        return None
    try:
        content = json.loads(path.read_text(encoding='utf-8'))
    except json.JSONDecodeError as error:
        raise ValueError(f'{path}: not JSON ({error}); delete {root} to make it afresh') from None
    return content if isinstance(content, dict) else None


def _prepare(root: Path, found: dict[str, object] | None, recipe: dict[str, object]) -> None:
    """Make the folders; frames of another recipe go, frames of this one stay."""
    if found is None and root.is_dir() and any(root.iterdir()):
        raise ValueError(
            f'{root} holds files but no {MARKER}: not made here, so nothing is written; choose another folder'
        )
    if found is not None and any(found.get(key) != value for key, value in recipe.items()):
        for name in ('training', 'ImageSets'):
            shutil.rmtree(root / name, ignore_errors=True)
    for name in ('velodyne', 'label_2', 'calib'):
        (root / 'training' / name).mkdir(parents=True, exist_ok=True)
    (root / 'ImageSets').mkdir(exist_ok=True)
    write_text(root / 'README.txt', README)


def _run(root: Path, seed: int, lidar: SpinningLidar, todo: list[int], workers: int) -> Iterator[None]:
    if workers == 1 or len(todo) < 2:
        for number in todo:
            _make_one(root, seed, lidar, number)
            yield
        return
    from joblib import Parallel, delayed

    jobs = (delayed(_make_one)(root, seed, lidar, number) for number in todo)
    yield from Parallel(n_jobs=workers, return_as='generator')(jobs)


def _make_one(root: Path, seed: int, lidar: SpinningLidar, number: int) -> None:
    write_frame(root, number, make_frame(seed, number, lidar))


def snap_pose(calib: KittiCalib, x: float, y: float, z: float, yaw: float) -> tuple[Float[np.ndarray, '3'], float]:
    """The nearest pose that a label with two decimals in the camera frame can say."""
    rect = np.round(transform(np.array([x, y, z]), calib.rect_from_lidar), 2)
    ry = _wrapped(round(-yaw - np.pi / 2, 2))
    return transform(rect, calib.lidar_from_rect), -ry - np.pi / 2


def _wrapped(angle: float) -> float:
    turned = angle - 2 * np.pi * np.floor((angle + np.pi) / (2 * np.pi))
    return round(float(turned), 2)


def label_street(
    street: Street,
    met: Int[np.ndarray, ' rays'],
    returned: Int[np.ndarray, ' points'],
    lidar: SpinningLidar,
    rect: Float[np.ndarray, 'points 3'],
    calib: KittiCalib,
) -> list[KittiObject]:
    """KITTI's labels: what the image shows and what returned at least one point; DontCare last.

    Args:
        street: The scene; the triangles of its labelled things come first.
        met: The triangle that each beam meets.
        returned: The triangle that each point lies on.
        lidar: The sensor.
        rect: The points in the rect frame.
        calib: The camera.
    """
    beams = make_beams(lidar)
    objects, end = [], 0
    for placed in street.placed:
        first, end = end, end + len(placed.mesh)
        item = _object(placed, calib)
        if item is None or count_inside(item, rect[(returned >= first) & (returned < end)]) == 0:
            continue
        if item.type == DONT_CARE:
            objects.append(KittiObject(DONT_CARE, -1, -1, -10, item.bbox, -1, -1, -1, -1000, -1000, -1000, -10))
            continue
        seen = int(((met >= first) & (met < end)).sum())
        alone = count_hits(placed.mesh.corners, beams, lidar.max_range)
        objects.append(replace(item, occluded=occlusion_level(seen / alone)))
    return sorted(objects, key=lambda item: item.type == DONT_CARE)


def count_inside(item: KittiObject, rect: Float[np.ndarray, 'points 3']) -> int:
    """How many points of the rect frame a labelled box holds."""
    c, s = (float(v) for v in cos_sin(item.ry))
    dx, dz = rect[:, 0] - item.x, rect[:, 2] - item.z
    along, across = c * dx - s * dz, s * dx + c * dz
    inside = (np.abs(along) <= item.l / 2) & (np.abs(across) <= item.w / 2)
    return int((inside & (rect[:, 1] <= item.y) & (rect[:, 1] >= item.y - item.h)).sum())


def occlusion_level(share: float) -> int:
    """KITTI's levels from the share of the beams that would meet the object if it stood alone."""
    return 0 if share > 0.8 else 1 if share > 0.45 else 2 if share > 0.15 else 3


def _object(placed: Placed, calib: KittiCalib) -> KittiObject | None:
    """The label without its occlusion; None where the image does not show the object, or hardly."""
    length, width, height = placed.user.size
    x, y, z = (round(float(v), 2) for v in transform(placed.bottom, calib.rect_from_lidar))
    ry = _wrapped(round(-placed.yaw - np.pi / 2, 2))
    whole = project_object_box((height, width, length), (x, y, z), ry, calib)
    if whole is None or z < 0.5:
        return None
    shown = clip_box(whole, IMAGE_SIZE)
    area = (whole[2] - whole[0]) * (whole[3] - whole[1])
    truncated = 1.0 - (shown[2] - shown[0]) * (shown[3] - shown[1]) / area
    if truncated > 0.95:
        return None
    kind = placed.user.type if np.sqrt(x * x + z * z) <= FAR else DONT_CARE
    alpha = observation_angle(x, z, ry)
    return KittiObject(kind, max(truncated, 0.0), 0, alpha, shown, height, width, length, x, y, z, ry)
