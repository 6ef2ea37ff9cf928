"""A scan with a label for each point, in the format of its file and with the fields that it had."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np

from rm3d_plugin.storage.exports import need_laspy
from rm3d_plugin.storage.files import atomic_write, write_npz
from rm3d_plugin.storage.ply import NAMES, write_ply

GIVEN = 'input_'  # before the name of a field that would hide one that is added
Arrays = Mapping[str, np.ndarray]


def labelled_ending(source: Path) -> str:
    """Ending of what :func:`write_labelled` writes for a scan: its own for LAS, LAZ, npz and PLY, else ``.ply``."""
    ending = source.suffix.lower()
    return ending if ending in _KEPT else '.ply'


def write_labelled(source: Path, target: Path, columns: Arrays, added: Arrays) -> Path:
    """Write a scan again with further fields, atomically; a field of the same name is kept as ``input_NAME``.

    Args:
        source: The scan.
        target: With the ending of :func:`labelled_ending`.
        columns: Of the scan, from :func:`rm3d_plugin.storage.columns.read_columns`.
        added: (N,) numbers of 32 bits, by name.

    Raises:
        SceneError: LAS needs a package that is not installed.
    """
    return _KEPT.get(source.suffix.lower(), _ply)(source, target, columns, added)


def _kept_names(names: Iterable[str], added: Arrays) -> dict[str, str]:
    """Name in the file -> name in the output; CloudCompare's ``scalar_label`` counts as ``label``."""
    out: dict[str, str] = {}
    every = list(names)
    for name in every:
        out[name] = name
        while out[name].lower().removeprefix('scalar_') in added or (out[name] != name and out[name] in every):
            out[name] = GIVEN + out[name]
    return out


def _ply(source: Path, target: Path, columns: Arrays, added: Arrays) -> Path:
    names = _kept_names(columns, added)
    kept = {_word(names[name]): _ply_numbers(values) for name, values in columns.items()}
    return write_ply(target, kept | dict(added))


def _word(name: str) -> str:
    """A name that the header of PLY has room for."""
    return ''.join(letter if letter.isascii() and not letter.isspace() else '_' for letter in name)


def _ply_numbers(values: np.ndarray) -> np.ndarray:
    """The column in a type that PLY knows; 64-bit integers become 32-bit ones, or double where they are large."""
    if values.dtype.str[1:] in NAMES:
        return values
    if values.dtype.kind == 'f':
        return values.astype(np.float32 if values.dtype.itemsize < 4 else np.float64)
    small = values.astype(np.int32)
    return small if np.array_equal(small, values) else values.astype(np.float64)


def _npz(source: Path, target: Path, columns: Arrays, added: Arrays) -> Path:
    with np.load(source, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files if not name.startswith('__')}
    names = _kept_names(arrays, added)
    return write_npz(target, {names[name]: values for name, values in arrays.items()} | dict(added))


def _las(source: Path, target: Path, columns: Arrays, added: Arrays) -> Path:
    laspy = need_laspy(source)
    las = laspy.read(source)
    further = {}
    for name, kept in _kept_names(las.point_format.extra_dimension_names, added).items():
        if kept != name:
            further[kept] = np.asarray(las[name])
            las.remove_extra_dim(name)
    for name, values in {**further, **added}.items():
        las.add_extra_dim(laspy.ExtraBytesParams(name, values.dtype))
        las[name] = values
    return atomic_write(target, lambda file: las.write(file, do_compress=target.suffix.lower() == '.laz'))


_KEPT: dict[str, Callable[[Path, Path, Arrays, Arrays], Path]] = {
    '.las': _las,
    '.laz': _las,
    '.npz': _npz,
    '.ply': _ply,
}
