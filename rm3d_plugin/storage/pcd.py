"""Points in PCD files: ascii, binary and binary_compressed."""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: ANN001, ANN202
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit

from rm3d_plugin.storage.text_table import BadTextError, parse_table
from rm3d_plugin.structures import SceneError

_TYPES = {'I': 'i', 'U': 'u', 'F': 'f'}
_FORMS = ('ascii', 'binary', 'binary_compressed')


class PcdHeader(NamedTuple):
    """What stands before the points: names and type of a point's numbers, how many points, and in which form."""

    names: list[str]
    kinds: list[str]
    rows: int
    form: str


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
    body = content[start:]
    if header.form == 'ascii':
        columns = _ascii(body, header, path)
    elif header.form == 'binary':
        columns = _binary(body, header, path)
    else:
        columns = _compressed(body, header, path)
    named = {name: column for name, column in zip(header.names, columns, strict=True) if not name.startswith('_')}
    for name in ('rgb', 'rgba'):
        if name in named:
            named |= _unpacked(named.pop(name))
    return named


def _read_header(content: bytes, path: Path) -> tuple[PcdHeader, int]:
    entries: dict[str, list[str]] = {}
    at = 0
    while 'DATA' not in entries:
        end = content.find(b'\n', at)
        words = content[at : end if end >= 0 else len(content)].decode('ascii', errors='replace').split()
        if words and not words[0].startswith('#'):
            entries[words[0].upper()] = words[1:]
        if end < 0 or len(entries) > 20:
            break
        at = end + 1
    missing = [key for key in ('FIELDS', 'SIZE', 'TYPE', 'DATA') if not entries.get(key)]
    if missing:
        raise SceneError(f'{path}: no line {missing[0]} in the header; expected a PCD file')
    counts = entries.get('COUNT') or ['1'] * len(entries['FIELDS'])
    try:
        rows = (
            int(entries['POINTS'][0]) if entries.get('POINTS') else int(entries['WIDTH'][0]) * int(entries['HEIGHT'][0])
        )
        names, kinds = [], []
        for name, size, kind, count in zip(entries['FIELDS'], entries['SIZE'], entries['TYPE'], counts, strict=True):
            names += [name] if int(count) == 1 else [f'{name}_{i}' for i in range(int(count))]
            kinds += [np.dtype(f'<{_TYPES[kind.upper()]}{int(size)}').str] * int(count)
    except (KeyError, IndexError, ValueError, TypeError) as error:
        raise SceneError(f'{path}: header: FIELDS, SIZE, TYPE, COUNT and POINTS do not fit: {error!r}') from error
    form = entries['DATA'][0].lower()
    if form not in _FORMS:
        raise SceneError(f'{path}: DATA {form!r}; expected one of {", ".join(_FORMS)}')
    used = [name for name in names if not name.startswith('_')]
    if len(set(used)) != len(used):
        raise SceneError(f'{path}: FIELDS names a field twice: {" ".join(used)}')
    return PcdHeader(names, kinds, rows, form), at


def _ascii(body: bytes, header: PcdHeader, path: Path) -> list[np.ndarray]:
    try:
        table = parse_table(body, columns=len(header.names))
    except BadTextError as error:
        raise SceneError(f'{path}: after the header, {error}') from error
    if len(table) != header.rows:
        raise SceneError(f'{path}: {len(table)} points, the header says {header.rows}; cut off? copy it again')
    return [table[:, i].astype(kind) for i, kind in enumerate(header.kinds)]


def _binary(body: bytes, header: PcdHeader, path: Path) -> list[np.ndarray]:
    row = np.dtype([(f'f{i}', kind) for i, kind in enumerate(header.kinds)])
    _need(path, len(body), row.itemsize * header.rows)
    table = np.frombuffer(body, dtype=row, count=header.rows)
    return [table[f'f{i}'].copy() for i in range(len(header.kinds))]


def _compressed(body: bytes, header: PcdHeader, path: Path) -> list[np.ndarray]:
    """LZF over the fields one after the other; before it, the sizes packed and unpacked."""
    _need(path, len(body), 8)
    packed, size = np.frombuffer(body, dtype='<u4', count=2).tolist()
    kinds = [np.dtype(kind) for kind in header.kinds]
    if size != sum(kind.itemsize for kind in kinds) * header.rows:
        raise SceneError(f'{path}: unpacks to {size} bytes, which is not {header.rows} points; copy it again')
    _need(path, len(body) - 8, packed)
    out = np.zeros(size, dtype=np.uint8)
    if _unpack_lzf(np.frombuffer(body, dtype=np.uint8, offset=8, count=packed), out) != size:
        raise SceneError(f'{path}: the compressed points are damaged; copy the file again')
    ends = np.cumsum([kind.itemsize * header.rows for kind in kinds]).tolist()
    return [
        out[end - kind.itemsize * header.rows : end].view(kind).copy() for end, kind in zip(ends, kinds, strict=True)
    ]


def _need(path: Path, got: int, expected: int) -> None:
    if got < expected:
        raise SceneError(f'{path}: {got} bytes of points, expected {expected}; cut off? copy it again')


def _unpacked(rgb: np.ndarray) -> dict[str, np.ndarray]:
    """Red, green and blue from the lowest 24 bits, whatever type they travel in."""
    bits = rgb.astype(np.float32).view(np.uint32) if rgb.dtype.kind == 'f' else rgb.astype(np.uint32)
    shifts = (('red', 16), ('green', 8), ('blue', 0))
    return {name: (bits >> shift & 255).astype(np.uint8) for name, shift in shifts}


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
