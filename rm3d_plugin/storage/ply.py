"""Points in PLY files: ASCII and binary little-endian."""

from collections.abc import Mapping
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np

from rm3d_plugin.storage.files import atomic_write
from rm3d_plugin.storage.text_table import BadTextError, parse_table
from rm3d_plugin.structures import SceneError

_LONG = {
    'char': 'i1',
    'uchar': 'u1',
    'short': 'i2',
    'ushort': 'u2',
    'int': 'i4',
    'uint': 'u4',
    'float': 'f4',
    'double': 'f8',
}
_SIZED = {
    'int8': 'i1',
    'uint8': 'u1',
    'int16': 'i2',
    'uint16': 'u2',
    'int32': 'i4',
    'uint32': 'u4',
    'float32': 'f4',
    'float64': 'f8',
}
TYPES = _LONG | _SIZED
NAMES = {code: name for name, code in _LONG.items()}


class PlyHeader(NamedTuple):
    """What stands before the numbers.

    Attributes:
        form: 'ascii' or 'binary_little_endian'.
        before: Elements before the vertices, with how many rows and which type each has.
        rows: Vertices.
        vertex: Their type, little-endian.
    """

    form: str
    before: list[tuple[str, int, np.dtype]]
    rows: int
    vertex: np.dtype


def read_ply(path: str | Path) -> dict[str, np.ndarray]:
    """The vertices of a file, one array a property under its name in the file; other elements are passed over.

    Raises:
        SceneError: The file is missing, cut off, of another format, or has no vertices.
    """
    path = Path(path)
    if not path.is_file():
        raise SceneError(f'{path}: no such file; expected a PLY file')
    with path.open('rb') as file:
        header = _read_header(file, path)
        body = file.read()
    if header.form == 'ascii':
        return _ascii_vertices(body, header, path)
    skipped = sum(rows * kind.itemsize for _, rows, kind in header.before)
    needed = skipped + header.rows * header.vertex.itemsize
    if len(body) < needed:
        raise SceneError(
            f'{path}: {len(body)} bytes after the header, expected at least {needed}; cut off? copy it again'
        )
    table = np.frombuffer(body, dtype=header.vertex, count=header.rows, offset=skipped)
    return {name: table[name].copy() for name in header.vertex.names or ()}


def write_ply(path: str | Path, columns: Mapping[str, np.ndarray]) -> Path:
    """Write vertices, binary little-endian, atomically.

    Args:
        path: The file.
        columns: Property name -> (N,) numbers of a type that PLY knows (no 64-bit integers).

    Raises:
        ValueError: A column has another length or a type that PLY does not know.
    """
    rows = len(next(iter(columns.values())))
    kinds = []
    for name, values in columns.items():
        code = values.dtype.str[1:]
        if code not in NAMES or values.shape != (rows,):
            raise ValueError(
                f'{path}: column {name}: expected {rows} numbers of {sorted(NAMES)}, got {code} {values.shape}'
            )
        kinds.append((name, '<' + code))
    table = np.empty(rows, dtype=kinds)
    for name, values in columns.items():
        table[name] = values
    lines = ['ply', 'format binary_little_endian 1.0', f'element vertex {rows}']
    lines += [f'property {NAMES[code.lstrip("<")]} {name}' for name, code in kinds]
    header = '\n'.join([*lines, 'end_header', ''])
    return atomic_write(path, lambda file: file.write(header.encode('ascii') + table.tobytes()))


def _read_header(file: IO[bytes], path: Path) -> PlyHeader:
    if file.readline().strip() != b'ply':
        raise SceneError(f'{path}: does not begin with "ply"; expected a PLY file')
    form = ''
    elements: list[tuple[str, int, list[tuple[str, str]]]] = []
    for line in iter(file.readline, b''):
        words = line.decode('ascii', errors='replace').split()
        if not words or words[0] in ('comment', 'obj_info'):
            continue
        if words[0] == 'end_header':
            return _checked_header(form, elements, path)
        if words[0] == 'format' and len(words) > 1:
            form = words[1]
        elif words[0] == 'element' and len(words) == 3 and words[2].isdecimal():
            elements.append((words[1], int(words[2]), []))
        elif words[0] == 'property' and elements and len(words) > 2:
            kind = 'list' if words[1] == 'list' else TYPES.get(words[1])
            if kind is None:
                raise SceneError(f'{path}: property {words[-1]}: unknown type {words[1]!r}; known: {sorted(TYPES)}')
            elements[-1][2].append((words[-1], kind))
        else:
            raise SceneError(f'{path}: header line {" ".join(words)!r} is not PLY')
    raise SceneError(f'{path}: the header has no end_header; cut off? copy it again')


def _checked_header(form: str, elements: list[tuple[str, int, list[tuple[str, str]]]], path: Path) -> PlyHeader:
    if form not in ('ascii', 'binary_little_endian'):
        raise SceneError(f'{path}: format {form!r}; expected ascii or binary_little_endian, save it as one of these')
    names = [name for name, _, _ in elements]
    if 'vertex' not in names:
        raise SceneError(f'{path}: has no element vertex, got {names}')
    used = elements[: names.index('vertex') + 1]
    for name, _, properties in used:
        if any(kind == 'list' for _, kind in properties):
            raise SceneError(
                f'{path}: element {name} holds lists; expected vertices of plain numbers, first in the file'
            )
        if len(dict(properties)) != len(properties):
            raise SceneError(f'{path}: element {name} names a property twice')
    kinds = [(name, rows, np.dtype([(p, '<' + kind) for p, kind in properties])) for name, rows, properties in used]
    return PlyHeader(form, kinds[:-1], kinds[-1][1], kinds[-1][2])


def _ascii_vertices(body: bytes, header: PlyHeader, path: Path) -> dict[str, np.ndarray]:
    names = header.vertex.names or ()
    first = sum(rows for _, rows, _ in header.before)
    lines = [line for line in body.splitlines() if line.strip()][first : first + header.rows]
    if len(lines) < header.rows:
        raise SceneError(f'{path}: {len(lines)} vertices, the header says {header.rows}; cut off? copy it again')
    try:
        table = parse_table(b'\n'.join(lines), columns=len(names))
    except BadTextError as error:
        raise SceneError(f'{path}: vertex {error.line - 1}: {error.reason}; copy the file again') from error
    return {name: table[:, i].astype(header.vertex[name]) for i, name in enumerate(names)}
