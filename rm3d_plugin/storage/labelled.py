"""A scan with a label for each point, in the format of its file and with the fields that it had."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from rm3d_plugin.storage.exports import need_laspy
from rm3d_plugin.storage.files import atomic_write, write_npz
from rm3d_plugin.storage.kept_columns import GIVEN, Arrays, kept_names, plain_numbers
from rm3d_plugin.storage.ply import write_ply


def labelled_ending(source: Path) -> str:
    """Ending of what :func:`write_labelled` writes for a scan: its own for LAS, LAZ, npz and PLY, else ``.ply``."""
    ending = source.suffix.lower()
    return ending if ending in _KEPT else '.ply'


def write_labelled(source: Path, target: Path, columns: Arrays, added: Arrays) -> Path:
    """Write a scan again with further fields, atomically; a field of the same name is kept as ``input_NAME``.

    Args:
        source: The scan.
        target: PLY; or LAS or LAZ, where the source is LAS or LAZ; or npz, where it is npz.
        columns: Of the scan, from :func:`rm3d_plugin.storage.columns.read_columns`.
        added: (N,) numbers of 32 bits, by name. In LAS and LAZ, ``classification`` among them takes the place of the
            file's own.

    Raises:
        SceneError: LAS needs a package that is not installed.
    """
    return _KEPT[target.suffix.lower()](source, target, columns, added)


def _ply(source: Path, target: Path, columns: Arrays, added: Arrays) -> Path:
    names = kept_names(columns, added)
    kept = {_word(names[name]): plain_numbers(values) for name, values in columns.items()}
    return write_ply(target, kept | dict(added))


def _word(name: str) -> str:
    """A name that the header of PLY has room for."""
    return ''.join(letter if letter.isascii() and not letter.isspace() else '_' for letter in name)


def _npz(source: Path, target: Path, columns: Arrays, added: Arrays) -> Path:
    with np.load(source, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files if not name.startswith('__')}
    names = kept_names(arrays, added)
    return write_npz(target, {names[name]: values for name, values in arrays.items()} | dict(added))


def _las(source: Path, target: Path, columns: Arrays, added: Arrays) -> Path:
    laspy = need_laspy(source)
    las = laspy.read(source)
    standard = {str(name) for name in las.point_format.standard_dimension_names} & set(added)
    further = {GIVEN + name: np.array(las[name]) for name in standard}
    for name in standard:
        las[name] = added[name]
    for name, kept in kept_names(las.point_format.extra_dimension_names, added).items():
        if kept != name:
            further[kept] = np.asarray(las[name])
            las.remove_extra_dim(name)
    new = {name: values for name, values in added.items() if name not in standard}
    for name, values in {**further, **new}.items():
        las.add_extra_dim(laspy.ExtraBytesParams(name, values.dtype))
        las[name] = values
    return atomic_write(target, lambda file: las.write(file, do_compress=target.suffix.lower() == '.laz'))


_KEPT: dict[str, Callable[[Path, Path, Arrays, Arrays], Path]] = {
    '.las': _las,
    '.laz': _las,
    '.npz': _npz,
    '.ply': _ply,
}
