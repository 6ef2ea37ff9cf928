"""Click files: labels that a person gave point by point, as CSV, JSON, or a log that only grows.

All three hold the same fields. CSV begins with a line that names its columns; JSON is a list of objects. A log
(``.jsonl``) has one JSON object a line: first ``{"kind": "clicks", "format": 1}``, then ``{"click": 7, "scene": ...}``
for the seventh click, or ``{"undo": 7}``, which takes it back; ``{"click": 8, "scene": ..., "points": [...]}`` labels
many points at once. The later of two clicks on one point counts, and one of class null takes labels away. Classes are
lines, too: ``{"add": "oak", "color": "#2e8b57"}``, ``{"rename": "oak", "to": "tree"}``. A line that a crash cut off
does not count.
"""

import csv
import io
import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from rm3d_plugin.storage.files import read_json, write_json, write_text
from rm3d_plugin.structures import UNLABELLED, SceneError

COLUMNS = ('scene', 'index', 'x', 'y', 'z', 'class', 'instance')
LOG_HEAD = {'kind': 'clicks', 'format': 1}
DECIMALS = 4  # of a metre: 0.1 mm
Line = tuple[str, Mapping[str, Any]]  # file and line for error messages; field -> text or number


class ClickFileError(SceneError):
    """Clicks that cannot be read or written; the message names file, line and field."""


@dataclass(frozen=True)
class Click:
    """One labelled point.

    Attributes:
        scene: Name of its scene.
        semantic: Class number.
        instance: Instance number, -1 = none.
        index: Point number in the original file, or None where only the place is known.
        xyz: Place in metres, in the coordinates of the original file, or None where only the number is known.
        where: For error messages, such as ``clicks.csv line 3``.
        logged: From a log, where a later click on the same point counts, and class -1 takes its label away.

    Raises:
        ClickFileError: There is no scene, or neither index nor place.
    """

    scene: str
    semantic: int
    instance: int = -1
    index: int | None = None
    xyz: tuple[float, float, float] | None = None
    where: str = field(default='click', compare=False)
    logged: bool = field(default=False, compare=False)

    def __post_init__(self) -> None:
        if not self.scene:
            raise ClickFileError(f'{self.where}: no scene given')
        if self.index is None and self.xyz is None:
            raise ClickFileError(f'{self.where}: expected an index or x, y and z')


class LoggedClicks(NamedTuple):
    """What a log says.

    Attributes:
        standing: Number -> its clicks, many where many points were labelled at once; without those taken back. Class
            -1 takes labels away.
        last: Highest number given, 0 before the first.
        size: Bytes of whole lines; what follows was cut off.
        classes: Names that clicks are numbered by.
        colors: Name -> colour as ``#rrggbb``, of classes that have one.
    """

    standing: dict[int, list[Click]]
    last: int
    size: int
    classes: tuple[str, ...]
    colors: dict[str, str]


class _Log(NamedTuple):
    standing: dict[int, Line]
    last: int
    colors: dict[str, str | None]  # of the classes that the log itself names


def read_clicks(path: str | Path, classes: Sequence[str]) -> list[Click]:
    """Read ``scene,index,class[,instance]`` or ``scene,x,y,z,class[,instance]``.

    Args:
        path: ``.json`` (a list of objects), ``.jsonl`` (a log; clicks taken back are left out), anything else is CSV
            with named columns in any order. Where both index and place are given, the place must be that of the point.
        classes: The class of a click is one of these names, or its number.

    Raises:
        ClickFileError: The file or one of its lines cannot be used; the message names both.
    """
    logged = Path(path).suffix.lower() == '.jsonl'
    return [click_from_row(where, row, classes, logged) for where, row in _rows(Path(path))]


def click_classes(path: str | Path) -> list[str]:
    """Class names of a file of clicks, sorted; for a file whose classes nobody listed.

    Raises:
        ClickFileError: The file cannot be used.
    """
    return sorted({str(row['class']) for _, row in _rows(Path(path)) if row.get('class') is not None})


def write_clicks(path: str | Path, clicks: Sequence[Click], classes: Sequence[str]) -> None:
    """Write clicks so that :func:`read_clicks` reads them back: ``.json``, ``.jsonl``, anything else is CSV.

    Raises:
        ClickFileError: A click has a class that is not among ``classes``.
    """
    path = Path(path)
    rows = [row_of_click(click, classes) for click in clicks]
    if path.suffix.lower() == '.json':
        write_json(path, rows)
    elif path.suffix.lower() == '.jsonl':
        numbered = ({'click': number, **row} for number, row in enumerate(rows, start=1))
        write_text(path, ''.join(map(log_line, [LOG_HEAD, *numbered])))
    else:
        text = io.StringIO()
        writer = csv.DictWriter(text, COLUMNS, restval='', lineterminator='\n')
        writer.writeheader()
        writer.writerows(rows)
        write_text(path, text.getvalue())


def read_click_log(path: str | Path, classes: Sequence[str]) -> LoggedClicks:
    """Read a log and follow its undos.

    Raises:
        ClickFileError: It is no log, or a line cannot be used; the message names the line.
    """
    lines, size = _log_lines(Path(path))
    log = _followed(Path(path), lines)
    known = tuple(dict.fromkeys([*classes, *log.colors]))
    standing = {number: _clicks_of_line(line, known) for number, line in log.standing.items()}
    return LoggedClicks(standing, log.last, size, known, {name: of for name, of in log.colors.items() if of})


def log_line(row: Mapping[str, Any]) -> str:
    """One line of a log."""
    return json.dumps(row, ensure_ascii=False) + '\n'


def row_of_click(click: Click, classes: Sequence[str], lowest: int = 0) -> dict[str, Any]:
    """The fields of a click by their names in a file; those that it lacks are left out.

    Args:
        click: The click.
        classes: Class names.
        lowest: -1: of a log, which may take labels away.

    Raises:
        ClickFileError: Its class is not among ``classes``.
    """
    if not lowest <= click.semantic < len(classes):
        raise ClickFileError(f'{click.where}: class: expected a number 0..{len(classes) - 1}, got {click.semantic}')
    row: dict[str, Any] = {'scene': click.scene}
    if click.index is not None:
        row['index'] = click.index
    if click.xyz is not None:
        row |= {name: round(float(value), DECIMALS) for name, value in zip('xyz', click.xyz, strict=True)}
    row['class'] = None if click.semantic == UNLABELLED else classes[click.semantic]
    return row if click.instance < 0 else {**row, 'instance': click.instance}


def row_of_clicks(clicks: Sequence[Click], classes: Sequence[str]) -> dict[str, Any]:
    """The fields of clicks that were given at once, all of one scene, class and instance, in a log.

    Raises:
        ClickFileError: They differ, have no index, or their class is not among ``classes``.
    """
    if len(clicks) == 1:
        return row_of_click(clicks[0], classes, UNLABELLED)
    if len({(click.scene, click.semantic, click.instance) for click in clicks}) != 1:
        raise ClickFileError('clicks given at once: expected at least one, all of one scene, class and instance')
    if any(click.index is None for click in clicks):
        raise ClickFileError(f'{clicks[0].where}: clicks given at once: expected the index of each point')
    row = row_of_click(clicks[0], classes, UNLABELLED)
    kept: dict[str, Any] = {name: row[name] for name in ('class', 'instance') if name in row}
    return {'scene': row['scene'], 'points': [click.index for click in clicks], **kept}


def class_row(name: str, color: str | None, where: str | Path) -> dict[str, str]:
    """The fields that name a class; blanks around the name are dropped.

    Args:
        name: One line of text.
        color: ``#rrggbb``, or None.
        where: For error messages.

    Raises:
        ClickFileError: The name is empty or holds what cannot be printed, such as a line break, or it is no colour.
    """
    name = name.strip()
    if not name or not name.isprintable():
        raise ClickFileError(f'{where}: a class needs a name: expected one line of text, got {name!r}')
    if color is None:
        return {'add': name}
    if not re.fullmatch('#[0-9a-fA-F]{6}', color):
        raise ClickFileError(f'{where}: class {name!r}: color: expected #rrggbb, got {color!r}')
    return {'add': name, 'color': color}


def click_from_row(where: str, row: Mapping[str, Any], classes: Sequence[str], logged: bool = False) -> Click:
    """The click of named fields.

    Args:
        where: File and line, for error messages.
        row: Field -> text or number; other fields are ignored.
        classes: Class names.
        logged: See :class:`Click`.

    Raises:
        ClickFileError: A field is missing or cannot be used.
    """
    cells = {name: '' if row.get(name) is None else str(row[name]) for name in COLUMNS}
    place = [(name, cells[name]) for name in 'xyz']
    numbers = [_number(where, name, cell, float) for name, cell in place] if all(cell for _, cell in place) else None
    return Click(
        scene=cells['scene'],
        semantic=UNLABELLED if _takes_away(row) else _class_number(where, cells['class'], classes),
        instance=max(int(_number(where, 'instance', cells['instance'], int)), -1) if cells['instance'] else -1,
        index=int(_number(where, 'index', cells['index'], int)) if cells['index'] else None,
        xyz=None if numbers is None else (numbers[0], numbers[1], numbers[2]),
        where=where,
        logged=logged,
    )


def _rows(path: Path) -> list[Line]:
    if not path.is_file():
        raise ClickFileError(f'{path}: no such file of clicks; looked for at {path.absolute()}')
    readers = {'.json': _json_rows, '.jsonl': _log_rows}
    rows = readers.get(path.suffix.lower(), _csv_rows)(path)
    if not rows:
        raise ClickFileError(f'{path}: holds no click')
    return rows


def _json_rows(path: Path) -> list[Line]:
    content = read_json(path)
    if not isinstance(content, list) or not all(isinstance(row, dict) for row in content):
        raise ClickFileError(f'{path}: expected a list of objects with scene, class and index or x, y, z')
    return [(f'{path} entry {i}', row) for i, row in enumerate(content, start=1)]


def _csv_rows(path: Path) -> list[Line]:
    try:
        text = path.read_text(encoding='utf-8-sig')
    except UnicodeDecodeError as error:
        raise ClickFileError(f'{path}: expected UTF-8 text ({error})') from error
    reader = csv.DictReader(io.StringIO(text), skipinitialspace=True)
    names = [name.strip().lower() for name in reader.fieldnames or ()]
    if 'scene' not in names or 'class' not in names or not ('index' in names or {'x', 'y', 'z'} <= set(names)):
        raise ClickFileError(
            f'{path}: the first line must name the columns: scene,index,class[,instance] or '
            f'scene,x,y,z,class[,instance]; got {",".join(names)!r}'
        )
    reader.fieldnames = names
    return [
        (f'{path} line {reader.line_num}', {name: cell.strip() for name, cell in row.items() if isinstance(cell, str)})
        for row in reader
    ]


def latest(clicks: Iterable[Click]) -> list[Click]:
    """Of clicks on one point the last; those that take a label away are left out."""
    out: dict[tuple[str, int | str], Click] = {}
    for click in clicks:
        key = (click.scene, str(click.xyz) if click.index is None else click.index)
        out.pop(key, None)
        out[key] = click
    return [click for click in out.values() if click.semantic >= 0]


def _log_rows(path: Path) -> list[Line]:
    standing = _followed(path, _log_lines(path)[0]).standing
    lines = [each for line in standing.values() for each in _expanded(line)]
    placed = {row.get('scene') for _, row in lines if row.get('index') is None}
    rows: dict[tuple[Any, ...], Line] = {}
    for where, row in lines:
        index = row.get('index')
        key = (row.get('scene'), where if index is None else index)
        rows.pop(key, None)
        rows[key] = (where, row)
    # which point a place is on only the scan tells: there, labels that are taken away stay in until it is known
    return [line for line in rows.values() if not _takes_away(line[1]) or line[1].get('scene') in placed]


def _takes_away(row: Mapping[str, Any]) -> bool:
    return 'class' in row and row['class'] is None


def _expanded(line: Line) -> list[Line]:
    """A line for each point of a click that labels many at once."""
    where, row = line
    return [line] if row.get('points') is None else [(where, {**row, 'index': point}) for point in _points(line)]


def _clicks_of_line(line: Line, classes: Sequence[str]) -> list[Click]:
    where, row = line
    if row.get('points') is None:
        return [click_from_row(where, row, classes, logged=True)]
    points = _points(line)
    first = click_from_row(where, {**row, 'index': points[0]}, classes, logged=True)
    scene, semantic, instance = first.scene, first.semantic, first.instance
    return [Click(scene, semantic, instance, point, None, where, True) for point in points]


def _points(line: Line) -> list[int]:
    where, row = line
    points = row['points']
    if not isinstance(points, list) or not points or not {type(point) for point in points} <= {int}:
        raise ClickFileError(f'{where}: points: expected a list of numbers of points, got {str(points)[:40]}')
    return points


def _followed(path: Path, lines: Sequence[Line]) -> _Log:
    """The clicks that stand in the end, the highest number given, and the classes that are named."""
    if not lines or lines[0][1] != LOG_HEAD:
        raise ClickFileError(f'{path} line 1: expected {json.dumps(LOG_HEAD)}; this is no log of clicks')
    standing: dict[int, Line] = {}
    colors: dict[str, str | None] = {}
    last = 0
    for where, row in lines[1:]:
        if 'undo' in row:
            if not isinstance(row['undo'], int) or standing.pop(row['undo'], None) is None:
                raise ClickFileError(f'{where}: undo: no click {row["undo"]!r} stands before this line')
        elif 'add' in row:
            named = class_row(str(row['add']), row.get('color'), where)
            colors[named['add']] = named.get('color') or colors.get(named['add'])
        elif 'rename' in row:
            colors = _renamed(where, row, colors)
            standing = {number: _with_class(line, row) for number, line in standing.items()}
        else:
            last += 1
            standing[last] = (where, row)
            if row.get('click') != last:
                raise ClickFileError(f'{where}: click: expected number {last}, got {row.get("click")!r}')
    return _Log(standing, last, colors)


def _renamed(where: str, row: Mapping[str, Any], colors: dict[str, str | None]) -> dict[str, str | None]:
    old, new = str(row['rename']), str(row.get('to') or '')
    if old not in colors or not new or new in colors:
        raise ClickFileError(f'{where}: rename: expected a class that was added, and a new name, got {old!r}, {new!r}')
    return {new if name == old else name: color for name, color in colors.items()}


def _with_class(line: Line, renamed: Mapping[str, Any]) -> Line:
    where, row = line
    return (where, {**row, 'class': renamed['to']}) if row.get('class') == renamed['rename'] else line


def _log_lines(path: Path) -> tuple[list[Line], int]:
    """Objects of the lines, with file and line, and the bytes they take; a last line that was cut off is left out."""
    content = path.read_bytes()
    size = content.rfind(b'\n') + 1
    if _is_whole(content[size:]):  # a person left the last newline out
        size = len(content)
    lines: list[Line] = []
    for number, line in enumerate(content[:size].splitlines(), start=1):
        where = f'{path} line {number}'
        try:
            row = json.loads(line)
        except ValueError as error:
            raise ClickFileError(f'{where}: not readable as JSON ({error}); mend or delete this line') from error
        if not isinstance(row, dict):
            raise ClickFileError(f'{where}: expected an object with scene, class and index or x, y, z')
        lines.append((where, row))
    return lines, size


def _is_whole(line: bytes) -> bool:
    """True for a JSON object; a part of one never is."""
    try:
        return isinstance(json.loads(line), dict)
    except ValueError:
        return False


def _number(where: str, name: str, text: str, kind: Callable[[str], float]) -> float:
    try:
        value = kind(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ClickFileError(f'{where}: {name}: expected a {"whole " * (kind is int)}number, got {text!r}')
    return value


def _class_number(where: str, text: str, classes: Sequence[str]) -> int:
    if text in classes:
        return list(classes).index(text)
    if text.isdigit() and int(text) < len(classes):
        return int(text)
    raise ClickFileError(f'{where}: class: expected one of {", ".join(classes)} or 0..{len(classes) - 1}, got {text!r}')
