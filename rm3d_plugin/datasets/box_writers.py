"""Writers of the files of boxes that :mod:`rm3d_plugin.datasets.box_formats` tells of."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rm3d_plugin.datasets.kitti_format import IMAGE_SIZE, KittiCalib, boxes_to_objects, write_objects
from rm3d_plugin.datasets.named_boxes import SIZES, BoxFileError, NamedBoxes
from rm3d_plugin.storage import write_json, write_text
from rm3d_plugin.structures import Boxes3D

FRAME = 'that of the scan file, z up; metres; yaw in radians, counter-clockwise from x'
DECIMALS = 6
CLOCKWISE = (3, 2, 1, 0)  # labelCloud's corners of a face among those of Boxes3D.corners


def _rounded(values: Sequence[float] | np.ndarray) -> list[float]:
    return [round(float(v), DECIMALS) for v in values]


def _scores(boxes: NamedBoxes) -> list[float | None]:
    return [None] * len(boxes.names) if boxes.scores is None else list(_rounded(boxes.scores))


def write_openpcdet(path: Path, boxes: NamedBoxes, scan: str, calib: KittiCalib | None) -> Path:
    """OpenPCDet's custom text; a class of several words is joined by ``_``."""
    lines = []
    for name, row, score in zip(boxes.names, boxes.tensor, _scores(boxes), strict=True):
        words = [
            *(f'{v:.{DECIMALS}f}' for v in row),
            name.replace(' ', '_'),
            *([] if score is None else [f'{score:g}']),
        ]
        lines.append(' '.join(words) + '\n')
    return write_text(path, ''.join(lines))


def write_kitti(path: Path, boxes: NamedBoxes, scan: str, calib: KittiCalib | None) -> Path:
    """KITTI's result lines."""
    if calib is None:
        raise BoxFileError(f'{path}: KITTI boxes are told in the frame of a camera; the scan {scan} has no calibration')
    names = sorted(set(boxes.names))
    labels = np.array([names.index(name) for name in boxes.names], dtype=np.int64)
    known = [name.replace(' ', '_') for name in names]
    objects = boxes_to_objects(Boxes3D(boxes.tensor, labels, boxes.scores), calib, known, IMAGE_SIZE)
    write_objects(path, objects, full_precision=True)
    return path


def _write_labelcloud(path: Path, scan: str, objects: list[dict[str, Any]]) -> Path:
    return write_json(path, {'folder': '', 'filename': scan, 'path': scan, 'objects': objects})


def write_centroid(path: Path, boxes: NamedBoxes, scan: str, degrees: bool) -> Path:
    """LabelCloud's centroid form; rotations in degrees from 0 to 360, or in radians."""
    objects = []
    for name, row, score in zip(boxes.names, boxes.tensor, _scores(boxes), strict=True):
        yaw = float(np.rad2deg(row[6])) % 360 if degrees else float(row[6])
        item: dict[str, Any] = {'name': name, 'centroid': dict(zip('xyz', _rounded(row[:3]), strict=True))}
        item |= {'dimensions': dict(zip(SIZES, _rounded(row[3:6]), strict=True))}
        item |= {'rotations': dict(zip('xyz', _rounded([0.0, 0.0, yaw]), strict=True))}
        objects.append(item if score is None else item | {'score': score})
    return _write_labelcloud(path, scan, objects)


def write_vertices(path: Path, boxes: NamedBoxes, scan: str, calib: KittiCalib | None) -> Path:
    """LabelCloud's corners."""
    corners = Boxes3D(boxes.tensor, np.zeros(len(boxes.names), dtype=np.int64)).corners()
    objects = []
    for name, points, score in zip(boxes.names, corners, _scores(boxes), strict=True):
        eight = [_rounded(points[i + up]) for up in (0, 4) for i in CLOCKWISE]
        objects.append({'name': name, 'vertices': eight} | ({} if score is None else {'score': score}))
    return _write_labelcloud(path, scan, objects)


def write_sustech(path: Path, boxes: NamedBoxes, scan: str, calib: KittiCalib | None) -> Path:
    """SUSTechPOINTS' list."""
    objects = []
    for number, (name, row, score) in enumerate(zip(boxes.names, boxes.tensor, _scores(boxes), strict=True), start=1):
        parts = (('position', row[:3]), ('scale', row[3:6]), ('rotation', [0.0, 0.0, row[6]]))
        pose = {part: dict(zip('xyz', _rounded(values), strict=True)) for part, values in parts}
        item: dict[str, Any] = {'obj_id': str(number), 'obj_type': name, 'psr': pose}
        objects.append(item if score is None else item | {'score': score})
    return write_json(path, objects)


def write_boxes_json(path: Path, boxes: NamedBoxes, scan: str, calib: KittiCalib | None) -> Path:
    """The JSON of ``rm3d predict``."""
    items = [
        {'class': name}
        | ({} if score is None else {'score': round(score, 4)})
        | {'center': [round(float(v), 3) for v in row[:3]], 'size': [round(float(v), 3) for v in row[3:6]]}
        | {'yaw': round(float(row[6]), 4)}
        for name, row, score in zip(boxes.names, boxes.tensor, _scores(boxes), strict=True)
    ]
    return write_json(path, {'scan': scan, 'frame': FRAME, 'boxes': items})
