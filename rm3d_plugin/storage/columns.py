"""Any scan file as named columns, and which column plays which part."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from rm3d_plugin.storage.e57 import read_e57
from rm3d_plugin.storage.float_records import (
    RECORDS,
    USUAL,
    WIDER,
    check_sense,
    float_width,
    holds_colors,
    holds_doubles,
)
from rm3d_plugin.storage.las import read_las
from rm3d_plugin.storage.leica_text import PARTS as COLUMNS
from rm3d_plugin.storage.leica_text import read_pts, read_ptx
from rm3d_plugin.storage.npy import read_archive, read_npy
from rm3d_plugin.storage.pcd import read_pcd
from rm3d_plugin.storage.ply import read_ply
from rm3d_plugin.storage.signatures import check_signature
from rm3d_plugin.storage.text_columns import plain_name, read_text_table
from rm3d_plugin.structures import SceneError

RGB = ('red', 'green', 'blue')
NORMAL = ('nx', 'ny', 'nz')
ROLES = ('x', 'y', 'z', 'intensity', *RGB, *NORMAL, 'label', 'instance')
ALIASES = {
    'intensity': ('intensity', 'reflectance', 'remission', 'i'),
    'red': ('red', 'r', 'rf', 'diffuse_red'),
    'green': ('green', 'g', 'gf', 'diffuse_green'),
    'blue': ('blue', 'b', 'bf', 'diffuse_blue'),
    'nx': ('nx', 'normal_x'),
    'ny': ('ny', 'normal_y'),
    'nz': ('nz', 'normal_z'),
    'label': ('label', 'labels', 'class', 'classification', 'semantic', 'semantic_label', 'label_id'),
    'instance': ('instance', 'instances', 'instance_id', 'instance_label'),
}
"""Names under which a part is found; case, ``scalar_`` before a name and a unit ``[m]`` behind it do not matter."""
_ALIASED = {alias for found in ALIASES.values() for alias in found}
_BLOCKS = {name: tuple('xyz') for name in ('xyz', 'points', 'pos', 'coord', 'coords')}
_BLOCKS |= {name: RGB for name in ('colors', 'color', 'rgb')} | {name: NORMAL for name in ('normals', 'normal')}

OAKLAND = 'x y z label confidence'  # its native files, some of which have no header
ENDINGS = (
    '.bin', '.csv', '.e57', '.las', '.laz', '.npy', '.npz', '.pcd', '.ply', '.pts', '.ptx', '.txt', '.xyz',
    '.xyz_label_conf',
)  # fmt: skip
_SELF_NAMED = ('.e57', '.las', '.laz', '.pcd', '.ply', '.pts', '.ptx')
_NUMBERS = 'iufb'  # kinds of numpy
_LISTED = 12  # names in a message
_MANY = 100  # columns that are rather points

Columns = Mapping[str, int | str | None]
"""Part -> number or name of its column; None: the file's own column of that part is not read."""


def read_columns(path: str | Path, names: str | None = None) -> dict[str, np.ndarray]:
    """Every column of a scan, (N,) each, under its name.

    Names come from the file (properties, fields, dimensions, keys, a header line); a table without them has those of
    :data:`COLUMNS` where its width is one of these, else 0, 1, 2, ...

    Args:
        path: One of :data:`ENDINGS`.
        names: Names of a table's columns, split by blanks, - for one to pass over. '': as None, but what the columns
            seem to hold is not questioned, since the caller knows. Of no effect where the file has names.

    Raises:
        SceneError: The file is missing, damaged or of another kind; the message names it.
    """
    path = Path(path)
    readers = _readers()
    if path.suffix.lower() not in readers:
        raise SceneError(f'{path}: unknown ending {path.suffix!r}; expected one of {" ".join(ENDINGS)}')
    if not path.is_file():
        raise SceneError(f'{path}: {"is no file but a folder or a device" if path.exists() else "no such file"}')
    if names and path.suffix.lower() in _SELF_NAMED:
        warnings.warn(
            f'{path}: columns={names!r} is of no effect: the file has names of its own; to say which plays which part, '
            "columns=dict(label='NAME'), say",
            stacklevel=3,
        )
    try:
        check_signature(path)
        columns = readers[path.suffix.lower()](path, names)
    except SceneError:
        raise
    except OSError as error:
        raise SceneError(f'{path}: cannot be read ({error.strerror or error})') from error
    except Exception as error:  # a damaged file shows as anything from zlib.error to tokenize.TokenError
        reason = str(error).partition('. ')[0]  # what follows in numpy's message is advice to load unsafely
        raise SceneError(
            f'{path}: not readable as {path.suffix} ({type(error).__name__}: {reason}); copy or export it again'
        ) from error
    for name, values in columns.items():
        if values.dtype.kind not in _NUMBERS:
            raise SceneError(f'{path}: {name}: expected numbers, got {values.dtype}')
    return columns


def _readers() -> dict[str, Callable[[Path, str | None], dict[str, np.ndarray]]]:
    return {
        '.ply': lambda path, _: read_ply(path),
        '.pcd': lambda path, _: read_pcd(path),
        '.las': lambda path, _: read_las(path),
        '.laz': lambda path, _: read_las(path),
        '.e57': lambda path, _: read_e57(path),
        '.pts': lambda path, _: _colored(read_pts(path), path),
        '.ptx': lambda path, _: _colored(read_ptx(path), path),
        '.npy': _npy,
        '.npz': _npz,
        '.bin': _bin,
        '.txt': _text,
        '.xyz': _text,
        '.csv': _text,
        '.xyz_label_conf': lambda path, names: _text(path, names, OAKLAND),
    }


def find_roles(columns: Mapping[str, np.ndarray], given: Columns | None, path: Path) -> dict[str, np.ndarray]:
    """The columns by the part they play.

    Args:
        columns: From :func:`read_columns`.
        given: Parts that are told; the others are found by name (see :data:`ALIASES`).
        path: Of the file, for messages.

    Raises:
        SceneError: There is no such part or column, x, y or z is missing, or one colour (normal) is without the others.
    """
    order = list(columns)
    lower = {plain_name(name): name for name in reversed(order)}
    out: dict[str, np.ndarray] = {}
    for role in ROLES:
        if given is not None and role in given:
            name = _column_name(given[role], order, role, path)
        else:
            name = next((lower[alias] for alias in ALIASES.get(role, (role,)) if alias in lower), None)
        if name is not None:
            out[role] = columns[name]
    unknown = sorted(set(given or ()) - set(ROLES))
    if unknown:
        raise SceneError(f'columns: unknown part {unknown[0]!r}; expected some of {" ".join(ROLES)}')
    for parts in (tuple('xyz'), RGB, NORMAL):
        missing = [part for part in parts if part not in out]
        if missing and (parts[0] == 'x' or len(missing) < 3):
            raise SceneError(
                f'{path}: no column {missing[0]}, got {listed(order)}; '
                'name the columns: columns=dict(x=0, y=1, z=2), say'
            )
    return out


def warn_of_rivals(columns: Mapping[str, np.ndarray], given: Columns | None, path: Path) -> None:
    """A warning where two columns that group the points otherwise could be the label, and nobody said which.

    Paris-Lille-3D, say, has objects in ``label`` and classes in ``class``.
    """
    if (given is not None and 'label' in given) or path.suffix.lower() in ('.las', '.laz'):
        return  # LAS has room for a classification in any case; a label beside it was added on purpose
    lower = {plain_name(name): name for name in reversed(list(columns))}
    names = [lower[alias] for alias in ALIASES['label'] if alias in lower]
    rivals = [name for name in names[1:] if _group_otherwise(columns[names[0]], columns[name])]
    if rivals:
        warnings.warn(
            f'{path}: both {names[0]!r} and {rivals[0]!r} could be the label; {names[0]!r} is read: else say '
            f'columns=dict(label={rivals[0]!r})',
            stacklevel=3,
        )


def _group_otherwise(label: np.ndarray, other: np.ndarray) -> bool:
    """Whether another column has several values, and these are not the labels under other numbers."""
    (found, first), (values, second) = (np.unique(column, return_inverse=True) for column in (label, other))
    pairs = len(np.unique(first.reshape(-1) * len(values) + second.reshape(-1)))
    return len(values) > 1 and not pairs == len(found) == len(values)


def _column_name(wanted: int | str | None, order: list[str], role: str, path: Path) -> str | None:
    if isinstance(wanted, int) and 0 <= wanted < len(order):
        return order[wanted]
    if wanted is None or wanted in order:
        return wanted if wanted is None else str(wanted)
    raise SceneError(f'{path}: no column {wanted!r} for {role}; the file has {len(order)}: {listed(order)}')


def split_names(names: str) -> list[str]:
    """Names of a table's columns; checked, so that a slip is told before a file is read.

    Raises:
        SceneError: x, y or z is missing, a name is no part, or comes twice.
    """
    words = names.split()
    used = [word for word in words if word != '-']
    if not {*'xyz'} <= set(used) <= {*ROLES} or len(set(used)) != len(used) or len({*RGB} & set(used)) not in (0, 3):
        raise SceneError(
            f'columns: expected x y z, maybe {" ".join(ROLES[3:])}, each once, and - for others; got {names!r}'
        )
    return words


def listed(names: Sequence[str]) -> str:
    """The first names, and how many there are where these are not all."""
    return ' '.join(names) if len(names) <= _LISTED else f'{" ".join(names[:_LISTED])} ... ({len(names)} in all)'


def _named(table: np.ndarray, path: Path, names: str | None) -> dict[str, np.ndarray]:
    """A table's columns under the names told, or by their number."""
    if table.ndim != 2:
        raise SceneError(f'{path}: shape {table.shape}; expected one row a point')
    rows, width = table.shape
    if names is None and width >= _MANY and rows in COLUMNS:
        raise SceneError(f'{path}: shape {table.shape}; expected one row a point: save the transposed array (array.T)')
    if names is None:
        _tell_doubts(table, path)
    words = (names or COLUMNS.get(width) or ' '.join(map(str, range(width)))).split()
    if width != len(words):
        raise SceneError(f'{path}: shape {table.shape}; the columns named are {len(words)}: {listed(words)}')
    return {word: table[:, i] for i, word in enumerate(words) if word != '-'}


def _tell_doubts(table: np.ndarray, path: Path) -> None:
    """Where the numbers of a table without names look like something else than :data:`COLUMNS` says.

    Raises:
        SceneError: Six columns hold normals.
    """
    rows, width = table.shape
    if rows == 0 or width not in (6, 7) or not np.issubdtype(table.dtype, np.number):
        return
    last = table[:, 3:6].astype(np.float64)
    if (last.min() < 0 and np.abs(last).max() <= 1) or (rows > 2 and _are_normals(last)):
        raise SceneError(
            f"{path}: columns 4 to 6 look like normals; say so: columns='x y z nx ny nz{' -' * (width - 6)}'"
        )
    if width == 7 and last.min() >= 0 and last.max() <= 255 and not (last % 1).any():
        seventh = table[:, 6]
        what = 'alpha' if np.all(seventh == 255) else 'label' if not (seventh % 1).any() else 'intensity'
        reading = f'x y z red green blue {"-" if what == "alpha" else what}'
        warnings.warn(
            f'{path}: seven columns without names are ambiguous; read as {COLUMNS[7]!r}, but they look like x y z red '
            f'green blue {what}: if so, columns={reading!r}',
            stacklevel=5,
        )


def _colored(columns: dict[str, np.ndarray], path: Path) -> dict[str, np.ndarray]:
    """The columns of a format that knows no normals.

    Raises:
        SceneError: Its colours look like normals.
    """
    if len(columns) == 6:
        last = np.stack([columns[name] for name in RGB], axis=1)
        if (last.min() < 0 and np.abs(last).max() <= 1) or (len(last) > 2 and _are_normals(last)):
            raise SceneError(
                f'{path}: columns 4 to 6 look like normals, {path.suffix} has colours there; save it as .txt behind a '
                "line 'x y z nx ny nz'"
            )
    return columns


def _are_normals(vectors: np.ndarray) -> bool:
    return bool((np.abs(np.square(vectors).sum(axis=1) - 1) < 0.02).all() and (vectors % 1).any())


def _bin(path: Path, names: str | None) -> dict[str, np.ndarray]:
    data = path.read_bytes()
    names = names or _record(data, path)
    width = len(names.split())
    if len(data) % (4 * width):
        raise SceneError(f'{path}: {len(data)} bytes are no multiple of {4 * width} (float32 {names}); cut off?')
    return _named(np.frombuffer(data, dtype='<f4').reshape(-1, width), path, names)


def _record(data: bytes, path: Path) -> str:
    """What a point of raw float32 numbers seems to hold.

    Raises:
        SceneError: The numbers are float64, or absurd.
    """
    if holds_doubles(data):
        raise SceneError(f'{path}: looks like float64 numbers; expected float32: save .astype(float32), or a .npy file')
    check_sense(data, path)
    width = float_width(data, path.name)
    if width in WIDER:
        _tell_wide(width, path)
        width = USUAL
    names = RECORDS[width]
    if width == 6 and holds_colors(np.frombuffer(data, dtype='<f4').reshape(-1, 6)):
        names = COLUMNS[6]
    if width != USUAL:
        warnings.warn(
            f'{path}: read as {width} float32 a point ({names}), as its name or its numbers suggest; else say columns=',
            stacklevel=5,
        )
    return names


def _tell_wide(width: int, path: Path) -> None:
    """A file of more numbers a point than any known kind has; points in a pattern look like 8 as well as 4.

    Raises:
        SceneError: It cannot be one of the usual 4.
    """
    read = 'expected' if width % USUAL else 'read as'
    told = (
        f'{path}: looks like {width} float32 a point; {read} {USUAL} ({RECORDS[USUAL]}); if it is so, name them: '
        f"columns='x y z intensity{' -' * (width - USUAL)}', - for what is passed over"
    )
    if width % USUAL:
        raise SceneError(told)
    warnings.warn(told, stacklevel=6)


def _npy(path: Path, names: str | None) -> dict[str, np.ndarray]:
    table = read_npy(path)
    if table.dtype.names:
        return _by_name({name: table[name] for name in table.dtype.names}, path, names)
    return _named(table, path, names)


def _npz(path: Path, names: str | None) -> dict[str, np.ndarray]:
    arrays = read_archive(path)
    return _moved(_by_name(arrays, path, names), arrays.get('origin'), path)


def _by_name(arrays: Mapping[str, np.ndarray], path: Path, names: str | None) -> dict[str, np.ndarray]:
    """Columns of named arrays of one or more numbers a point."""
    lower = {name.lower(): name for name in reversed(list(arrays))}
    first = next((lower[name] for name in ('xyz', 'points', 'pos', 'coord', 'coords', 'x') if name in lower), None)
    if first is None:
        raise SceneError(
            f'{path}: holds {listed(sorted(arrays))}; expected xyz (N, 3), points (N, 3 or more), or x, y, z'
        )
    rows = arrays[first].shape[:1]
    out: dict[str, dict[str, np.ndarray]] = {}
    for name in sorted(arrays, key=lambda name: name == first):  # what has a name of its own goes before
        values = arrays[name]
        known = name.lower() in _BLOCKS or name.lower() in _ALIASED
        if values.shape[:1] != rows or values.ndim not in (1, 2):
            if known:
                raise SceneError(f'{path}: {name}: shape {values.shape}, but {first} has shape {arrays[first].shape}')
            continue  # what is not about points: a transform, a name, an origin
        if not known and values.dtype.kind not in _NUMBERS:
            continue  # names, times
        wide = name == first and values.ndim == 2 and values.shape[1] not in (1, 3)
        parts = _named(values, path, names) if wide else _parts_of(name, values, path)
        if twice := sorted(parts.keys() & {part for others in out.values() for part in others}):
            warnings.warn(f'{path}: {", ".join(twice)} of {name} passed over: another array has it, too', stacklevel=5)
        out[name] = {part: column for part, column in parts.items() if part not in twice}
    return {part: column for name in arrays for part, column in out.get(name, {}).items()}  # as they stand in the file


def _parts_of(name: str, values: np.ndarray, path: Path) -> dict[str, np.ndarray]:
    """The columns of one array; alpha behind red, green and blue is passed over."""
    block, width = _BLOCKS.get(name.lower(), ()), 1 if values.ndim == 1 else values.shape[1]
    if width == 1:
        return {name: values.reshape(-1)}
    if width == len(block) or (block == RGB and width == len(RGB) + 1):
        return {part: values[:, i] for i, part in enumerate(block)}
    if block or name.lower() in _ALIASED:
        warnings.warn(
            f'{path}: {name} has shape {values.shape}, expected {len(block) or 1} a point: read as {name}_0 and so on',
            stacklevel=6,
        )
    return {f'{name}_{i}': values[:, i] for i in range(width)}


def _moved(columns: dict[str, np.ndarray], origin: np.ndarray | None, path: Path) -> dict[str, np.ndarray]:
    """World coordinates where an archive holds local ones and their origin, as our own predictions do."""
    if origin is None or not {'x', 'y', 'z'} <= columns.keys():
        return columns
    if origin.shape != (3,) or not np.issubdtype(origin.dtype, np.number) or not np.isfinite(origin).all():
        raise SceneError(f'{path}: origin: expected three finite numbers, got shape {origin.shape} of {origin.dtype}')
    if not origin.any():
        return columns
    return columns | {axis: columns[axis].astype(np.float64) + origin[i] for i, axis in enumerate('xyz')}


def _text(path: Path, names: str | None, usual: str | None = None) -> dict[str, np.ndarray]:
    found, table = read_text_table(path)
    if not names and found:
        return {name: table[:, i] for i, name in enumerate(found) if name}
    return _named(table, path, usual if names is None else names)
