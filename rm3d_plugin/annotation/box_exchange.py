"""Boxes of a session, for other programs and for a detector, and back."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rm3d_plugin.annotation.objects import Objects
from rm3d_plugin.annotation.session import Session
from rm3d_plugin.datasets.box_formats import BOX_FORMATS, find_format
from rm3d_plugin.datasets.kitti_format import KittiCalib, read_calib, write_calib
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.storage import write_text
from rm3d_plugin.structures import SceneError

FOCAL, MIDDLE = 700.0, (621.0, 187.5)  # pixels, of a camera like KITTI's; boxes do not depend on it
LISTS = ('train.txt', 'val.txt')


def export_boxes(session: Session, root: Path, kind: str = 'openpcdet') -> list[Path]:
    """Write the boxes of every scan that has one, in the layout that a detector is trained from.

    ``points/`` links to the scans, ``labels/`` holds the boxes, ``train.txt`` and ``val.txt`` name the scans with boxes
    (a list that is there stays), ``calib/`` the cameras that KITTI's format needs.

    Args:
        session: Whose boxes.
        root: Folder.
        kind: A key of :data:`~rm3d_plugin.datasets.box_formats.BOX_FORMATS`.

    Returns:
        The files of boxes.

    Raises:
        ConfigError: There is no such format.
        SceneError: No scan has a box.
    """
    if kind not in BOX_FORMATS:
        raise ConfigError(f'box format: expected one of {", ".join(BOX_FORMATS)}, got {kind!r}')
    scans = [scan for scan in session.scans if session.objects.boxes(scan)]
    if not scans:
        raise SceneError('no boxes to export: no object has a box yet')
    files = [_export_scan(session, scan, root, kind) for scan in scans]
    for name in LISTS:
        if not (root / name).exists():
            write_text(root / name, ''.join(f'{scan}\n' for scan in scans))
    return files


def _export_scan(session: Session, scan: str, root: Path, kind: str) -> Path:
    source, calib = session.path(scan), None
    if kind == 'kitti':
        calib = upright_camera(np.asarray(session.scan(scan).cloud.origin))
        write_calib(root / 'calib' / f'{scan}.txt', calib)
    _link(source, root / 'points' / source.name)
    target = root / 'labels' / f'{scan}{BOX_FORMATS[kind].ending}'
    target.parent.mkdir(parents=True, exist_ok=True)
    return BOX_FORMATS[kind].write(target, session.objects.named(scan), source.name, calib)


def import_boxes(objects: Objects, scan: str, files: Sequence[Path], kind: str = 'auto') -> list[int]:
    """Take over files of boxes of one scan, one action; returns the numbers of the objects.

    Args:
        objects: Of the session.
        scan: Name of the scan.
        files: Of one format that is read, see :mod:`rm3d_plugin.datasets.box_formats`; KITTI's calibration lies in
            ``calib/`` beside their folder.
        kind: A key of :data:`~rm3d_plugin.datasets.box_formats.BOX_FORMATS`; 'auto': told from the files.

    Raises:
        BoxFileError: A file cannot be used.
        SceneError: There is no such scan.
    """
    reader, added = BOX_FORMATS[find_format(files) if kind == 'auto' else kind], list[int]()
    for path in files:
        calib = path.parent.parent / 'calib' / f'{path.stem}.txt'
        added += objects.add_boxes(scan, reader.read(path, read_calib(calib) if calib.is_file() else None))
    return added


def upright_camera(place: np.ndarray) -> KittiCalib:
    """A camera that looks along x, at a place in the coordinates of the scan's file."""
    axes = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    image = np.array([[FOCAL, 0.0, MIDDLE[0], 0.0], [0.0, FOCAL, MIDDLE[1], 0.0], [0.0, 0.0, 1.0, 0.0]])
    return KittiCalib(P2=image, R0_rect=np.eye(3), Tr_velo_to_cam=np.c_[axes, -axes @ place])


def _link(source: Path, target: Path) -> None:
    """Show a file at another place; a copy where the system has no links."""
    if target.exists() or target.is_symlink():
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        target.symlink_to(source.resolve())
    except OSError:
        shutil.copyfile(source, target)
