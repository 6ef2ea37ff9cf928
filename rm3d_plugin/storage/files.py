"""The files everything else is kept in: npz, JSON and text, never half-written, never pickled.

A file is written beside its final place, flushed to the disk and then renamed: whoever reads sees the old file or the
new one, also after a crash. An npz file carries its format version and a hash of its arrays, so that a damaged one is
told apart from a good one.
"""

import hashlib
import io
import json
import math
import os
import secrets
import time
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from rm3d_plugin.storage.npy import read_array
from rm3d_plugin.storage.written_files import note_written
from rm3d_plugin.structures import SceneError
from rm3d_plugin.user_error import UserError

FORMAT_VERSION = 1
_HASH, _VERSION = '__sha256__', '__format__'


class DamagedFileError(SceneError):
    """A file that exists but cannot be trusted; the message names it."""


MALFORMED = (KeyError, TypeError, AttributeError, ValueError, IndexError, OverflowError, RecursionError)
"""What plain values of an unexpected shape raise when they are taken apart."""


@contextmanager
def content_of(path: str | Path, what: str) -> Iterator[None]:
    """Within it, the content of a file is taken apart.

    Raises:
        DamagedFileError: The file was readable, but says something else than ``what``.
    """
    try:
        yield
    except UserError:
        raise
    except MALFORMED as error:
        reason = f'{type(error).__name__}: {error}'
        raise DamagedFileError(f'{path}: is not {what} ({reason}); delete it and make it again') from error


def atomic_write(path: str | Path, write: Callable[[IO[bytes]], object]) -> Path:
    """Write a file so that it is there as a whole or not at all.

    Args:
        path: Where the file shall lie; its folder is made.
        write: Receives the open file. If it raises, the old file stays and nothing new is left behind.

    Returns:
        The path.

    Raises:
        OSError: The disk is full, or the folder cannot be written to; names the file.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.parent / f'.{path.name[:100]}.{os.getpid()}.{secrets.token_hex(4)}.tmp'
    try:
        with unfinished.open('xb') as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        note_written(path)
        os.replace(unfinished, path)
    except OSError as error:  # a full disk names no file
        if error.errno is not None and error.filename is None:
            error.filename = str(path)
        raise
    finally:
        unfinished.unlink(missing_ok=True)
    _flush_folder(path.parent)
    return path


def remove_unfinished(folder: str | Path, pattern: str, older: float = 0.0) -> None:
    """Remove what a killed process left of files that it was writing.

    Args:
        folder: Where the files lie, in it or below.
        pattern: Of their names, such as ``*.pth``.
        older: Seconds; what was written to since then stays, since a living process may be writing it.
    """
    before = time.time() - older
    for rest in Path(folder).rglob(f'.{pattern}.*.tmp'):
        with suppress(FileNotFoundError):  # another process removed it
            if rest.stat().st_mtime <= before:
                rest.unlink()


def _flush_folder(folder: Path) -> None:
    """Make a rename survive a power cut, where the system can (not on Windows)."""
    if os.name == 'posix':
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def write_bytes(path: str | Path, data: bytes) -> Path:
    """Write bytes, atomically."""
    return atomic_write(path, lambda file: file.write(data))


def write_text(path: str | Path, text: str) -> Path:
    """Write UTF-8 text, atomically."""
    return write_bytes(path, text.encode('utf-8'))


def write_json(path: str | Path, value: Any) -> Path:
    """Write JSON, atomically; numpy numbers and arrays become plain ones, NaN and infinity become null."""
    return write_text(path, json.dumps(plain_json(value), indent=2, allow_nan=False, ensure_ascii=False) + '\n')


def parse_json(text: str | bytes) -> Any:
    """The value of a JSON text.

    Raises:
        ValueError: It is not JSON, or brackets stand in brackets too often.
    """
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError('nested too deeply') from error


def read_json(path: str | Path) -> Any:
    """Read JSON.

    Raises:
        FileNotFoundError: There is no such file.
        DamagedFileError: It is not JSON.
    """
    try:
        return parse_json(Path(path).read_bytes())
    except ValueError as error:
        raise DamagedFileError(f'{path}: not readable as JSON ({error}); delete it and make it again') from error


def plain_json(value: Any) -> Any:
    """The value as JSON can hold it: numpy numbers and arrays become plain ones, NaN and infinity become None."""
    if isinstance(value, Mapping):
        return {str(key): plain_json(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain_json(value.tolist())
    if isinstance(value, list | tuple):
        return [plain_json(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def write_npz(path: str | Path, arrays: Mapping[str, np.ndarray]) -> Path:
    """Write named arrays, atomically, with their hash; equal arrays give equal bytes.

    Args:
        path: The file.
        arrays: Name -> array of numbers, booleans or fixed-length text.

    Raises:
        SceneError: A name is not usable.
        ValueError: An array holds Python objects.
    """
    plain = {name: np.asarray(value) for name, value in arrays.items()}
    for name, value in plain.items():
        if not name or '/' in name or '\\' in name or name in (_HASH, _VERSION):
            raise SceneError(f'{path}: {name!r} cannot name an array; rename it in the file that it comes from')
        if value.dtype.hasobject:
            raise ValueError(f'{path}: array {name!r} holds Python objects (dtype {value.dtype}); store numbers')
    plain[_VERSION] = np.array(FORMAT_VERSION)
    plain[_HASH] = np.array(hash_arrays(arrays))
    return atomic_write(path, lambda file: _zip(file, plain))


def _zip(file: IO[bytes], arrays: Mapping[str, np.ndarray]) -> None:
    """As numpy.savez, without time stamps; real numbers, which hardly shrink, are not compressed."""
    with zipfile.ZipFile(file, 'w') as archive:
        for name, value in arrays.items():
            info = zipfile.ZipInfo(f'{name}.npy')
            info.compress_type = zipfile.ZIP_STORED if value.dtype.kind == 'f' else zipfile.ZIP_DEFLATED
            info._compresslevel = 1  # type: ignore[attr-defined]  # the public name comes with Python 3.13
            with archive.open(info, 'w', force_zip64=True) as entry:
                np.lib.format.write_array(entry, value, allow_pickle=False)


def read_npz(path: str | Path) -> dict[str, np.ndarray]:
    """Read what :func:`write_npz` wrote, and check it.

    Raises:
        FileNotFoundError: There is no such file.
        DamagedFileError: It is cut off, altered, of another program, or of another format version.
    """
    data = Path(path).read_bytes()
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            arrays = {entry.filename.removesuffix('.npy'): _entry(archive, entry) for entry in archive.infolist()}
    except Exception as error:  # damage shows as anything from zlib.error to MemoryError
        raise DamagedFileError(f'{path}: cut off or altered ({error}); delete it and make it again') from error
    version, digest = arrays.pop(_VERSION, None), arrays.pop(_HASH, None)
    if version is None or digest is None:
        raise DamagedFileError(f'{path}: holds no format version and hash, so another program wrote it')
    if version.shape != () or int(version) != FORMAT_VERSION:
        raise DamagedFileError(f'{path}: format version {version}, expected {FORMAT_VERSION}; make it again')
    if str(digest) != hash_arrays(arrays):
        raise DamagedFileError(f'{path}: the arrays do not fit their hash; delete it and make it again')
    return arrays


def _entry(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> np.ndarray:
    with archive.open(entry) as file:
        return read_array(file, entry.file_size)


def hash_arrays(arrays: Mapping[str, np.ndarray]) -> str:
    """SHA-256 over names, types, shapes and values; the order of the names does not matter."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        _feed(digest.update, name)
        _feed(digest.update, np.asarray(arrays[name]))
    return digest.hexdigest()


def content_key(*parts: Any) -> str:
    """A short name for content: equal content, equal key, on every machine.

    Args:
        parts: Arrays, numbers, text, None, paths, and sequences, mappings and dataclasses of these. The order of a
            mapping's keys does not matter; 1, 1.0 and True are different content.

    Returns:
        32 hexadecimal digits.

    Raises:
        TypeError: A part has no stable content (a function, say).

    >>> content_key({'a': 1, 'b': 2.0}) == content_key({'b': 2.0, 'a': 1})
    True
    """
    digest = hashlib.sha256()
    _feed(digest.update, parts)
    return digest.hexdigest()[:32]


def _feed(update: Callable[[bytes], None], part: Any) -> None:
    """Hash one part behind its kind and length, so that no two parts run into each other."""
    if isinstance(part, np.ndarray) and not part.dtype.hasobject:
        values = np.ascontiguousarray(part)
        update(f'array {values.dtype.str} {part.shape};'.encode())
        update(values.tobytes())
    elif part is None or isinstance(part, bool | int | float | str | Path | np.generic):
        value = part.item() if isinstance(part, np.generic) else part
        text = str(value) if isinstance(value, Path) else repr(value)
        update(f'{type(value).__name__ if not isinstance(value, Path) else "path"} {len(text)};{text}'.encode())
    elif is_dataclass(part) and not isinstance(part, type):
        update(f'dataclass {type(part).__name__};'.encode())
        _feed(update, {field.name: getattr(part, field.name) for field in fields(part)})
    elif isinstance(part, Mapping):
        update(f'mapping {len(part)};'.encode())
        for key in sorted(part, key=repr):
            _feed(update, key)
            _feed(update, part[key])
    elif isinstance(part, Sequence) and not isinstance(part, bytes):
        update(f'sequence {len(part)};'.encode())
        for item in part:
            _feed(update, item)
    else:
        raise TypeError(f'content_key: {type(part).__name__} has no stable content; pass arrays and plain values')
