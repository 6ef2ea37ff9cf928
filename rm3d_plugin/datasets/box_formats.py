"""Files of boxes that labelling tools and benchmarks write, read and written alike.

Boxes are rows as :class:`~rm3d_plugin.structures.Boxes3D`, in the coordinates of the scan's file:

- ``openpcdet``: text, ``x y z dx dy dz yaw class [score]`` a line, the middle of the box, radians.
- ``kitti``: text, KITTI's label line, in the frame of the camera that a calibration file tells.
- ``labelcloud_rel``, ``labelcloud_abs``: labelCloud's centroid form; rotations in radians from -pi to pi, or in degrees
  from 0 to 360.
- ``labelcloud_vertices``: labelCloud's eight corners.
- ``sustech``: SUSTechPOINTS' list of position, scale and rotation, radians.
- ``json``: what ``rm3d predict`` writes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rm3d_plugin.datasets.box_writers import (
    write_boxes_json,
    write_centroid,
    write_kitti,
    write_openpcdet,
    write_sustech,
    write_vertices,
)
from rm3d_plugin.datasets.kitti_format import MOST_TURN, KittiCalib, objects_to_boxes, read_objects, wrap_angle
from rm3d_plugin.datasets.named_boxes import SIZES, BoxFileError, NamedBoxes
from rm3d_plugin.storage.files import parse_json
from rm3d_plugin.storage.plain_files import read_number, read_text
from rm3d_plugin.user_error import UserError

MOST_TILT = 5.0  # degrees about x or y that a person may not have meant; boxes stand upright
PCDET_FIELDS = ('x', 'y', 'z', 'dx', 'dy', 'dz', 'yaw')
_NO_OBJECT = ('DontCare',)
LABELCLOUD_CLASSES = '_classes.json'  # its settings, among the files of boxes


# ------------------------------------------------------------------ checks that name file, object and field


def _number(value: object, where: str, name: str) -> float:
    try:
        number = read_number(value)
    except (TypeError, ValueError, OverflowError):
        raise BoxFileError(f'{where}: {name} is {value!r:.40}, expected a number; correct or remove the box') from None
    if not np.isfinite(number):
        raise BoxFileError(f'{where}: {name} is {value!r}, expected a finite number; correct or remove the box')
    return number


def _row(where: str, center: Sequence[float], size: Sequence[float], yaw: float) -> list[float]:
    for name, value in zip(SIZES, size, strict=True):
        if value <= 0:
            raise BoxFileError(f'{where}: {name} is {value:g} m, expected a length above 0; correct or remove the box')
    if abs(yaw) > MOST_TURN:
        raise BoxFileError(f'{where}: the turn about z is {yaw:g}, expected radians; degrees? convert them')
    return [*center, *size, float(wrap_angle(yaw))]


def _field(item: Any, name: str, where: str) -> Any:
    if not isinstance(item, dict) or name not in item:
        got = ', '.join(map(str, item)) if isinstance(item, dict) else type(item).__name__
        raise BoxFileError(f'{where}: expected a field {name!r}, got {got}')
    return item[name]


def _listed(item: Any, name: str, where: str) -> list[Any]:
    found = _field(item, name, where)
    if not isinstance(found, list):
        raise BoxFileError(f'{where}: {name}: expected a list, got {found!r:.40}')
    return found


def _class_name(item: Any, name: str, where: str) -> str:
    found = _field(item, name, where)
    if not isinstance(found, str | int) or isinstance(found, bool) or not str(found).strip():
        raise BoxFileError(f'{where}: {name} is {found!r:.40}, expected the name of a class; correct or remove the box')
    return str(found)


def _triple(item: Any, name: str, keys: Sequence[str], where: str) -> list[float]:
    part = _field(item, name, where)
    return [_number(_field(part, key, f'{where}, {name}'), where, f'{name}.{key}') for key in keys]


def _yaw_of(angles: Sequence[float], where: str, degrees: bool) -> float:
    """Turn about z in radians of rotations about x, y, z.

    Raises:
        BoxFileError: The box leans.
    """
    x, y, z = np.deg2rad(angles) if degrees else np.asarray(angles)
    for name, angle in (('x', x), ('y', y)):
        tilt = abs(float(np.rad2deg(wrap_angle(angle))))
        if tilt > MOST_TILT:
            raise BoxFileError(
                f'{where}: the rotation about {name} is {tilt:.1f} degrees; boxes stand upright: set it to 0'
            )
    return float(z)


def _gathered(names: list[str], rows: list[list[float]], scores: list[float] | None = None) -> NamedBoxes:
    tensor = np.array(rows, dtype=np.float64).reshape(-1, 7)
    return NamedBoxes(names, tensor, np.array(scores) if scores and len(scores) == len(names) else None)


def _load(path: Path) -> Any:
    try:
        return parse_json(read_text(path))
    except FileNotFoundError:
        raise BoxFileError(f'{path}: no such file; expected boxes') from None
    except UserError:
        raise
    except ValueError as error:
        raise BoxFileError(f'{path}: not JSON ({error}); write it again') from error


# ------------------------------------------------------------------ readers


def _read_openpcdet(path: Path, calib: KittiCalib | None) -> NamedBoxes:
    names: list[str] = []
    rows: list[list[float]] = []
    scores: list[float] = []
    for number, line in enumerate(read_text(path).split('\n'), start=1):
        words, where = line.split(), f'{path}, line {number}'
        if not words:
            continue
        if len(words) not in (8, 9):
            raise BoxFileError(f'{where}: expected {" ".join(PCDET_FIELDS)} class [score], got {len(words)} words')
        v = [_number(word, where, name) for name, word in zip(PCDET_FIELDS, words, strict=False)]
        names.append(words[7])
        rows.append(_row(where, v[:3], v[3:6], v[6]))
        scores += [_number(word, where, 'score') for word in words[8:]]
    return _gathered(names, rows, scores)


def _read_kitti(path: Path, calib: KittiCalib | None) -> NamedBoxes:
    objects = [item for item in read_objects(path) if item.type not in _NO_OBJECT]
    if objects and calib is None:
        raise BoxFileError(
            f'{path}: KITTI boxes are told in the frame of a camera, so a calibration is needed; expected '
            f'{path.parent.parent / "calib" / path.name}'
        )
    if calib is None or not objects:
        return _gathered([], [])
    names = sorted({item.type for item in objects})
    try:
        boxes = objects_to_boxes(objects, calib, names)
    except ValueError as error:
        raise BoxFileError(f'{path}: {error}; correct or remove the line') from error
    scores = None if objects[0].score is None else boxes.scores
    return NamedBoxes([names[label] for label in boxes.labels.tolist()], boxes.tensor, scores)


def _objects(path: Path) -> list[tuple[str, Any]]:
    found = _listed(_load(path), 'objects', str(path))
    return [(f'{path}, object {number}', item) for number, item in enumerate(found, start=1)]


def _read_centroid(path: Path, degrees: bool) -> NamedBoxes:
    names, rows = [], []
    for where, item in _objects(path):
        center = _triple(item, 'centroid', 'xyz', where)
        size = _triple(item, 'dimensions', SIZES, where)
        rows.append(_row(where, center, size, _yaw_of(_triple(item, 'rotations', 'xyz', where), where, degrees)))
        names.append(_class_name(item, 'name', where))
    return _gathered(names, rows)


def _read_vertices(path: Path, calib: KittiCalib | None) -> NamedBoxes:
    names, rows = [], []
    for where, item in _objects(path):
        given = _listed(item, 'vertices', where)
        if len(given) != 8 or not all(isinstance(corner, list) and len(corner) == 3 for corner in given):
            raise BoxFileError(f'{where}: vertices: expected 8 corners of x, y, z')
        corners = np.array([[_number(v, where, f'vertices[{i}]') for v in corner] for i, corner in enumerate(given)])
        along, across, up = corners[3] - corners[0], corners[1] - corners[0], corners[4] - corners[0]
        lean = np.rad2deg(np.arctan2(np.linalg.norm(up[:2]), abs(up[2])))
        if lean > MOST_TILT:
            raise BoxFileError(f'{where}: vertices: the box leans by {lean:.1f} degrees; boxes stand upright')
        size = [float(np.linalg.norm(edge)) for edge in (along, across, up)]
        rows.append(_row(where, corners.mean(axis=0).tolist(), size, float(np.arctan2(along[1], along[0]))))
        names.append(_class_name(item, 'name', where))
    return _gathered(names, rows)


def _read_sustech(path: Path, calib: KittiCalib | None) -> NamedBoxes:
    names, rows = [], []
    found = _load(path)
    if not isinstance(found, list):
        raise BoxFileError(f'{path}: expected a list of objects, got {type(found).__name__}')
    for number, item in enumerate(found, start=1):
        where = f'{path}, object {number}'
        pose = _field(item, 'psr', where)
        center, size = _triple(pose, 'position', 'xyz', where), _triple(pose, 'scale', 'xyz', where)
        rows.append(_row(where, center, size, _yaw_of(_triple(pose, 'rotation', 'xyz', where), where, degrees=False)))
        names.append(_class_name(item, 'obj_type', where))
    return _gathered(names, rows)


def _read_json(path: Path, calib: KittiCalib | None) -> NamedBoxes:
    names, rows, scores = [], [], []
    for number, item in enumerate(_listed(_load(path), 'boxes', str(path)), start=1):
        where = f'{path}, box {number}'
        center, size = ([_number(v, where, key) for v in _listed(item, key, where)] for key in ('center', 'size'))
        if len(center) != 3 or len(size) != 3:
            raise BoxFileError(f'{where}: center and size: expected three numbers each')
        rows.append(_row(where, center, size, _number(_field(item, 'yaw', where), where, 'yaw')))
        names.append(_class_name(item, 'class', where))
        scores += [_number(item['score'], where, 'score')] if 'score' in item else []
    return _gathered(names, rows, scores)


@dataclass(frozen=True)
class BoxFormat:
    """One kind of file.

    Attributes:
        ending: Of its files.
        read: (path, calibration or None) -> boxes.
        write: (path, boxes, name of the scan, calibration or None) -> path.
    """

    ending: str
    read: Callable[[Path, KittiCalib | None], NamedBoxes]
    write: Callable[[Path, NamedBoxes, str, KittiCalib | None], Path]


BOX_FORMATS: dict[str, BoxFormat] = {
    'openpcdet': BoxFormat('.txt', _read_openpcdet, write_openpcdet),
    'kitti': BoxFormat('.txt', _read_kitti, write_kitti),
    'labelcloud_rel': BoxFormat(
        '.json', lambda p, c: _read_centroid(p, False), lambda p, b, s, c: write_centroid(p, b, s, False)
    ),
    'labelcloud_abs': BoxFormat(
        '.json', lambda p, c: _read_centroid(p, True), lambda p, b, s, c: write_centroid(p, b, s, True)
    ),
    'labelcloud_vertices': BoxFormat('.json', _read_vertices, write_vertices),
    'sustech': BoxFormat('.json', _read_sustech, write_sustech),
    'json': BoxFormat('.json', _read_json, write_boxes_json),
}


def find_format(paths: Sequence[Path], told: str | None = None) -> str:
    """Which format the files of one folder have, told from what is in them.

    labelCloud's two centroid forms differ in the unit of the rotations alone, so all files are looked through.

    Args:
        paths: The files; empty ones tell nothing.
        told: What labelCloud's own ``_classes.json`` says.

    Returns:
        A key of :data:`BOX_FORMATS`; 'openpcdet' where no file holds a box.

    Raises:
        BoxFileError: A file is of no known kind, the files are of several, or degrees and radians cannot be told apart,
            or look like the other of what ``told`` says.
    """
    kinds: dict[str, Path] = {}
    angles: list[float] = []
    for path in paths:
        kind, turns = _kind_of(path)
        angles += turns
        if kind:
            kinds.setdefault(kind, path)
    if len(kinds) > 1:
        told = ', '.join(f'{path.name} is {kind}' for kind, path in kinds.items())
        raise BoxFileError(
            f'{paths[0].parent}: files of several formats ({told}); keep one, or name it: box_format=...'
        )
    kind = next(iter(kinds), 'openpcdet')
    if kind == 'kitti' and told == 'kitti_untransformed':
        raise BoxFileError(
            f'{paths[0].parent}: labelCloud saved these boxes as {told}, lines in the frame of the scan; save them as '
            'centroid_rel'
        )
    return kind if kind != 'labelcloud' else f'labelcloud_{_unit_of(angles, paths[0].parent, told)}'


def labelcloud_format(folder: Path) -> str | None:
    """What labelCloud says of its files in a folder; None where it says nothing."""
    path = folder / LABELCLOUD_CLASSES
    content = _load(path) if path.is_file() else None
    found = content.get('format') if isinstance(content, dict) else None
    return None if found is None else str(found)


def _unit_of(angles: Sequence[float], folder: Path, told: str | None) -> str:
    turned = [angle for angle in angles if angle != 0]
    large = bool(turned) and max(map(abs, turned)) > np.pi + 1e-6
    seen = 'abs' if large else 'rel' if any(angle < 0 for angle in turned) else None
    if told in ('centroid_rel', 'centroid_abs'):
        unit = told.removeprefix('centroid_')
        if seen not in (None, unit):
            look = 'degrees' if seen == 'abs' else 'radians'
            raise BoxFileError(
                f'{folder / LABELCLOUD_CLASSES}: format {told}, but the rotations look like {look}; pass '
                "box_format='labelcloud_rel' (radians) or 'labelcloud_abs' (degrees)"
            )
        return unit
    if seen is not None:
        return seen
    if not turned:
        return 'rel'
    raise BoxFileError(
        f'{folder}: rotations: all lie between 0 and {max(turned):g}, which may be radians or degrees; pass '
        "box_format='labelcloud_rel' (radians) or 'labelcloud_abs' (degrees)"
    )


def _kind_of(path: Path) -> tuple[str, list[float]]:
    """The kind of one file ('' where it holds nothing), and its rotations in labelCloud's centroid form."""
    if path.suffix.lower() == '.json':
        return _kind_of_json(path)
    lines = read_text(path).split('\n')
    words = next((line.split() for line in lines if line.strip()), [])
    if not words:
        return '', []
    if len(words) in (15, 16):
        return 'kitti', []
    if len(words) in (8, 9):
        return 'openpcdet', []
    raise BoxFileError(
        f'{path}: a line of {len(words)} words; expected 15 or 16 (KITTI: class ... h w l x y z ry [score]) or 8 or 9 '
        f'({" ".join(PCDET_FIELDS)} class [score])'
    )


def _kind_of_json(path: Path) -> tuple[str, list[float]]:
    content = _load(path)
    if isinstance(content, list):
        return ('sustech' if content else ''), []
    if isinstance(content, dict) and 'boxes' in content:
        return 'json', []
    objects = content.get('objects') if isinstance(content, dict) else None
    if objects is None:
        raise BoxFileError(
            f'{path}: expected labelCloud ("objects"), SUSTechPOINTS (a list) or predictions of rm3d ("boxes")'
        )
    if not objects:
        return '', []
    _listed(content, 'objects', str(path))
    first = objects[0] if isinstance(objects[0], dict) else {}
    if 'vertices' in first:
        return 'labelcloud_vertices', []
    turns = [_triple(item, 'rotations', 'xyz', f'{path}, object {n}') for n, item in enumerate(objects, start=1)]
    return 'labelcloud', [angle for turn in turns for angle in turn]
