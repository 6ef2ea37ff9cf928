"""Real street scans with the box that each point lies in, read without the project's loaders."""

from typing import NamedTuple

import numpy as np


class Frame(NamedTuple):
    xyz: np.ndarray
    intensity: np.ndarray
    instance: np.ndarray  # box of each point, -1 = none
    over_bottom: np.ndarray  # metres above the bottom of that box


def frames(folder):
    """Names of all frames."""
    return sorted(path.stem for path in (folder / 'kitti/training/velodyne').glob('*.bin'))


def read_frame(folder, name):
    """The part of a scan that the colour camera sees."""
    root = folder / 'kitti/training'
    points = np.fromfile(root / f'velodyne/{name}.bin', dtype=np.float32).reshape(-1, 4)
    matrix = {}
    for line in (root / f'calib/{name}.txt').read_text().splitlines():
        key, _, values = line.partition(':')
        if values:
            matrix[key] = np.array(values.split(), dtype=float).reshape(3, -1)
    velo_to_cam, rectify = np.eye(4), np.eye(4)
    velo_to_cam[:3], rectify[:3, :3] = matrix['Tr_velo_to_cam'], matrix['R0_rect']
    camera = np.c_[points[:, :3], np.ones(len(points))] @ (rectify @ velo_to_cam).T
    image = camera @ matrix['P2'].T
    column, row = image[:, 0] / image[:, 2], image[:, 1] / image[:, 2]
    seen = (camera[:, 2] > 0) & (column >= 0) & (column < 1242) & (row >= 0) & (row < 375)
    points, camera = points[seen], camera[seen, :3]
    instance, over = np.full(len(points), -1), np.zeros(len(points))
    lines = (root / f'label_2/{name}.txt').read_text().splitlines()
    for number, words in enumerate(line.split() for line in lines if not line.startswith('DontCare')):
        height, width, length, x, y, z, yaw = map(float, words[8:15])
        d = camera - [x, y, z]
        along, across = np.cos(yaw) * d[:, 0] - np.sin(yaw) * d[:, 2], np.sin(yaw) * d[:, 0] + np.cos(yaw) * d[:, 2]
        inside = (np.abs(along) < length / 2) & (np.abs(across) < width / 2) & (d[:, 1] <= 0) & (d[:, 1] >= -height)
        instance[inside], over[inside] = number, -d[inside, 1]
    return Frame(points[:, :3], points[:, 3], instance, over)
