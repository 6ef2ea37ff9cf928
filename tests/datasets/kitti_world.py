"""A KITTI folder of a few made-up frames, written byte for byte as KITTI lays it out."""

from pathlib import Path

import numpy as np

from rm3d_plugin.datasets.kitti_format import KittiCalib, boxes_to_objects, write_calib, write_objects
from rm3d_plugin.structures import Boxes3D

TYPES = ('Car', 'Pedestrian', 'Cyclist', 'Van')
# lidar x forward, y left, z up -> camera x right, y down, z forward; the camera sits at the lidar
CALIB = KittiCalib(
    P2=np.array([[700.0, 0, 621, 0], [0, 700, 187, 0], [0, 0, 1, 0]]),
    R0_rect=np.eye(3),
    Tr_velo_to_cam=np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0]]),
)
# rows (x, y, z, dx, dy, dz, yaw) and type: two cars, a pedestrian, a van, and a car out of range
BOXES = np.array(
    [
        [10.0, 0, -1, 4, 2, 1.5, 0.0],
        [20.0, 5, -1, 4, 2, 1.5, np.pi / 2],
        [15.0, -4, -0.8, 0.8, 0.6, 1.8, 0.3],
        [25.0, -6, -0.6, 5, 2, 2.2, 0.0],
        [90.0, 0, -1, 4, 2, 1.5, 0.0],
    ]
)
LABELS = np.array([0, 0, 1, 3, 0])


def write_frame(root: Path, name: str, points: np.ndarray, folder: str = 'training') -> None:
    base = root / folder
    for sub in ('velodyne', 'calib', 'label_2'):
        (base / sub).mkdir(parents=True, exist_ok=True)
    points.astype('<f4').tofile(base / 'velodyne' / f'{name}.bin')
    write_calib(base / 'calib' / f'{name}.txt', CALIB)
    objects = boxes_to_objects(Boxes3D(BOXES, LABELS), CALIB, TYPES)
    write_objects(base / 'label_2' / f'{name}.txt', objects, full_precision=True)


def frame_points(seed: int = 0, per_box: int = 30) -> np.ndarray:
    """Points inside each box, then ground, then what every crop must drop: behind, aside, too far, too high."""
    rng = np.random.default_rng(seed)
    inside = [box[:3] + rng.uniform(-0.25, 0.25, size=(per_box, 3)) for box in BOXES]
    ground = np.c_[rng.uniform(8, 40, 200), rng.uniform(-4, 4, 200), np.full(200, -1.9)]
    dropped = np.array([[-10.0, 0, 0], [10, 39, 0], [75, 0, 0], [10, 0, 2.5]])
    xyz = np.concatenate([*inside, ground, dropped])
    return np.c_[xyz, np.linspace(0, 1, len(xyz))]


def make_world(root: Path, frames: int = 4) -> Path:
    for number in range(frames):
        write_frame(root, f'{number:06d}', frame_points(number))
    (root / 'ImageSets').mkdir()
    for split in ('train', 'val'):
        (root / 'ImageSets' / f'{split}.txt').write_text(''.join(f'{i:06d}\n' for i in range(frames)))
    return root
