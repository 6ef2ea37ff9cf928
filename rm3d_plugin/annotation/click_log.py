"""The log of a session of clicks: every click and every undo is kept as it comes, and survives a crash."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rm3d_plugin.class_names import class_index, one_spelling
from rm3d_plugin.storage.click_log_lines import LOG_HEAD, LoggedClicks, class_row, latest, log_line, read_click_log
from rm3d_plugin.storage.clicks import Click, ClickFileError, row_of_clicks
from rm3d_plugin.storage.instance_box import InstanceBox, row_of_box


class Action(NamedTuple):
    """What is done and taken back as one.

    Attributes:
        groups: Clicks, those of a group of one scene, class and instance.
        boxes: Of objects, from now on.
    """

    groups: Sequence[Sequence[Click]] = ()
    boxes: Sequence[InstanceBox] = ()

    @property
    def scenes(self) -> set[str]:
        """Of its clicks and boxes."""
        return {clicks[0].scene for clicks in self.groups} | {box.scene for box in self.boxes}


class ClickLog:
    """Clicks of a session on disk, in a file that only grows; one process may write it at a time.

    A click is on the disk when :meth:`add` returns. An undo is a line of its own, so that the whole session can be
    read back later. The file is a label budget as it is: ``budget=clicks=session.jsonl``.

    Args:
        path: The ``.jsonl`` file; a session that is there is taken up, else one begins.
        classes: Class names; those that the log adds come after them.

    Raises:
        ClickFileError: The file is there but is no log of clicks, its name has another ending, or, at any action:
            another program changed it.
    """

    def __init__(self, path: str | Path, classes: Sequence[str] = ()) -> None:
        self.path, self._given = Path(path), tuple(classes)
        if self.path.suffix != '.jsonl':
            raise ClickFileError(f'{path}: a log of clicks is named *.jsonl')
        log = self._open()
        self.classes, self.colors, self.renamed = log.classes, log.colors, log.renamed
        self._standing, self._boxes, self._last = log.standing, log.boxes, log.last
        self._actions = log.actions
        self._size = self._forget_what_was_cut_off(log.size)

    @property
    def clicks(self) -> list[Click]:
        """Clicks that count, in the order they came: of those on one point the last, unless it takes the label away."""
        return latest(click for clicks in self._standing.values() for click in clicks)

    def actions(self, scene: str) -> list[Click]:
        """All clicks of a scene that were not taken back, in the order they came, those of class -1, too."""
        return [click for clicks in self._standing.values() if clicks[0].scene == scene for click in clicks]

    def boxes(self, scene: str) -> dict[int, InstanceBox]:
        """The box of each object of a scene that has one, by number of the object."""
        last = {box.instance: box for box in self._boxes.values() if box.scene == scene}
        return {instance: last[instance] for instance in sorted(last) if last[instance].semantic >= 0}

    @property
    def scenes(self) -> set[str]:
        """Of all clicks and boxes that were not taken back."""
        return Action(list(self._standing.values()), list(self._boxes.values())).scenes

    @property
    def standing(self) -> list[list[int]]:
        """Numbers of each action that was not taken back, in the order they came."""
        return [list(numbers) for numbers in self._actions]

    def add(self, *clicks: Click) -> int:
        """Keep a click, or many of one scene and class given at once; returns the number that :meth:`undo` takes back.

        Raises:
            ClickFileError: A class is not among the classes of the log, or see :func:`row_of_clicks`.
        """
        return self.act(Action([clicks]))[0]

    def act(self, action: Action) -> list[int]:
        """Keep an action, as a whole or not at all; returns a number for each group and box, see :meth:`add`."""
        first, groups = self._last + 1, len(action.groups)
        rows = [('click', row_of_clicks(clicks, self.classes)) for clicks in action.groups]
        rows += [('box', row_of_box(box, self.classes)) for box in action.boxes]
        numbers = range(first, first + len(rows))
        marks = [{}, *({'with': first},) * (len(rows) - 1)]
        named = zip(numbers, rows, marks, strict=False)
        self._append(*({kind: number, **row, **mark} for number, (kind, row), mark in named))
        self._standing |= {number: list(each) for number, each in zip(numbers, action.groups, strict=False)}
        self._boxes |= dict(zip(numbers[groups:], action.boxes, strict=True))
        self._last += len(rows)
        self._actions += [list(numbers)] if rows else []
        return list(numbers)

    def undo(self, number: int | None = None) -> list[Click]:
        """Take back the clicks that were added under a number, the latest that stand where none is given; returns them.

        Raises:
            ClickFileError: There are no such clicks, or they were taken back before.
        """
        number = max(self._standing, default=0) if number is None else number
        return list(self.take_back([number]).groups[0])

    def take_back(self, numbers: Sequence[int]) -> Action:
        """Take back what was kept under numbers, all or none; returns it.

        Raises:
            ClickFileError: Nothing was, or it was taken back before.
        """
        for number in numbers:
            if number not in self._standing and number not in self._boxes:
                raise ClickFileError(f'{self.path}: undo: no click {number} stands; {len(self._standing)} do')
        self._append(*({'undo': number} for number in numbers))
        left = ([number for number in each if number not in numbers] for each in self._actions)
        self._actions = [each for each in left if each]
        groups = [self._standing.pop(number) for number in numbers if number in self._standing]
        return Action(groups, [self._boxes.pop(number) for number in numbers if number in self._boxes])

    def add_class(self, name: str, color: str | None = None) -> int:
        """Name a class, or give it another colour (``#rrggbb``); returns its number. Letter case does not matter.

        Raises:
            ClickFileError: See :func:`class_row`.
        """
        row = class_row(name, color, self.path)
        self._append(row)
        self.classes = one_spelling([*self.classes, row['add']])
        number = class_index(row['add'], self.classes)
        assert number is not None
        if color is not None:
            self.colors[self.classes[number]] = color
        return number

    def rename_class(self, old: str, new: str) -> None:
        """Give a class that was added another name.

        Raises:
            ClickFileError: There is no such class, it was not added here, or the new name is taken or is none.
        """
        new = class_row(new, None, self.path)['add']
        others = [name for name in self.classes if name != old]
        if old not in self.classes or old in self._given or new == old or class_index(new, others) is not None:
            raise ClickFileError(f'{self.path}: rename {old!r} to {new!r}: expected a class added here and a free name')
        self._append({'rename': old, 'to': new})
        self.renamed += (old,)
        self.classes = tuple(new if name == old else name for name in self.classes)
        if old in self.colors:
            self.colors[new] = self.colors.pop(old)

    def _open(self) -> LoggedClicks:
        if not self.path.exists() or not self.path.stat().st_size:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._size = 0
            self._append(LOG_HEAD)
        return read_click_log(self.path, self._given)

    def _forget_what_was_cut_off(self, size: int) -> int:
        """Make the file end with a whole line, so that the next one stands alone; its bytes."""
        with self.path.open('r+b') as file:
            file.truncate(size)
            file.seek(size - 1)
            if file.read(1) != b'\n':
                file.write(b'\n')
            return file.seek(0, os.SEEK_END)

    def _append(self, *rows: Mapping[str, Any]) -> None:
        """Write lines by one call and flush them to the disk; a line is there as a whole, or counts as cut off."""
        line = ''.join(map(log_line, rows)).encode()
        handle = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
        try:
            if os.fstat(handle).st_size != self._size:
                raise ClickFileError(f'{self.path}: another program changed this file; end the session and start again')
            try:
                if os.write(handle, line) != len(line):
                    raise ClickFileError(f'{self.path}: the disk is full; this line is not kept')
                os.fsync(handle)
            except BaseException:  # whatever it was, the file holds what was answered and no more
                os.ftruncate(handle, self._size)
                raise
            self._size += len(line)
        finally:
            os.close(handle)


def default_log(scans: Sequence[Path]) -> Path:
    """Where the clicks of scans are kept."""
    first = Path(scans[0])
    return first.with_name(f'{first.stem}.clicks.jsonl' if len(scans) == 1 else 'clicks.jsonl')
