"""Arrays of numpy's format from files that nobody vouches for."""

import math
import zipfile
from pathlib import Path
from typing import IO

import numpy as np

_HEADERS = {1: np.lib.format.read_array_header_1_0, 2: np.lib.format.read_array_header_2_0}


def read_array(file: IO[bytes], size: int) -> np.ndarray:
    """Read one array, whose header may promise no more than the file holds: numpy makes room for what it promises.

    Args:
        file: At the start of the array; can be moved back.
        size: Bytes of the array, header included.

    Raises:
        ValueError: It holds Python objects, or promises more bytes than there are.
    """
    start = file.tell()
    major = np.lib.format.read_magic(file)[0]
    if major in _HEADERS:  # version 3 is for names of fields in other scripts
        shape, _, dtype = _HEADERS[major](file)
        promised = math.prod(shape) * dtype.itemsize
        if dtype.hasobject:
            raise ValueError('it holds Python objects, which are never read: save numbers alone')
        if promised > size:
            raise ValueError(f'shape {shape} of {dtype} makes {promised} bytes, but there are {size}')
    file.seek(start)
    array: np.ndarray = np.lib.format.read_array(file, allow_pickle=False)
    return array


def read_npy(path: Path) -> np.ndarray:
    """The array of an npy file; raises as :func:`read_array` does."""
    with path.open('rb') as file:
        return read_array(file, path.stat().st_size)


def read_archive(path: Path) -> dict[str, np.ndarray]:
    """All arrays of an npz file by name; raises as :func:`read_array` and ``zipfile`` do."""
    with zipfile.ZipFile(path) as archive:
        arrays = {}
        for entry in archive.infolist():
            with archive.open(entry) as file:
                name = entry.filename.removesuffix('.npy')
                try:
                    arrays[name] = read_array(file, entry.file_size)
                except ValueError as error:
                    raise ValueError(f'array {name!r}: {error}') from error
    return arrays
