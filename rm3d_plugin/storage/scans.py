"""Anybody's scans: points, colours and intensity from the usual file formats."""

import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float

from rm3d_plugin.storage.ply import read_ply
from rm3d_plugin.structures import PointCloud, SceneError

COLUMNS = {
    3: 'x y z',
    4: 'x y z intensity',
    6: 'x y z red green blue',
    7: 'x y z intensity red green blue',
}
RGB = ('red', 'green', 'blue')
FAR = 1e3  # m; beyond, float32 is coarser than 0.1 mm and coordinates move to a local frame


def read_cloud(path: str | Path, columns: str | None = None) -> PointCloud:
    """Read a scan; its kind is told from the ending.

    - ``.bin``: float32 x, y, z, intensity, as KITTI; the sensor is the origin.
    - ``.npy``, ``.txt``, ``.xyz``, ``.csv``: rows of 3, 4, 6 or 7 columns: x y z [intensity] [red green blue].
    - ``.npz``: ``xyz`` (or ``points`` with such columns), and where present ``colors``, ``intensity``, ``normals``.
    - ``.ply``: x, y, z, and where present red, green, blue, intensity, nx, ny, nz.

    Colours from 0 to 255 are scaled to 0 to 1. Large coordinates move to a local frame, see
    :meth:`rm3d_plugin.structures.PointCloud.from_world`.

    Args:
        path: The file.
        columns: What the columns of a table hold, where it is not as above: names out of x y z intensity red green
            blue, and - for a column to pass over; ``'x y z red green blue -'``, say. Of no effect on ``.ply``.

    Raises:
        SceneError: The file is missing, empty, damaged or of another kind; the message names it.
    """
    path = Path(path)
    if columns is not None:
        _check_columns(columns.split())
    readers: dict[str, Callable[[Path, str | None], dict[str, np.ndarray]]]
    readers = {'.bin': _bin, '.npy': _npy, '.npz': _npz, '.txt': _text, '.xyz': _text, '.csv': _text, '.ply': _ply}
    if path.suffix.lower() not in readers:
        raise SceneError(f'{path}: unknown ending {path.suffix!r}; expected one of {" ".join(sorted(readers))}')
    if not path.is_file():
        raise SceneError(f'{path}: no such file')
    arrays = readers[path.suffix.lower()](path, columns)
    xyz = np.asarray(arrays.pop('xyz'))
    if xyz.ndim != 2 or xyz.shape[1] != 3 or not np.issubdtype(xyz.dtype, np.number):
        raise SceneError(f'{path}: xyz: expected numbers of shape (N, 3), got {xyz.dtype} {xyz.shape}')
    if len(xyz) == 0:
        raise SceneError(f'{path}: holds no points')
    bad = int((~np.isfinite(xyz).all(axis=1)).sum())
    if bad:
        raise SceneError(f'{path}: {bad} of {len(xyz)} points are NaN or infinite; drop them first')
    channels = {name: _channel(path, name, values, len(xyz)) for name, values in arrays.items()}
    if path.suffix.lower() == '.bin':
        return PointCloud(xyz, **channels, sensor=(0.0, 0.0, 0.0))
    return PointCloud.from_world(xyz, **channels) if np.abs(xyz).max() > FAR else PointCloud(xyz, **channels)


def _channel(path: Path, name: str, values: np.ndarray, rows: int) -> Float[np.ndarray, 'points ...']:
    """What comes beside the coordinates, as float32."""
    shape = (rows,) if name == 'intensity' else (rows, 3)
    if values.shape != shape or not np.issubdtype(values.dtype, np.number):
        raise SceneError(f'{path}: {name}: expected numbers of shape {shape}, got {values.dtype} {values.shape}')
    return (_unit_colors(values) if name == 'colors' else values).astype(np.float32)


def _unit_colors(colors: np.ndarray) -> Float[np.ndarray, 'points 3']:
    """Colours in [0, 1]: whole numbers, and numbers above 1, count to 255 (to 65535 above that)."""
    values = np.asarray(colors, dtype=np.float64)
    if np.issubdtype(np.asarray(colors).dtype, np.floating) and (values.size == 0 or values.max() <= 1.0):
        return values
    return values / (65535.0 if values.size and values.max() > 255 else 255.0)


def _check_columns(names: list[str]) -> None:
    known = {*'xyz', 'intensity', *RGB}
    used = [name for name in names if name != '-']
    if not {*'xyz'} <= set(used) <= known or len(set(used)) != len(used) or len({*RGB} & set(used)) not in (0, 3):
        raise SceneError(
            f'columns: expected x y z, maybe intensity, maybe red green blue, each once, and - for others; '
            f'got {" ".join(names)!r}'
        )


def _columns(table: np.ndarray, path: Path, columns: str | None) -> dict[str, np.ndarray]:
    """The parts of a table whose columns are named, or told by their number."""
    if columns is None and (table.ndim != 2 or table.shape[1] not in COLUMNS):
        choices = ', or of '.join(COLUMNS.values())
        raise SceneError(f'{path}: shape {table.shape}; expected rows of {choices}, or name the columns')
    names = (columns or COLUMNS[table.shape[1]]).split()
    if table.ndim != 2 or table.shape[1] != len(names):
        raise SceneError(f'{path}: shape {table.shape}; the columns named are {len(names)}: {" ".join(names)}')
    out = {'xyz': table[:, [names.index(name) for name in 'xyz']]}
    if 'intensity' in names:
        out['intensity'] = table[:, names.index('intensity')]
    if 'red' in names:
        out['colors'] = table[:, [names.index(name) for name in RGB]]
    return out


def _bin(path: Path, columns: str | None) -> dict[str, np.ndarray]:
    data = path.read_bytes()
    width = 4 if columns is None else len(columns.split())
    if len(data) % (4 * width):
        expected = columns or COLUMNS[4]
        raise SceneError(f'{path}: {len(data)} bytes are no multiple of {4 * width} (float32 {expected}); cut off?')
    return _columns(np.frombuffer(data, dtype='<f4').reshape(-1, width), path, columns)


def _npy(path: Path, columns: str | None) -> dict[str, np.ndarray]:
    try:
        table = np.load(path, allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise SceneError(f'{path}: not readable as .npy: {error}') from error
    if not isinstance(table, np.ndarray):
        raise SceneError(f'{path}: holds an archive, not one array; name it .npz')
    return _columns(table, path, columns)


def _npz(path: Path, columns: str | None) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (ValueError, EOFError, OSError, zipfile.BadZipFile) as error:
        raise SceneError(f'{path}: not readable as .npz: {error}') from error
    if 'xyz' not in arrays and 'points' in arrays:
        arrays = _columns(arrays['points'], path, columns) | arrays
    if 'xyz' not in arrays:
        raise SceneError(f'{path}: holds {sorted(arrays)}; expected xyz (N, 3) or points (N, 3 or more)')
    return {name: arrays[name] for name in ('xyz', 'colors', 'intensity', 'normals') if name in arrays}


def _text(path: Path, columns: str | None) -> dict[str, np.ndarray]:
    text = path.read_text(encoding='utf-8', errors='replace').replace(',', ' ').replace(';', ' ')
    rows = [line.split() for line in text.splitlines() if line.strip() and not line.lstrip().startswith(('#', '//'))]
    if not rows:
        raise SceneError(f'{path}: holds no points')
    uneven = [i for i, row in enumerate(rows) if len(row) != len(rows[0])]
    if uneven:
        raise SceneError(f'{path}: point {uneven[0]} has {len(rows[uneven[0]])} numbers, the first has {len(rows[0])}')
    try:
        table = np.array(rows, dtype=np.float64)
    except ValueError as error:
        raise SceneError(f'{path}: {error}; expected numbers, one point a line') from error
    return _columns(table, path, columns)


def _ply(path: Path, _: str | None) -> dict[str, np.ndarray]:
    vertex = read_ply(path)
    if missing := [name for name in 'xyz' if name not in vertex]:
        raise SceneError(f'{path}: vertices have no {missing}, got {sorted(vertex)}')
    out = {'xyz': np.stack([vertex[name] for name in 'xyz'], axis=1)}
    if all(name in vertex for name in RGB):
        out['colors'] = np.stack([vertex[name] for name in RGB], axis=1)
    if all(name in vertex for name in ('nx', 'ny', 'nz')):
        out['normals'] = np.stack([vertex[name] for name in ('nx', 'ny', 'nz')], axis=1)
    for name in ('intensity', 'scalar_intensity', 'scalar_Intensity'):
        if name in vertex:
            out['intensity'] = vertex[name]
    return out
