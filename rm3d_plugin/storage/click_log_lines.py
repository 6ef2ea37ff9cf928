"""A log of clicks: a file of lines that only grows.

One JSON object a line: first ``{"kind": "clicks", "format": 1}``, then ``{"click": 7, "scene": ...}``
for the seventh click, or ``{"undo": 7}``, which takes it back; ``{"click": 8, "scene": ..., "points": [...]}`` labels
many points at once. The later of two clicks on one point counts, and one of class null takes labels away.
``{"box": 9, "scene": ..., "instance": 3, "class": ..., "center": [...], "size": [...], "yaw": ...}`` is the box of an
object from now on; one of class null takes it away. Clicks and boxes are numbered together; lines that were one action
have ``"with"``, the number of the first. Classes are lines, too: ``{"add": "oak", "color": "#2e8b57"}``,
``{"rename": "oak", "to": "tree"}``. A line that a crash cut off does not count.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rm3d_plugin.class_names import class_index, one_spelling
from rm3d_plugin.storage.clicks import Click, ClickFileError, Line, click_from_row, takes_away
from rm3d_plugin.storage.files import parse_json
from rm3d_plugin.storage.instance_box import InstanceBox, box_from_row

LOG_HEAD = {'kind': 'clicks', 'format': 1}


class LoggedClicks(NamedTuple):
    """What a log says.

    Attributes:
        standing: Number -> its clicks, many where many points were labelled at once; without those taken back. Class
            -1 takes labels away.
        boxes: Number -> what was said of a box, without those taken back.
        actions: Numbers that stand, those of one action together.
        last: Highest number given, 0 before the first.
        size: Bytes of whole lines; what follows was cut off.
        classes: Names that clicks are numbered by.
        colors: Name -> colour as ``#rrggbb``, of classes that have one.
        renamed: Names that classes had before.
    """

    standing: dict[int, list[Click]]
    boxes: dict[int, InstanceBox]
    actions: list[list[int]]
    last: int
    size: int
    classes: tuple[str, ...]
    colors: dict[str, str]
    renamed: tuple[str, ...]


class _Log(NamedTuple):
    standing: dict[int, Line]
    last: int
    colors: dict[str, str | None]  # of the classes that the log itself names
    renamed: tuple[str, ...]


def read_click_log(path: str | Path, classes: Sequence[str]) -> LoggedClicks:
    """Read a log and follow its undos.

    Raises:
        ClickFileError: It is no log, or a line cannot be used; the message names the line.
    """
    lines, size = _log_lines(Path(path))
    log = _followed(Path(path), lines)
    known = one_spelling([*classes, *log.colors])
    clicks = {number: _clicks_of_line(line, known) for number, line in log.standing.items() if 'box' not in line[1]}
    boxes = {number: box_from_row(*line, known) for number, line in log.standing.items() if 'box' in line[1]}
    colors = {name: of for name, of in log.colors.items() if of}
    return LoggedClicks(clicks, boxes, _actions(log.standing), log.last, size, known, colors, log.renamed)


def log_line(row: Mapping[str, Any]) -> str:
    """One line of a log."""
    return json.dumps(row, ensure_ascii=False) + '\n'


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


def latest(clicks: Iterable[Click]) -> list[Click]:
    """Of clicks on one point the last; those that take a label away are left out."""
    out: dict[tuple[str, int | str], Click] = {}
    for click in clicks:
        key = (click.scene, str(click.xyz) if click.index is None else click.index)
        out.pop(key, None)
        out[key] = click
    return [click for click in out.values() if click.semantic >= 0]


def log_rows(path: Path) -> list[Line]:
    """A line for each click of a log that counts, boxes left out.

    Raises:
        ClickFileError: See :func:`read_click_log`.
    """
    standing = _followed(path, _log_lines(path)[0]).standing
    lines = [each for line in standing.values() if 'box' not in line[1] for each in _expanded(line)]
    placed = {row.get('scene') for _, row in lines if row.get('index') is None}
    rows: dict[tuple[Any, ...], Line] = {}
    for where, row in lines:
        index = row.get('index')
        key = (row.get('scene'), where if index is None else index)
        rows.pop(key, None)
        rows[key] = (where, row)
    # which point a place is on only the scan tells: there, labels that are taken away stay in until it is known
    return [line for line in rows.values() if not takes_away(line[1]) or line[1].get('scene') in placed]


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
    last, renamed = 0, list[str]()
    for where, row in lines[1:]:
        if 'undo' in row:
            if not isinstance(row['undo'], int) or standing.pop(row['undo'], None) is None:
                raise ClickFileError(f'{where}: undo: no click {row["undo"]!r} stands before this line')
        elif 'add' in row:
            named = class_row(str(row['add']), row.get('color'), where)
            number = class_index(named['add'], [*colors])
            name = named['add'] if number is None else [*colors][number]
            colors[name] = named.get('color') or colors.get(name)
        elif 'rename' in row:
            colors = _renamed(where, row, colors)
            renamed.append(str(row['rename']))
            standing = {number: _with_class(line, row) for number, line in standing.items()}
        else:
            last += 1
            standing[last] = (where, row)
            kind = 'box' if 'box' in row else 'click'
            if row.get(kind) != last:
                raise ClickFileError(f'{where}: {kind}: expected number {last}, got {row.get(kind)!r}')
    return _Log(standing, last, colors, tuple(renamed))


def _actions(standing: Mapping[int, Line]) -> list[list[int]]:
    """Numbers that were given at once, together."""
    found: dict[int, list[int]] = {}
    for number, (where, row) in standing.items():
        first = row.get('with', number)
        if type(first) is not int:
            raise ClickFileError(f'{where}: with: expected the number of a click or box, got {first!r}')
        found.setdefault(first, []).append(number)
    return list(found.values())


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
            row = parse_json(line)
        except ValueError as error:
            raise ClickFileError(f'{where}: not readable as JSON ({error}); mend or delete this line') from error
        if not isinstance(row, dict):
            raise ClickFileError(f'{where}: expected an object with scene, class and index or x, y, z')
        lines.append((where, row))
    return lines, size


def _is_whole(line: bytes) -> bool:
    """True for a JSON object; a part of one never is."""
    try:
        return isinstance(parse_json(line), dict)
    except ValueError:
        return False
