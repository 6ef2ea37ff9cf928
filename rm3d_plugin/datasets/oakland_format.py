"""Oakland's text files: ``x y z label confidence`` a line, behind a header that names the ids."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.storage.plain_files import read_text
from rm3d_plugin.storage.scans import has_place
from rm3d_plugin.storage.signatures import check_signature
from rm3d_plugin.storage.text_columns import plain_text
from rm3d_plugin.storage.text_table import BadTextError, parse_table
from rm3d_plugin.structures import UNLABELLED, SceneError

# The merge into six classes; ids of neither are ignored.
MERGE: dict[str, tuple[int, ...]] = {
    'vegetation': (1300, 1302, 1304, 1305, 1306),
    'wire': (1101, 1102, 1105),
    'pole': (1103, 1104, 1107, 1110, 1112, 1303),  # trunks, too
    'ground': (1200, 1202, 1203, 1205, 1206, 1301),
    'facade': (1400, 1401, 1411, 1412),
    'vehicle': (1501,),
}
CLASSES = tuple(MERGE)
# Every id that a header names (tiles differ in which of them they list), and 9999, which five points of part3_ak have.
IDS = {*range(1000, 1006), *range(1100, 1120), *range(1200, 1208), *range(1300, 1307), *range(1400, 1414), 1500, 1501,
       1600, 1601, 9999}  # fmt: skip
COLUMNS = ('x', 'y', 'z', 'label', 'confidence')


class Tile(NamedTuple):
    """A file.

    Attributes:
        xyz: (N, 3) float64 metres, z up.
        label: (N,) int64 ids as in the file.
        names: Id -> name, of the header; empty where there is none.
    """

    xyz: Float[np.ndarray, 'points 3']
    label: Int[np.ndarray, ' points']
    names: dict[int, str]


def read_tile(path: str | Path) -> Tile:
    """Read one tile.

    Raises:
        SceneError: The file is missing or empty, a line is cut off or no numbers, a number is NaN, or the tile lies on
            its side.
    """
    path = Path(path)
    if not path.is_file():
        raise SceneError(f'{path}: no such file; expected a tile of Oakland')
    check_signature(path)
    try:
        table = parse_table(plain_text(path.read_bytes()), len(COLUMNS))
    except BadTextError as error:
        raise SceneError(f'{path}, {error}; expected {" ".join(COLUMNS)}. Cut off? copy it again') from None
    if table.size == 0:
        raise SceneError(f'{path}: holds no points')
    bad = int((~(np.isfinite(table).all(axis=1) & has_place(table[:, :3]))).sum())
    if bad:
        raise SceneError(f'{path}: {bad} of {len(table)} lines hold NaN or infinite numbers; drop them first')
    if (parts := table[table[:, 3] % 1 != 0, 3]).size:
        raise SceneError(f'{path}: label: expected whole numbers, got {parts[0]:g}; copy the file again')
    label = table[:, 3].astype(np.int64)
    check_up(table[:, :3], label, path)
    return Tile(np.ascontiguousarray(table[:, :3]), label, read_names(path))


def read_names(path: str | Path) -> dict[int, str]:
    """Id -> name of a tile's header, lines ``# 1103 -- utility_pole``."""
    names: dict[int, str] = {}
    for line in read_text(Path(path), strict=False).split('\n'):
        if not line.startswith('#'):
            break
        words = [word.strip() for word in line[1:].split('--')]
        if len(words) >= 2 and words[0].isdigit():
            names[int(words[0])] = words[1]
    return names


def merge_ids(label: Int[np.ndarray, ' points'], where: str | Path) -> Int[np.ndarray, ' points']:
    """Class 0 .. 5 of each id, -1 for ids that the merge ignores.

    Args:
        label: Ids.
        where: Named in the error.

    Raises:
        SceneError: Ids that Oakland does not have, listed with their counts.
    """
    ids, inverse, count = np.unique(label, return_inverse=True, return_counts=True)
    strange = [f'{i} ({n} points)' for i, n in zip(ids.tolist(), count.tolist(), strict=True) if i not in IDS]
    if strange:
        raise SceneError(f'{where}: label ids that Oakland does not have: {", ".join(strange)}; another format?')
    classes = {number: row for row, numbers in enumerate(MERGE.values()) for number in numbers}
    merged = np.array([classes.get(i, UNLABELLED) for i in ids.tolist()], dtype=np.int64)
    return merged[inverse.reshape(-1)]


def check_up(xyz: Float[np.ndarray, 'points 3'], label: Int[np.ndarray, ' points'], where: str | Path) -> None:
    """Raise where the ground is not flattest along z: the columns are swapped, or another axis points up.

    Raises:
        SceneError: Names the axis that looks like up.
    """
    ground = xyz[np.isin(label, MERGE['ground'])]
    if len(ground) < 100:
        return
    spread = ground.std(axis=0)
    if spread[2] > spread[:2].min():
        flat = 'xyz'[int(spread.argmin())]
        raise SceneError(
            f'{where}: the ground spreads {spread[2]:.1f} m along z, {spread.min():.1f} m along {flat}; expected z up'
        )
