"""ScanNet's files: mesh, labels, segments, aggregation, label map and axis alignment."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.storage.files import MALFORMED, read_json
from rm3d_plugin.storage.ply import read_ply
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
    xyz = np.stack([vertex[name] for name in 'xyz'], axis=1).astype(np.float32)
    bad = int((~np.isfinite(xyz).all(axis=1)).sum())
    if bad:
        raise SceneError(f'{path}: x, y, z: {bad} of {len(xyz)} vertices are NaN or infinite; copy the file again')
    if len(xyz) == 0:
        raise SceneError(f'{path}: element vertex: holds no points; copy the file again')
    colors = np.stack([vertex[name] for name in ('red', 'green', 'blue')], axis=1)
    return Mesh(xyz, (colors / 255.0).astype(np.float32))


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
    whole = labels.astype(np.int64)
    if (whole != labels).any() or (len(whole) and whole.min() < 0):
        raise SceneError(f'{path}: label: expected whole numbers from 0 on, got {labels.min()} to {labels.max()}')
    return whole


def read_segments(path: Path, rows: int) -> Int[np.ndarray, ' points']:
    """The segment of each vertex from ``segs.json``.

    Raises:
        SceneError: The file cannot be read, or has another count of vertices than the mesh.
    """
    values = _json_field(path, 'segIndices', 'the segment of each vertex')
    try:
        segments = np.array(values, dtype=np.int64)
    except (TypeError, ValueError, OverflowError) as error:
        raise SceneError(f'{path}: segIndices: expected a list of whole numbers: {error}') from error
    if segments.shape != (rows,):
        raise SceneError(f'{path}: segIndices: {len(values)} numbers, the mesh has {rows} vertices; copy both again')
    return segments


def read_aggregation(path: Path) -> list[Group]:
    """Annotated objects from ``aggregation.json``, in their order.

    Raises:
        SceneError: The file cannot be read, or an object has no label or segments.
    """
    groups = []
    for number, item in enumerate(_json_field(path, 'segGroups', 'the annotated objects')):
        try:
            groups.append(Group(str(item['label']), tuple(int(segment) for segment in item['segments'])))
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
    with path.open(encoding='utf-8', errors='replace', newline='') as file:
        rows = csv.DictReader(file, delimiter='\t', quoting=csv.QUOTE_NONE)
        missing = [name for name in (source, target) if name not in (rows.fieldnames or ())]
        if missing:
            raise SceneError(f'{path}: no column {missing[0]}; got {", ".join(rows.fieldnames or ()) or "nothing"}')
        out = {}
        for line, row in enumerate(rows, start=2):
            try:
                out[row[source]] = int(row[target])
            except (TypeError, ValueError):
                raise SceneError(f'{path}, line {line}, {target}: {row[target]!r} is no whole number') from None
            if not 0 <= out[row[source]] <= NYU40:
                raise SceneError(f'{path}, line {line}, {target}: expected 0 to {NYU40}, got {row[target]}')
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
    for line in path.read_text(encoding='utf-8-sig', errors='replace').splitlines():
        key, _, text = line.partition('=')
        if key.strip() == 'axisAlignment':
            try:
                numbers = np.array(text.split(), dtype=np.float64)
            except ValueError as error:
                raise SceneError(f'{path}: axisAlignment: {error}; expected 16 numbers') from error
            if numbers.shape != (16,) or not np.isfinite(numbers).all():
                raise SceneError(f'{path}: axisAlignment: expected 16 finite numbers, got {text.split()}')
            return numbers.reshape(4, 4)
    return None


def align_points(xyz: Float[np.ndarray, 'points 3'], matrix: Float[np.ndarray, '4 4']) -> Float[np.ndarray, 'points 3']:
    """Points turned by a 4 x 4 matrix, computed in float64, float32."""
    turned = xyz.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    return turned.astype(np.float32)


def _need_properties(path: Path, vertex: Mapping[str, np.ndarray], names: tuple[str, ...]) -> None:
    missing = [name for name in names if name not in vertex]
    if missing:
        raise SceneError(f'{path}: vertices have no property {missing[0]}, got {", ".join(vertex)}')


def _json_field(path: Path, field: str, what: str) -> list[Any]:
    if not path.is_file():
        raise SceneError(f'{path}: no such file; expected {what}')
    content = read_json(path)
    if not isinstance(content, dict) or not isinstance(content.get(field), list):
        raise SceneError(f'{path}: no list {field}; expected {what}')
    return list(content[field])
