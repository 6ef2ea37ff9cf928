"""ScanNet's files: mesh, labels, segments, aggregation, label map and axis alignment."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.datasets.kitti_format import is_rotation
from rm3d_plugin.storage.files import MALFORMED, read_json
from rm3d_plugin.storage.plain_files import read_text
from rm3d_plugin.storage.ply import read_ply
from rm3d_plugin.storage.scans import has_place, unit_colors
from rm3d_plugin.structures import UNLABELLED, SceneError

CLASSES = (
    'wall',
    'floor',
    'cabinet',
    'bed',
    'chair',
    'sofa',
    'table',
    'door',
    'window',
    'bookshelf',
    'picture',
    'counter',
    'desk',
    'curtain',
    'refrigerator',
    'shower curtain',
    'toilet',
    'sink',
    'bathtub',
    'otherfurniture',
)
NYU40_IDS = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 14, 16, 24, 28, 33, 34, 36, 39)
"""NYU40 id of each class, in the order of :data:`CLASSES`: what benchmark submissions are written in."""
NYU40 = 40  # ids run from 0 (not labelled) to 40
LABEL_MAP = 'scannetv2-labels.combined.tsv'


class Mesh(NamedTuple):
    """Vertices of a scan: (N, 3) float32 metres, raw axes, and (N, 3) float32 colours in [0, 1]."""

    xyz: Float[np.ndarray, 'points 3']
    colors: Float[np.ndarray, 'points 3']


class Group(NamedTuple):
    """One annotated object: its name, as annotators typed it, and the segments that make it up."""

    name: str
    segments: tuple[int, ...]


def class_of_nyu40(ids: Int[np.ndarray, ' points']) -> Int[np.ndarray, ' points']:
    """Class of each NYU40 id in 0..40; -1 for ids outside the benchmark."""
    table = np.full(NYU40 + 1, UNLABELLED, dtype=np.int64)
    table[list(NYU40_IDS)] = np.arange(len(NYU40_IDS))
    return table[ids]


def read_mesh(path: Path) -> Mesh:
    """Read ``_vh_clean_2.ply``.

    Raises:
        SceneError: The file is missing or cut off, a property is missing, or a vertex is NaN or infinite.
    """
    vertex = read_ply(path)
    _need_properties(path, vertex, ('x', 'y', 'z', 'red', 'green', 'blue'))
    xyz = np.stack([vertex[name] for name in 'xyz'], axis=1)
    bad = int((~has_place(xyz)).sum())
    if bad:
        raise SceneError(f'{path}: x, y, z: {bad} of {len(xyz)} vertices are NaN or infinite; copy the file again')
    if len(xyz) == 0:
        raise SceneError(f'{path}: element vertex: holds no points; copy the file again')
    colors = np.stack([vertex[name] for name in ('red', 'green', 'blue')], axis=1)
    return Mesh(xyz.astype(np.float32), unit_colors(colors, 'auto', path))


def read_label_ply(path: Path, rows: int) -> Int[np.ndarray, ' points']:
    """The ``label`` of each vertex of ``_vh_clean_2.labels.ply``, as it stands there.

    Raises:
        SceneError: The file cannot be read, has no ``label``, or another count of vertices than the mesh.
    """
    vertex = read_ply(path)
    _need_properties(path, vertex, ('label',))
    labels = vertex['label']
    if len(labels) != rows:
        raise SceneError(f'{path}: label: {len(labels)} labels, the mesh has {rows} vertices; copy both again')
    if not (np.isfinite(labels).all() and (labels == np.floor(labels)).all() and (labels >= 0).all()):
        raise SceneError(f'{path}: label: expected whole numbers from 0 on, got {labels.min()} to {labels.max()}')
    return labels.astype(np.int64)


def read_segments(path: Path, rows: int) -> Int[np.ndarray, ' points']:
    """The segment of each vertex from ``segs.json``.

    Raises:
        SceneError: The file cannot be read, or has another count of vertices than the mesh.
    """
    values = _json_field(path, 'segIndices', 'the segment of each vertex')
    if strange := [value for value in values if not _is_segment(value)]:
        raise SceneError(f'{path}: segIndices: expected a list of whole numbers, got {strange[0]!r:.40}')
    if len(values) != rows:
        raise SceneError(f'{path}: segIndices: {len(values)} numbers, the mesh has {rows} vertices; copy both again')
    return np.array(values, dtype=np.int64)


def read_aggregation(path: Path) -> list[Group]:
    """Annotated objects from ``aggregation.json``, in their order.

    Raises:
        SceneError: The file cannot be read, or an object has no label or segments.
    """
    groups = []
    for number, item in enumerate(_json_field(path, 'segGroups', 'the annotated objects')):
        try:
            if not (isinstance(item['segments'], list) and all(map(_is_segment, item['segments']))):
                raise ValueError('segments: expected a list of whole numbers')
            groups.append(Group(str(item['label']), tuple(item['segments'])))
        except MALFORMED as error:
            raise SceneError(
                f'{path}: segGroups[{number}]: expected label and segments, got {item!r:.80} ({error})'
            ) from error
    return groups


def read_label_map(path: Path, source: str = 'raw_category', target: str = 'nyu40id') -> dict[str, int]:
    """Name (or raw id, with ``source='id'``) -> NYU40 id.

    Raises:
        SceneError: The file is missing, a column is missing, or an id is no number.
    """
    if not path.is_file():
        raise SceneError(f"{path}: no such file; expected ScanNet's label map, put it into data_root")
    text = read_text(path, strict=False)
    rows = csv.DictReader(text.split('\n'), delimiter='\t', quoting=csv.QUOTE_NONE)
    missing = [name for name in (source, target) if name not in (rows.fieldnames or ())]
    if missing:
        raise SceneError(f'{path}: no column {missing[0]}; got {", ".join(rows.fieldnames or ()) or "nothing"}')
    out: dict[str, int] = {}
    for row in rows:
        where = f'{path}, line {rows.line_num}, {target}'
        try:
            number = int(row[target])
        except (TypeError, ValueError):
            raise SceneError(f'{where}: {row[target]!r} is no whole number') from None
        if not 0 <= number <= NYU40:
            raise SceneError(f'{where}: expected 0 to {NYU40}, got {row[target]}')
        if out.setdefault(row[source], number) != number:
            raise SceneError(f'{where}: {row[source]!r} is {number}, but {out[row[source]]} further above; correct it')
    return out


def object_of_points(segments: Int[np.ndarray, ' points'], groups: list[Group]) -> Int[np.ndarray, ' points']:
    """Number of the annotated object of each point, -1 = none; of two objects with one segment the later has it."""
    found, inverse = np.unique(segments, return_inverse=True)
    owner = np.full(len(found), UNLABELLED, dtype=np.int64)
    for number, group in enumerate(groups):
        owner[np.isin(found, group.segments)] = number
    return owner[inverse.reshape(-1)]


def nyu40_of_groups(groups: list[Group], label_map: Mapping[str, int], path: Path) -> Int[np.ndarray, ' groups']:
    """NYU40 id of each annotated object.

    Raises:
        SceneError: A name is not in the label map.
    """
    unknown = sorted({group.name for group in groups} - set(label_map))
    if unknown:
        raise SceneError(
            f'{path}: segGroups: label {unknown[0]!r} is not in {LABEL_MAP}; use the label map of this release'
        )
    return np.array([label_map[group.name] for group in groups], dtype=np.int64)


def read_axis_alignment(path: Path) -> Float[np.ndarray, '4 4'] | None:
    """The matrix that turns a scan's walls to the axes; None where the file has none (test scans).

    Raises:
        SceneError: The file is missing, or the matrix is not 16 finite numbers.
    """
    if not path.is_file():
        raise SceneError(f'{path}: no such file; expected axisAlignment, or pass align=False for raw axes')
    for line in read_text(path, strict=False).split('\n'):
        key, _, text = line.partition('=')
        if key.strip() == 'axisAlignment':
            try:
                numbers = np.array(text.split(), dtype=np.float64)
            except ValueError as error:
                raise SceneError(f'{path}: axisAlignment: {error}; expected 16 numbers') from error
            if numbers.shape != (16,) or not np.isfinite(numbers).all():
                raise SceneError(f'{path}: axisAlignment: expected 16 finite numbers, got {text.split()}')
            matrix = numbers.reshape(4, 4)
            if not is_rotation(matrix[:3, :3]):
                raise SceneError(f'{path}: axisAlignment: its first three columns are no rotation; copy the file again')
            return matrix
    return None


def align_points(xyz: Float[np.ndarray, 'points 3'], matrix: Float[np.ndarray, '4 4']) -> Float[np.ndarray, 'points 3']:
    """Points turned by a 4 x 4 matrix, computed in float64, float32."""
    turned = xyz.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    return turned.astype(np.float32)


def _need_properties(path: Path, vertex: Mapping[str, np.ndarray], names: tuple[str, ...]) -> None:
    missing = [name for name in names if name not in vertex]
    if missing:
        raise SceneError(f'{path}: vertices have no property {missing[0]}, got {", ".join(vertex)}')


def check_segments(groups: list[Group], segments: Int[np.ndarray, ' points'], path: Path, segments_path: Path) -> None:
    """Whether the annotated objects are about these segments.

    Raises:
        SceneError: Most of an annotation's segments are not there: the files are of different scans.
    """
    named = np.unique([segment for group in groups for segment in group.segments])
    lacking = named[~np.isin(named, segments)]
    if 2 * len(lacking) > len(named):
        raise SceneError(
            f'{path}: {len(lacking)} of its {len(named)} segments are not in {segments_path} (the first is '
            f'{lacking[0]}); are both of one scan? copy both again'
        )


def _is_segment(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**62


def _json_field(path: Path, field: str, what: str) -> list[Any]:
    if not path.is_file():
        raise SceneError(f'{path}: no such file; expected {what}')
    content = read_json(path)
    if not isinstance(content, dict) or not isinstance(content.get(field), list):
        raise SceneError(f'{path}: no list {field}; expected {what}')
    return list(content[field])
