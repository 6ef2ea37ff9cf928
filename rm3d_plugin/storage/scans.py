"""Anybody's scans: points, colours, intensity and labels from the usual file formats."""

import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.storage.columns import NORMAL, RGB, Columns, find_roles, read_columns, split_names, warn_of_rivals
from rm3d_plugin.storage.coordinates import warn_of_units
from rm3d_plugin.storage.leica_text import ptx_sensor
from rm3d_plugin.storage.pcd import read_pcd_header
from rm3d_plugin.structures import UNLABELLED, PointCloud, SceneError

FAR = 1e3  # m; beyond, float32 is coarser than 0.1 mm and coordinates move to a local frame
NanPoints = Literal['error', 'drop']
ColorRange = Literal['auto'] | float
COLOR_RANGES = ('auto', 1, 255, 65535)
Float3 = tuple[float, float, float]
GREATEST = 3.2e38  # m; float32 has no room for more
RAW_LIMIT = 2**53  # labels travel through float64 in text
LARGEST, ALL_BITS = 2**63 - 1, 2**64 - 1


class Scan(NamedTuple):
    """A scan file.

    Attributes:
        cloud: Its points.
        label: (N,) int64 raw label of each point, as in the file, or None.
        instance: (N,) int64 raw instance number, as in the file, or None.
    """

    cloud: PointCloud
    label: Int[np.ndarray, ' points'] | None = None
    instance: Int[np.ndarray, ' points'] | None = None

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Plain arrays by name; what is None is left out."""
        cloud = {
            name: getattr(self.cloud, name) for name in ('xyz', 'origin', 'colors', 'intensity', 'normals', 'sensor')
        }
        arrays = cloud | {'label': self.label, 'instance': self.instance}
        return {name: np.asarray(values) for name, values in arrays.items() if values is not None}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> 'Scan':
        """Undo :meth:`to_arrays`."""
        cloud: dict[str, Any] = {name: arrays[name] for name in arrays if name not in ('label', 'instance')}
        return cls(PointCloud(**cloud), arrays.get('label'), arrays.get('instance'))


def read_cloud(path: str | Path, columns: str | Columns | None = None) -> PointCloud:
    """The points of a scan, see :func:`read_scan`."""
    return read_scan(path, columns).cloud


def read_scan(
    path: str | Path,
    columns: str | Columns | None = None,
    color_range: ColorRange = 'auto',
    labels: bool = False,
    nan_points: NanPoints = 'error',
) -> Scan:
    """Read a scan; its kind is told from the ending.

    - ``.ply``, ``.pcd``, ``.las``, ``.laz``: columns are found by name. LAS needs the extra ``las``.
    - ``.pts``, ``.ptx``, ``.e57``: all scans of the file together. E57 needs the extra ``e57``.
    - ``.bin``: float32 x, y, z, intensity, as KITTI; the sensor is the origin.
    - ``.npy``, ``.txt``, ``.xyz``, ``.csv``: columns by name where there is a header (or a structured array), else
      rows of 3, 4, 6 or 7 columns: x y z [intensity] [red green blue].
    - ``.npz``: ``xyz`` (or ``points`` with such columns), and where present ``colors``, ``intensity``, ``normals``,
      ``label``, ``instance``; and ``origin`` (3,), which is added to the coordinates.

    Large coordinates move to a local frame, see :meth:`rm3d_plugin.structures.PointCloud.from_world`.

    Args:
        path: The file.
        columns: What the columns hold, where it is not as above. Text: names of a table's columns out of x y z
            intensity red green blue nx ny nz label instance, and - for a column to pass over; ``'x y z red green blue
            -'``, say. A mapping: part -> number or name of its column, ``dict(x=0, y=1, z=2, label=6)``; in a file
            with names the parts not mentioned are still found by name.
        color_range: Value of the brightest colour: 1, 255 or 65535. 'auto': 255 for whole numbers up to there and for
            numbers above 1, 65535 above 255, else 1.
        labels: Read ``label`` and ``instance``, too, where the file has them; NaN = not labelled = -1.
        nan_points: What becomes of points without a finite place, as organised PCD has them: an error, or they are
            dropped with a warning that counts them.

    Raises:
        SceneError: The file is missing, empty, damaged or of another kind; the message names it.
    """
    path = Path(path)
    if color_range not in COLOR_RANGES:
        raise ValueError(f'color_range: expected one of {COLOR_RANGES}, got {color_range!r}')
    names = columns if isinstance(columns, str) or columns is None else ''
    if names:
        split_names(names)
    given = None if columns is None or isinstance(columns, str) else columns
    return scan_of_columns(read_columns(path, names), path, given, color_range, labels, nan_points)


def scan_of_columns(
    columns: Mapping[str, np.ndarray],
    path: Path,
    given: Columns | None = None,
    color_range: ColorRange = 'auto',
    labels: bool = False,
    nan_points: NanPoints = 'error',
) -> Scan:
    """:func:`read_scan` where the columns of the file are read already.

    Args:
        columns: From :func:`rm3d_plugin.storage.columns.read_columns`.
        path: Of the file, for messages.
        given: Parts of the columns that are told; the others are found by name.
        color_range: See :func:`read_scan`.
        labels: See :func:`read_scan`.
        nan_points: See :func:`read_scan`.

    Raises:
        SceneError: A column cannot be used.

    Warns:
        UserWarning: An intensity, colour or normal is NaN or infinite and counts as 0; coordinates are odd, see
            :func:`rm3d_plugin.storage.coordinates.warn_of_units`.
    """
    parts = find_roles(columns, given, path)
    xyz = np.stack([parts[name] for name in 'xyz'], axis=1)
    if len(xyz) == 0:
        raise SceneError(f'{path}: holds no points')
    finite = has_place(xyz)
    if not finite.all():
        _check_nan_points(path, finite, nan_points)
        xyz, parts = xyz[finite], {name: values[finite] for name, values in parts.items()}
    sensor_at_zero = path.suffix.lower() == '.bin'
    if not sensor_at_zero:
        warn_of_units(xyz, path)
    cloud = _cloud(xyz, _channels(parts, color_range, path), not sensor_at_zero, _sensor(path))
    if labels:
        warn_of_rivals(columns, given, path)
    read = {name: _whole(path, name, parts[name]) for name in ('label', 'instance') if labels and name in parts}
    return Scan(cloud, **read)


def rows_with_place(columns: Mapping[str, np.ndarray], given: Columns | None, path: Path) -> Bool[np.ndarray, ' rows']:
    """Which rows :func:`scan_of_columns` keeps with ``nan_points='drop'``."""
    parts = find_roles(columns, given, path)
    return has_place(np.stack([parts[name] for name in 'xyz'], axis=1))


def has_place(xyz: np.ndarray) -> Bool[np.ndarray, ' rows']:
    """Which rows are finite, and not too large for float32."""
    greatest = min(GREATEST, float(np.finfo(xyz.dtype).max)) if xyz.dtype.kind == 'f' else GREATEST
    finite: Bool[np.ndarray, ' rows'] = (np.abs(xyz) <= greatest).all(axis=1)  # NaN compares as False
    return finite


def _channels(parts: Mapping[str, np.ndarray], color_range: ColorRange, path: Path) -> dict[str, np.ndarray]:
    """Intensity, colours and normals of a scan; what is missing throughout is left out."""
    channels = {}
    for channel, names in (('intensity', ('intensity',)), ('colors', RGB), ('normals', NORMAL)):
        if names[0] in parts and not all(_all_nan(parts[name]) for name in names):
            channels[channel] = _zeroed(path, channel, np.stack([parts[name] for name in names], axis=1))
    if 'intensity' in channels:
        channels['intensity'] = channels['intensity'][:, 0].astype(np.float32)
    if 'colors' in channels:
        channels['colors'] = unit_colors(channels['colors'], color_range, path)
    if 'normals' in channels:
        channels['normals'] = _unit_normals(channels['normals'])
        if not channels['normals'].any():  # room for normals, but nobody computed them
            del channels['normals']
    return channels


def _unit_normals(normals: np.ndarray) -> Float[np.ndarray, 'points 3']:
    """Normals of length 1; zeros stay."""
    vectors = normals.astype(np.float64)
    vectors /= np.maximum(np.abs(vectors).max(axis=1, keepdims=True), np.finfo(np.float64).tiny)
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    unit: np.ndarray = vectors / np.where(length > 0, length, 1.0)
    return unit.astype(np.float32)


def _cloud(xyz: np.ndarray, channels: dict[str, Any], may_move: bool, sensor: Float3 | None) -> PointCloud:
    world = xyz.astype(np.float64)
    if not may_move or np.abs(world).max(initial=0.0) <= FAR:
        return PointCloud(xyz.astype(np.float32), **channels, sensor=sensor)
    cloud = PointCloud.from_world(world, **channels)
    return cloud if sensor is None else replace(cloud, sensor=np.asarray(sensor) - cloud.origin)


def _sensor(path: Path) -> Float3 | None:
    """Where the sensor stood, in the frame of the file: the origin in ``.bin``, else what a PCD or PTX says."""
    if path.suffix.lower() == '.bin':
        return 0.0, 0.0, 0.0
    if path.suffix.lower() == '.ptx':
        return ptx_sensor(path)
    return read_pcd_header(path).sensor if path.suffix.lower() == '.pcd' else None


def unit_colors(colors: np.ndarray, color_range: ColorRange, path: Path) -> Float[np.ndarray, 'points 3']:
    """Colours in [0, 1], float32; see :func:`read_scan` for ``color_range``.

    Raises:
        SceneError: A colour is negative, or above the range.
    """
    most = float(colors.max()) if colors.size else 0.0
    if color_range == 'auto':
        fractions = np.issubdtype(colors.dtype, np.floating) and most <= 1
        color_range = 1.0 if fractions else 255.0 if most <= 255 else 65535.0
    if most > color_range or (colors.size and colors.min() < 0):
        raise SceneError(
            f'{path}: colors: expected 0 to {color_range:g}, got {colors.min():g} to {most:g}; pass color_range'
        )
    return (colors / color_range).astype(np.float32)


def map_labels(
    raw: Int[np.ndarray, ' points'],
    num_classes: int,
    label_map: Mapping[int, int] | None,
    path: Path,
    others: Literal['error', 'ignore'] = 'error',
) -> Int[np.ndarray, ' points']:
    """Class numbers of raw labels.

    Args:
        raw: Labels as in the file.
        num_classes: Classes are 0 to ``num_classes`` - 1.
        label_map: Raw label -> class, -1 = ignored; None: raw labels are class numbers. A raw -1 that is not listed is
            ignored: so points without a label are read.
        path: Of the file, for messages.
        others: What becomes of labels that the map does not list: an error, or -1.

    Raises:
        SceneError: A label is out of range, or not in the map.
    """
    found, inverse = np.unique(raw, return_inverse=True)
    table = dict(label_map) if label_map is not None else {number: number for number in range(num_classes)}
    table.setdefault(UNLABELLED, UNLABELLED)
    missing = [value for value in found.tolist() if value not in table]
    if missing and others == 'error':
        expected = f'{UNLABELLED} to {num_classes - 1}' if label_map is None else f'one of {sorted(label_map)}'
        raise SceneError(
            f'{path}: label: expected {expected}, got {missing[0]}; map it (label_map={{{missing[0]}: CLASS}}, '
            "-1 ignores) or pass other_labels='ignore'"
        )
    mapped = np.array([table.get(value, UNLABELLED) for value in found.tolist()], dtype=np.int64)
    return mapped[inverse.reshape(-1)]


def _all_nan(values: np.ndarray) -> bool:
    return bool(np.issubdtype(values.dtype, np.floating) and np.isnan(values).all())


def _zeroed(path: Path, name: str, values: np.ndarray) -> np.ndarray:
    """The channel, 0 where a point's number is NaN or infinite."""
    good = np.isfinite(values).all(axis=1)
    if good.all():
        return values
    warnings.warn(
        f'{path}: {name}: {int((~good).sum())} of {len(values)} points are NaN or infinite; they count as 0',
        stacklevel=5,
    )
    return np.where(good[:, None], values, 0)


def _check_nan_points(path: Path, finite: np.ndarray, nan_points: NanPoints) -> None:
    told = f'{path}: x, y, z: {int((~finite).sum())} of {len(finite)} points are NaN or infinite'
    if nan_points == 'error' or not finite.any():
        raise SceneError(f"{told}; drop them first, or on reading (nan_points='drop', predict --drop-nan)")
    warnings.warn(f'{told}; they are dropped', stacklevel=4)


def _whole(path: Path, name: str, values: np.ndarray) -> Int[np.ndarray, ' points']:
    """Whole numbers, -1 where nothing was said (NaN)."""
    if np.issubdtype(values.dtype, np.floating):
        values = np.where(np.isnan(values), UNLABELLED, values)
        wrong = ~(np.abs(values) < RAW_LIMIT) | (np.floor(values) != values)
        if wrong.any():
            limit = '' if np.abs(values[wrong][0]) < RAW_LIMIT else f' below {RAW_LIMIT}'
            raise SceneError(f'{path}: {name}: expected whole numbers{limit}, got {values[wrong][0]:.17g}')
    if values.dtype == np.uint64 and ((values > LARGEST) & (values < ALL_BITS)).any():  # all bits: -1 of other programs
        raise SceneError(f'{path}: {name}: expected numbers up to {LARGEST}, got {values[values < ALL_BITS].max()}')
    return values.astype(np.int64)
