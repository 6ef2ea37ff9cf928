"""One labelled point, and its fields by name as files of clicks hold them."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rm3d_plugin.class_names import class_index
from rm3d_plugin.structures import UNLABELLED, SceneError

LARGEST = 2**62  # of a number in a file
COLUMNS = ('scene', 'index', 'x', 'y', 'z', 'class', 'instance')
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
        semantic=UNLABELLED if takes_away(row) else class_number(where, cells['class'], classes),
        instance=max(int(_number(where, 'instance', cells['instance'], int)), -1) if cells['instance'] else -1,
        index=int(_number(where, 'index', cells['index'], int)) if cells['index'] else None,
        xyz=None if numbers is None else (numbers[0], numbers[1], numbers[2]),
        where=where,
        logged=logged,
    )


def takes_away(row: Mapping[str, Any]) -> bool:
    """Whether the fields of a line of a log take a label or a box away."""
    return 'class' in row and row['class'] is None


def _number(where: str, name: str, text: str, kind: Callable[[str], float]) -> float:
    try:
        value = math.nan if '_' in text else kind(text)  # Python takes 1_0 for ten
    except ValueError:
        value = math.nan
    if not -LARGEST <= value <= LARGEST:  # NaN compares as False
        raise ClickFileError(f'{where}: {name}: expected a {"whole " * (kind is int)}number, got {text!r}')
    return value


def class_number(where: str, text: str, classes: Sequence[str]) -> int:
    """Number of a class that is told by name, letter case aside, or by number.

    Raises:
        ClickFileError: There is no such class.
    """
    if not text:
        raise ClickFileError(f'{where}: class: is empty; name one, or take the line out')
    if (number := class_index(text, classes)) is not None:
        return number
    if text.isdecimal() and len(text) < 9 and int(text) < len(classes):
        return int(text)
    raise ClickFileError(f'{where}: class: expected one of {", ".join(classes)} or 0..{len(classes) - 1}, got {text!r}')
