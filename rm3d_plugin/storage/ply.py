"""Points in PLY files: ASCII and binary of either byte order; lists are passed over."""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: ANN001, ANN202
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np
from numba import njit

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
_WRITTEN_BY_SOME = {'int64': 'i8', 'uint64': 'u8', 'long': 'i8', 'ulong': 'u8', 'bool': 'u1'}
TYPES = _LONG | _SIZED | _WRITTEN_BY_SOME
_ORDERS = {'ascii': '<', 'binary_little_endian': '<', 'binary_big_endian': '>'}
NAMES = {code: name for name, code in _LONG.items()}


class Property(NamedTuple):
    """A number of an element, or a list of them.

    Attributes:
        name: As in the file.
        kind: Type of the number, or of a list's items, with its byte order.
        length: Type of the number that tells a list's length; None: no list.
    """

    name: str
    kind: np.dtype
    length: np.dtype | None = None


class Element(NamedTuple):
    """Rows of the same properties."""

    name: str
    rows: int
    properties: list[Property]

    @property
    def kind(self) -> np.dtype:
        """A row without its lists, packed."""
        return np.dtype([(p.name, p.kind) for p in self.properties if p.length is None])

    @property
    def has_lists(self) -> bool:
        """Whether rows may differ in length."""
        return any(p.length is not None for p in self.properties)


class PlyHeader(NamedTuple):
    """What stands before the numbers.

    Attributes:
        form: One of ``ascii``, ``binary_..._endian``.
        elements: Up to the vertices.
        is_whole: Whether nothing comes behind the vertices.
    """

    form: str
    elements: list[Element]
    is_whole: bool


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
    at, table = 0, np.zeros(0, dtype=header.elements[-1].kind)
    for element in header.elements:
        at, table = _binary_rows(body, at, element, path)
    if header.is_whole:
        warn_of_rest(path, len(body) - at, table.dtype.itemsize, f'element vertex {len(table)}')
    return {name: _native(table[name]) for name in table.dtype.names or ()}


def _native(values: np.ndarray) -> np.ndarray:
    return values.astype(values.dtype.newbyteorder('='))


def _binary_rows(body: bytes, at: int, element: Element, path: Path) -> tuple[int, np.ndarray]:
    """Where the element's rows end that begin at ``at``, and the rows without their lists."""
    kind, rows = element.kind, element.rows
    if not element.properties:
        return at, np.zeros(0)
    if not element.has_lists:
        end = at + rows * kind.itemsize
        if end <= len(body):
            return end, np.frombuffer(body, dtype=kind, count=rows, offset=at)
        raise SceneError(f'{path}: {len(body)} bytes after the header, expected at least {end}; cut off? copy it again')
    if rows > len(body) - at:  # each list takes a byte at least
        raise SceneError(
            f'{path}: {len(body)} bytes after the header, fewer than {rows} {element.name}s; copy it again'
        )
    layout = np.array([[p.kind.itemsize, p.length.itemsize if p.length else 0] for p in element.properties])
    out = np.zeros(rows * kind.itemsize, dtype=np.uint8)
    big = any('>' in (p.kind.byteorder, p.length.byteorder if p.length else '') for p in element.properties)
    end = _pack_rows(np.frombuffer(body, dtype=np.uint8), at, layout, rows, big, out)
    if end < 0:
        raise SceneError(f'{path}: the lists of element {element.name} run past the end of the file; copy it again')
    return end, out.view(kind) if kind.itemsize else np.zeros(0)  # of lists alone nothing is left


@njit(cache=True)
def _pack_rows(data, at, layout, rows, big, out):
    """Copy the plain numbers of each row; where the rows end, or -1 where that is past the data."""
    n, packed = len(data), 0
    for _ in range(rows):
        for p in range(len(layout)):
            size, count_size = layout[p, 0], layout[p, 1]
            if count_size:
                if at + count_size > n:
                    return -1
                count = 0
                for b in range(count_size):
                    shift = 8 * (count_size - 1 - b if big else b)
                    count |= int(data[at + b]) << shift
                at += count_size
                if count < 0 or count > (n - at) // size:
                    return -1
                at += count * size
                continue
            if at + size > n:
                return -1
            out[packed : packed + size] = data[at : at + size]
            packed += size
            at += size
    return at


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
    if file.readline().removeprefix(b'\xef\xbb\xbf').strip() != b'ply':
        raise SceneError(f'{path}: does not begin with "ply"; expected a PLY file')
    form = ''
    elements: list[tuple[str, int, list[list[str]]]] = []
    for line in iter(file.readline, b''):
        words = line.decode('ascii', errors='replace').split()
        if not words or words[0] in ('comment', 'obj_info'):
            continue
        if words[0] == 'end_header':
            return _checked_header(form, elements, path)
        if words[0] == 'format' and len(words) > 1:
            form = words[1]
        elif words[0] == 'element' and len(words) == 3 and words[2].isdecimal() and len(words[2]) < 19:
            elements.append((words[1], int(words[2]), []))
        elif words[0] == 'property' and elements and len(words) > 2:
            elements[-1][2].append(words[1:])
        else:
            raise SceneError(f'{path}: header line {" ".join(words)[:80]!r} is not PLY')
    raise SceneError(f'{path}: the header has no end_header; cut off? copy it again')


def _checked_header(form: str, elements: list[tuple[str, int, list[list[str]]]], path: Path) -> PlyHeader:
    if form not in _ORDERS:
        raise SceneError(f'{path}: format {form!r}; expected one of {", ".join(_ORDERS)}')
    names = [name for name, _, _ in elements]
    if 'vertex' not in names:
        raise SceneError(f'{path}: has no element vertex, got {names[:12]}')
    if names.count('vertex') > 1:
        raise SceneError(f'{path}: has several elements vertex, expected one; export each mesh by itself')
    used = elements[: names.index('vertex') + 1]
    read = [Element(name, rows, [_property(p, _ORDERS[form], path) for p in parts]) for name, rows, parts in used]
    for name, _, properties in read:
        if len({p.name for p in properties}) != len(properties):
            raise SceneError(f'{path}: element {name} names a property twice')
    if all(p.length is not None for p in read[-1].properties):
        raise SceneError(f'{path}: element vertex has no numbers')
    return PlyHeader(form, read, len(used) == len(elements))


def _property(words: list[str], order: str, path: Path) -> Property:
    """A property from its words: ``float x``, or ``list uchar int indices``."""
    kinds = words[1:3] if words[0] == 'list' else words[:1]
    if len(words) != len(kinds) + (2 if words[0] == 'list' else 1):
        raise SceneError(f'{path}: header line {" ".join(["property", *words])[:80]!r} is not PLY')
    for kind in kinds:
        if kind not in TYPES:
            raise SceneError(f'{path}: property {words[-1]}: unknown type {kind!r}; known: {sorted(TYPES)}')
    found = [np.dtype(order + TYPES[kind]) for kind in kinds]
    return Property(words[-1], found[-1], found[0] if words[0] == 'list' else None)


def _ascii_vertices(body: bytes, header: PlyHeader, path: Path) -> dict[str, np.ndarray]:
    vertex = header.elements[-1]
    first = sum(element.rows for element in header.elements[:-1])
    lines = [line for line in body.splitlines() if line.strip()]
    rest = b'\n'.join(lines[first + vertex.rows :]) if header.is_whole else b''
    lines = lines[first : first + vertex.rows]
    if len(lines) < vertex.rows:
        raise SceneError(f'{path}: {len(lines)} vertices, the header says {vertex.rows}; cut off? copy it again')
    names = vertex.kind.names or ()
    try:
        lines = [_without_lists(line, vertex, path) for line in lines] if vertex.has_lists else lines
        table = parse_table(b'\n'.join(lines), columns=len(names))
    except BadTextError as error:
        raise SceneError(f'{path}: vertex {error.line - 1}: {error.reason}; copy the file again') from error
    warn_of_rest(path, len(rest), len(lines[-1]) // 2 if lines else 1, f'element vertex {vertex.rows}')
    return {name: cast_checked(table[:, i], vertex.kind[name], f'{path}: {name}') for i, name in enumerate(names)}


def _without_lists(line: bytes, element: Element, path: Path) -> bytes:
    words, kept, at = line.split(), [], 0
    for part in element.properties:
        if part.length is None:
            kept += words[at : at + 1]
            at += 1
        elif at < len(words) and words[at].isdigit():
            at += 1 + int(words[at])
        else:
            raise SceneError(f'{path}: {part.name}: expected the length of a list, got {line[:80]!r}')
    return b' '.join([*kept, *words[at:]])


def warn_of_rest(path: Path, left: int, point: int, announced: str) -> None:
    """A warning where behind the last point there is room for another.

    Args:
        path: The file.
        left: Bytes behind the last point.
        point: Bytes that a point takes.
        announced: What the header says.
    """
    if left >= max(point, 1):
        warnings.warn(
            f'{path}: the header says {announced}, but {left} bytes follow, which are not read; a wrong count, or a '
            'file changed on its way?',
            stacklevel=4,
        )


def cast_checked(values: np.ndarray, kind: np.dtype, where: str) -> np.ndarray:
    """Numbers read from text as a type that a header names.

    Raises:
        SceneError: An integer type cannot hold one of them; the message begins with ``where``.
    """
    if kind.kind in 'iu' and len(values):
        limits = np.iinfo(kind)
        wrong = ~((values >= limits.min) & (values <= limits.max) & (values % 1 == 0))
        if wrong.any():
            raise SceneError(f'{where}: expected a whole number that {kind.name} holds, got {values[wrong][0]:g}')
    return values.astype(kind)
