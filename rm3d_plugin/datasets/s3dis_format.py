"""S3DIS' text files: one object a file, named after its class; also those that the release has wrong."""

import re
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from rm3d_plugin.storage.plain_files import files_ending
from rm3d_plugin.storage.scans import has_place
from rm3d_plugin.storage.signatures import check_signature
from rm3d_plugin.storage.text_columns import plain_text
from rm3d_plugin.storage.text_table import BadTextError, parse_table
from rm3d_plugin.structures import SceneError

CLASSES = (
    'ceiling',
    'floor',
    'wall',
    'beam',
    'column',
    'window',
    'door',
    'table',
    'chair',
    'sofa',
    'bookcase',
    'board',
    'clutter',
)
SYNONYMS = {'stairs': 'clutter'}
AREAS = (1, 2, 3, 4, 5, 6)
COLUMNS = ('x', 'y', 'z', 'red', 'green', 'blue')
FAR = 1e3  # m; nearer, float32 keeps 0.1 mm
MOST_REPAIRS = 20  # of one file; with more, the file is broken and not merely smudged
_NAME = re.compile(r'(?P<name>[A-Za-z]+)_(?P<number>\d+)(?P<copy> ?\(\d+\))?')
_STRAY = re.compile(rb'[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\xff]')


class ObjectFile(NamedTuple):
    """A file of ``Annotations``: which class it holds, by name."""

    path: Path
    name: str


class Room(NamedTuple):
    """All points of a room, in types that take little room on disk.

    Attributes:
        xyz: (N, 3) metres, z up; float32, or float64 where coordinates are large.
        colors: (N, 3) from 0 to 255; uint8 where they are whole numbers.
        semantic: (N,) uint8 class number.
        instance: (N,) int32 number of the object's file, in the order given.
    """

    xyz: np.ndarray
    colors: np.ndarray
    semantic: np.ndarray
    instance: np.ndarray


def list_objects(folder: Path) -> list[ObjectFile]:
    """The object files of ``Annotations``, by class name and number; hidden files and other kinds are passed over.

    A second copy of an object, ``wall_3 (1).txt`` beside ``wall_3.txt`` say, is left out with a warning.

    Raises:
        SceneError: The folder is missing, holds no objects, or a file's class is not known.
    """
    if not folder.is_dir():
        raise SceneError(f'{folder}: no such folder; expected one text file an object, copy the room again')
    found: list[tuple[str, int, ObjectFile]] = []
    for path in files_ending(folder, '.txt', large=True):
        match = _NAME.fullmatch(path.stem)
        if match is None:
            raise SceneError(f'{path}: expected a name like chair_3.txt (class and number); rename or remove the file')
        name = SYNONYMS.get(match['name'].lower(), match['name'].lower())
        if name not in CLASSES:
            raise SceneError(f'{path}: unknown class {match["name"]!r}; expected one of {", ".join(CLASSES)}')
        if match['copy'] and (folder / f'{match["name"]}_{match["number"]}.txt').is_file():
            warnings.warn(f'{path}: a second copy of {match["name"]}_{match["number"]}.txt, left out', stacklevel=2)
            continue
        found.append((match['name'].lower(), int(match['number']), ObjectFile(path, name)))
    if not found:
        raise SceneError(f'{folder}: holds no objects; expected files like chair_3.txt, copy the room again')
    return [item for _, _, item in sorted(found, key=lambda entry: (entry[0], entry[1], entry[2].path.name))]


def read_object(path: Path) -> Float[np.ndarray, 'points 6']:
    """Rows x, y, z, red, green, blue of one object, colours from 0 to 255.

    A line with a stray byte (the release has ``185<NUL>187`` in Area 5) is repaired where only one reading makes it six
    numbers; a warning tells file and line.

    Raises:
        SceneError: The file holds no points, or a line is not six finite numbers with colours from 0 to 255.
    """
    check_signature(path)
    text = plain_text(path.read_bytes())
    repairs = 0
    while True:
        try:
            table = parse_table(text, columns=6)
            break
        except BadTextError as error:
            fixed = _repaired(error.content)
            if fixed is None or repairs == MOST_REPAIRS:
                raise SceneError(
                    f'{path}, {error}; expected x y z red green blue, correct the line or copy the file again'
                ) from error
            repairs += 1
            warnings.warn(
                f'{path}, line {error.line}: stray byte in {error.content.decode("ascii", "backslashreplace")!r}, '
                f'read as {fixed.decode()!r}',
                stacklevel=2,
            )
            text = _with_line(text, error.line, fixed)
    _check_object(path, table, text)
    return table


def read_room(objects: Sequence[ObjectFile]) -> Room:
    """The points of all objects, one file after the other.

    Raises:
        SceneError: A file cannot be used; the message names it.
    """
    tables = [read_object(item.path) for item in objects]
    sizes = [len(table) for table in tables]
    points = np.concatenate(tables)
    xyz, colors = points[:, :3], points[:, 3:]
    return Room(
        xyz=xyz if np.abs(xyz).max() > FAR else xyz.astype(np.float32),
        colors=colors.astype(np.uint8 if (colors % 1 == 0).all() else np.float32),
        semantic=np.repeat(np.array([CLASSES.index(item.name) for item in objects], dtype=np.uint8), sizes),
        instance=np.repeat(np.arange(len(objects), dtype=np.int32), sizes),
    )


def _repaired(line: bytes) -> bytes | None:
    """The line without its stray bytes, where there is one way to read it; None where it cannot be told.

    The release's stray bytes are characters that lost the bit 0x20: NUL was a blank, 0x10 to 0x19 were digits. Others
    are read as blanks.
    """
    if not _STRAY.search(line):
        return None
    restored = _STRAY.sub(lambda match: bytes([match[0][0] | 0x20]), line)
    readings = {tuple(reading.split()) for reading in (restored, _STRAY.sub(b' ', line))}
    good = [words for words in readings if len(words) == 6 and all(_is_number(word) for word in words)]
    return b' '.join(good[0]) if len(good) == 1 else None


def _is_number(word: bytes) -> bool:
    return re.fullmatch(rb'[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?', word) is not None


def _with_line(text: bytes, number: int, line: bytes) -> bytes:
    lines = text.split(b'\n')
    lines[number - 1] = line
    return b'\n'.join(lines)


def _check_object(path: Path, table: Float[np.ndarray, 'points 6'], text: bytes) -> None:
    if len(table) == 0:
        raise SceneError(f'{path}: holds no points; remove the file or copy it again')
    bad = ~np.isfinite(table)
    bad[:, 0] |= ~has_place(table[:, :3]) & ~bad[:, :3].any(axis=1)
    bad[:, 3:] |= (table[:, 3:] < 0) | (table[:, 3:] > 255)
    if bad.any():
        row, column = np.argwhere(bad)[0].tolist()
        line = [i for i, content in enumerate(text.split(b'\n'), start=1) if content.strip()][row]
        expected = 'a finite number' if column < 3 else '0 to 255'
        raise SceneError(f'{path}, line {line}: {COLUMNS[column]} is {table[row, column]}, expected {expected}')
