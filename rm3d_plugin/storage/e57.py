"""Points in E57 files, through pye57 (the extra ``e57``)."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rm3d_plugin.structures import SceneError

NAMES = {'cartesianX': 'x', 'cartesianY': 'y', 'cartesianZ': 'z', 'intensity': 'intensity'}
NAMES |= {'colorRed': 'red', 'colorGreen': 'green', 'colorBlue': 'blue'}
MOST_GAP = 0.01  # of a quaternion's length from 1
DENSEST = 64  # points a byte; a file that announces more is damaged


def read_e57(path: str | Path) -> dict[str, np.ndarray]:
    """All scans of a file together, each moved by its pose; intensity and colours where every scan has them.

    Points that a scan marks as invalid are left out.

    Raises:
        SceneError: The file is damaged or without points, or pye57 is not installed.
    """
    path = Path(path)
    scans = _scans(path)
    if not scans:
        raise SceneError(f'{path}: holds no scan with points')
    names = [name for name in NAMES if all(name in scan for scan in scans)]
    if lost := [NAMES[name] for name in NAMES if name not in names and any(name in scan for scan in scans)]:
        warnings.warn(
            f'{path}: {", ".join(lost)}: not every scan of the file has them; they are left out', stacklevel=2
        )
    return {NAMES[name]: np.concatenate([np.asarray(scan[name]) for scan in scans]) for name in names}


def _scans(path: Path) -> list[dict[str, Any]]:
    try:
        import pye57
    except ImportError as error:
        raise SceneError(
            f'{path}: E57 needs pye57; pip install "rm3d_plugin[e57]", or save it as LAS, PLY or PTX (CloudCompare can)'
        ) from error
    try:
        str(path).encode()
    except UnicodeEncodeError as error:
        raise SceneError(f'{path}: pye57 opens no file whose name is no UTF-8; rename it') from error
    try:
        file = pye57.E57(str(path))
    except Exception as error:  # of the library's own kind, with pages of text
        reason = str(error).split(' :: ')[0].partition('\n')[0]
        raise SceneError(f'{path}: not readable as E57 ({reason}); copy it again') from error
    try:
        headers = [file.get_header(i) for i in range(file.scan_count)]
        _check_headers(headers, path)
        return [
            file.read_scan(i, intensity=True, colors=True, ignore_missing_fields=True)
            for i, header in enumerate(headers)
            if header.point_count
        ]
    finally:
        file.close()


def _check_headers(headers: Sequence[Any], path: Path) -> None:
    """Whether scans have room for their points, and their poses turn.

    Raises:
        SceneError: The file is damaged.
    """
    announced = sum(header.point_count for header in headers)
    if announced > DENSEST * path.stat().st_size:
        raise SceneError(f'{path}: announces {announced} points, more than its size has room for; damaged?')
    for number, header in enumerate(headers, start=1):
        if header.has_pose() and not abs(float(np.linalg.norm(header.rotation)) - 1) < MOST_GAP:
            told = ' '.join(f'{value:g}' for value in header.rotation)
            raise SceneError(
                f'{path}: scan {number}: rotation {told}: expected a quaternion of length 1; export it again'
            )
