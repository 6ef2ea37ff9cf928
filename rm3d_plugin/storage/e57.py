"""Points in E57 files, through pye57 (the extra ``e57``)."""

from pathlib import Path
from typing import Any

import numpy as np

from rm3d_plugin.structures import SceneError

NAMES = {'cartesianX': 'x', 'cartesianY': 'y', 'cartesianZ': 'z', 'intensity': 'intensity'}
NAMES |= {'colorRed': 'red', 'colorGreen': 'green', 'colorBlue': 'blue'}
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
    return {NAMES[name]: np.concatenate([np.asarray(scan[name]) for scan in scans]) for name in names}


def _scans(path: Path) -> list[dict[str, Any]]:
    try:
        import pye57
    except ImportError as error:
        raise SceneError(
            f'{path}: E57 needs pye57; pip install "rm3d_plugin[e57]", or save it as LAS, PLY or PTX (CloudCompare can)'
        ) from error
    try:
        file = pye57.E57(str(path))
    except Exception as error:  # of the library's own kind, with pages of text
        reason = str(error).split(' :: ')[0].partition('\n')[0]
        raise SceneError(f'{path}: not readable as E57 ({reason}); copy it again') from error
    try:
        counts = [file.get_header(i).point_count for i in range(file.scan_count)]
        if sum(counts) > DENSEST * path.stat().st_size:
            raise SceneError(f'{path}: announces {sum(counts)} points, more than its size has room for; damaged?')
        return [
            file.read_scan(i, intensity=True, colors=True, ignore_missing_fields=True)
            for i, count in enumerate(counts)
            if count
        ]
    finally:
        file.close()
