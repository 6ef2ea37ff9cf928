"""Points in PCD files: ascii, binary and binary_compressed."""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: ANN001, ANN202
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit

from rm3d_plugin.storage.ply import cast_checked, warn_of_rest
from rm3d_plugin.storage.text_table import BadTextError, parse_table
from rm3d_plugin.structures import SceneError

_TYPES = {'I': 'i', 'U': 'u', 'F': 'f'}
_FORMS = ('ascii', 'binary', 'binary_compressed')
_HEADER_BYTES = 1 << 16
_MOST = 1 << 40  # points, or numbers in one: more is no file of this world
_NAN_OF_TEXT = np.float32(np.nan).view(np.uint32)  # opaque colours are NaN as floats; their bits differ
_LZF_RATIO = 90  # at most 264 bytes from 3


class PcdField(NamedTuple):
    """``width`` numbers of one type in each point; their name."""

    name: str
    kind: np.dtype
    width: int

    @property
    def is_padding(self) -> bool:
        """Room that holds nothing."""
        return self.name.startswith('_')

    @property
    def size(self) -> int:
        """Bytes a point."""
        return self.kind.itemsize * self.width


class PcdHeader(NamedTuple):
    """What stands before the points.

    Attributes:
        fields: Of a point, in order.
        rows: Points.
        form: One of ascii, binary, binary_compressed.
        sensor: Where the scanner stood; None where the header says nothing, or zeros.
        organised: Points are the pixels of an image: NaN where nothing came back.
    """

    fields: list[PcdField]
    rows: int
    form: str
    sensor: tuple[float, float, float] | None
    organised: bool


def read_pcd(path: str | Path) -> dict[str, np.ndarray]:
    """The fields of a file, one array a number; a field of several (``fpfh``, say) becomes ``fpfh_0``, ``fpfh_1``, ...

    Packed ``rgb`` and ``rgba`` become red, green, blue from 0 to 255; padding (``_``) is left out.

    Raises:
        SceneError: The file is missing, cut off, or not PCD.
    """
    path = Path(path)
    if not path.is_file():
        raise SceneError(f'{path}: no such file; expected a PCD file')
    content = path.read_bytes()
    header, start = _read_header(content, path)
    read = {'ascii': _ascii, 'binary': _binary, 'binary_compressed': _compressed}[header.form]
    named: dict[str, np.ndarray] = {}
    for field, values in zip(header.fields, read(content[start:], header, path), strict=True):
        if not field.is_padding:
            named |= {field.name: values[:, 0]} if field.width == 1 else _numbered(field.name, values)
    for name in ('rgb', 'rgba'):
        if name in named:
            named |= _unpacked(named.pop(name), header.form == 'ascii')
    return named


def read_pcd_header(path: Path) -> PcdHeader:
    """What the header of a file says.

    Raises:
        SceneError: It is not PCD.
    """
    with path.open('rb') as file:
        return _read_header(file.read(_HEADER_BYTES), path)[0]


def _numbered(name: str, values: np.ndarray) -> dict[str, np.ndarray]:
    return {f'{name}_{i}': values[:, i] for i in range(values.shape[1])}


def _read_header(content: bytes, path: Path) -> tuple[PcdHeader, int]:
    entries: dict[str, list[str]] = {}
    at = 0
    while 'DATA' not in entries:
        end = content.find(b'\n', at, _HEADER_BYTES)
        words = content[at : end if end >= 0 else min(len(content), _HEADER_BYTES)].decode('ascii', 'replace').split()
        if words and not words[0].startswith('#'):
            entries[words[0].upper()] = words[1:]
        if end < 0 or len(entries) > 20:
            break
        at = end + 1
    entries.setdefault('FIELDS', entries.pop('COLUMNS', []))  # their name in PCD 0.5
    missing = [key for key in ('FIELDS', 'SIZE', 'TYPE', 'DATA') if not entries.get(key)]
    if missing:
        raise SceneError(f'{path}: no line {missing[0]} in the header; expected a PCD file')
    form = entries['DATA'][0].lower()
    if form not in _FORMS:
        raise SceneError(f'{path}: DATA {form!r}; expected one of {", ".join(_FORMS)}')
    try:
        header = _header_of(entries, form)
    except (KeyError, IndexError, ValueError, TypeError) as error:
        raise SceneError(
            f'{path}: header: FIELDS, SIZE, TYPE, COUNT, WIDTH and POINTS do not fit ({error}); copy it again'
        ) from error
    used = [field.name for field in header.fields if not field.is_padding]
    if len(set(used)) != len(used):
        raise SceneError(f'{path}: FIELDS names a field twice: {" ".join(used[:12])}')
    return header, at


def _header_of(entries: Mapping[str, list[str]], form: str) -> PcdHeader:
    """Raises ValueError, KeyError, IndexError or TypeError where an entry makes no sense."""
    names = entries['FIELDS']
    counts = [int(count) for count in entries.get('COUNT') or ['1'] * len(names)]
    shape = [int(entries[key][0]) if entries.get(key) else 1 for key in ('WIDTH', 'HEIGHT')]
    rows = int(entries['POINTS'][0]) if entries.get('POINTS') else shape[0] * shape[1]
    if min(counts) < 1 or rows < 0 or max(*counts, rows) > _MOST:
        raise ValueError(f'COUNT {min(counts)} to {max(counts)}, {rows} points')
    if entries.get('WIDTH') and entries.get('HEIGHT') and rows != shape[0] * shape[1]:
        raise ValueError(f'POINTS {rows}, but WIDTH {shape[0]} and HEIGHT {shape[1]}')
    kinds = [
        np.dtype(f'<{_TYPES[kind.upper()]}{int(size)}')
        for size, kind in zip(entries['SIZE'], entries['TYPE'], strict=True)
    ]
    fields = [PcdField(*parts) for parts in zip(names, kinds, counts, strict=True)]
    view = [float(word) for word in entries.get('VIEWPOINT', [])[:3]]
    x, y, z = view if len(view) == 3 and np.isfinite(view).all() else (0.0, 0.0, 0.0)
    return PcdHeader(fields, rows, form, (x, y, z) if x or y or z else None, shape[1] > 1)


def _ascii(body: bytes, header: PcdHeader, path: Path) -> list[np.ndarray]:
    ends = np.cumsum([field.width for field in header.fields]).tolist()
    if header.rows and ends[-1] > len(body):
        raise SceneError(f'{path}: {len(body)} bytes of points, but COUNT says {ends[-1]} numbers each; cut off?')
    try:
        table = parse_table(body, columns=ends[-1])
    except BadTextError as error:
        raise SceneError(f'{path}: after the header, {error}') from error
    if len(table) != header.rows:
        raise SceneError(f'{path}: {len(table)} points, the header says {header.rows}; cut off? copy it again')
    return [
        table[:, end - field.width : end]
        if field.is_padding
        else cast_checked(table[:, end - field.width : end], field.kind, f'{path}: {field.name}')
        for end, field in zip(ends, header.fields, strict=True)
    ]


def _binary(body: bytes, header: PcdHeader, path: Path) -> list[np.ndarray]:
    size = sum(field.size for field in header.fields)
    _need(path, len(body), size * header.rows)
    warn_of_rest(path, len(body) - size * header.rows, size, f'POINTS {header.rows}')
    rows = np.frombuffer(body, dtype=np.uint8, count=size * header.rows).reshape(header.rows, size)
    ends = np.cumsum([field.size for field in header.fields]).tolist()
    return [
        np.ascontiguousarray(rows[:, end - field.size : end]).view(field.kind)
        if not field.is_padding
        else rows[:, end - field.size : end]
        for end, field in zip(ends, header.fields, strict=True)
    ]


def _compressed(body: bytes, header: PcdHeader, path: Path) -> list[np.ndarray]:
    """LZF over the fields one after the other; before it, the sizes packed and unpacked."""
    _need(path, len(body), 8)
    packed, size = np.frombuffer(body, dtype='<u4', count=2).tolist()
    ends = [header.rows * end for end in np.cumsum([field.size for field in header.fields]).tolist()]
    if size != ends[-1]:
        raise SceneError(f'{path}: unpacks to {size} bytes, which is not {header.rows} points; copy it again')
    _need(path, len(body) - 8, packed)
    if size > _LZF_RATIO * packed:
        raise SceneError(f'{path}: {packed} bytes cannot unpack to {size}; copy the file again')
    out = np.zeros(size, dtype=np.uint8)
    if _unpack_lzf(np.frombuffer(body, dtype=np.uint8, offset=8, count=packed), out) != size:
        raise SceneError(f'{path}: the compressed points are damaged; copy the file again')
    return [
        out[end - field.size * header.rows : end].view(field.kind).reshape(header.rows, field.width)
        for end, field in zip(ends, header.fields, strict=True)
    ]


def _need(path: Path, got: int, expected: int) -> None:
    if got < expected:
        raise SceneError(f'{path}: {got} bytes of points, expected {expected}; cut off? copy it again')


def _unpacked(rgb: np.ndarray, from_text: bool) -> dict[str, np.ndarray]:
    """Red, green and blue from the lowest 24 bits, whatever type they travel in; NaN where text lost them."""
    bits = rgb.astype(np.float32).view(np.uint32) if rgb.dtype.kind == 'f' else rgb.astype(np.uint32)
    if rgb.dtype.kind == 'f' and ((rgb == 0) | ((rgb >= 1) & (rgb < 1 << 24) & (rgb == np.floor(rgb)))).all():
        bits = rgb.astype(np.uint32)  # the number, not its bits
    shifts = (('red', 16), ('green', 8), ('blue', 0))
    parts = {name: (bits >> shift & 255).astype(np.uint8) for name, shift in shifts}
    lost = np.isnan(rgb) if from_text and rgb.dtype.kind == 'f' else bits == _NAN_OF_TEXT
    return {name: np.where(lost, np.nan, values) for name, values in parts.items()} if lost.any() else parts


@njit(cache=True)
def _unpack_lzf(data, out):
    """Bytes written to ``out``, or -1 where the data make no sense."""
    i, n = 0, 0
    while i < len(data):
        head = int(data[i])
        i += 1
        if head < 32:  # so many plain bytes, and one
            if i + head + 1 > len(data) or n + head + 1 > len(out):
                return -1
            for _ in range(head + 1):
                out[n] = data[i]
                n += 1
                i += 1
            continue
        length = head >> 5
        if length == 7:
            if i >= len(data):
                return -1
            length += int(data[i])
            i += 1
        if i >= len(data):
            return -1
        source = n - ((head & 31) << 8) - int(data[i]) - 1
        i += 1
        if source < 0 or n + length + 2 > len(out):
            return -1
        for _ in range(length + 2):  # byte by byte: the copy may run into itself
            out[n] = out[source]
            n += 1
            source += 1
    return n
