"""The log of a session of clicks: every click and every undo is kept as it comes, and survives a crash."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rm3d_plugin.storage.click_files import (
    LOG_HEAD,
    Click,
    ClickFileError,
    LoggedClicks,
    class_row,
    latest,
    log_line,
    read_click_log,
    row_of_clicks,
)


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
        self.classes, self.colors = log.classes, log.colors
        self._standing, self._last = log.standing, log.last
        self._size = self._forget_what_was_cut_off(log.size)

    @property
    def clicks(self) -> list[Click]:
        """Clicks that count, in the order they came: of those on one point the last, unless it takes the label away."""
        return latest(click for clicks in self._standing.values() for click in clicks)

    def actions(self, scene: str) -> list[Click]:
        """All clicks of a scene that were not taken back, in the order they came, those of class -1, too."""
        return [click for clicks in self._standing.values() if clicks[0].scene == scene for click in clicks]

    @property
    def scenes(self) -> set[str]:
        """Of all clicks that were not taken back."""
        return {clicks[0].scene for clicks in self._standing.values()}

    @property
    def numbers(self) -> list[int]:
        """Of what was added and not taken back, ascending."""
        return list(self._standing)

    def add(self, *clicks: Click) -> int:
        """Keep a click, or many of one scene and class given at once; returns the number that :meth:`undo` takes back.

        Raises:
            ClickFileError: A class is not among the classes of the log, or see :func:`row_of_clicks`.
        """
        return self.add_all([clicks])[0]

    def add_all(self, groups: Sequence[Sequence[Click]]) -> list[int]:
        """Keep several groups of clicks, all or none; see :meth:`add`."""
        numbers = range(self._last + 1, self._last + 1 + len(groups))
        rows = [row_of_clicks(clicks, self.classes) for clicks in groups]
        self._append(*({'click': number, **row} for number, row in zip(numbers, rows, strict=True)))
        self._standing |= {number: list(clicks) for number, clicks in zip(numbers, groups, strict=True)}
        self._last += len(groups)
        return list(numbers)

    def undo(self, number: int | None = None) -> list[Click]:
        """Take back what was added under a number, the latest that stands where none is given; returns it.

        Raises:
            ClickFileError: There is no such click, or it was taken back before.
        """
        return self.undo_all([max(self._standing, default=0) if number is None else number])[0]

    def undo_all(self, numbers: Sequence[int]) -> list[list[Click]]:
        """Take several back, all or none; see :meth:`undo`."""
        for number in numbers:
            if number not in self._standing:
                raise ClickFileError(f'{self.path}: undo: no click {number} stands; {len(self._standing)} do')
        self._append(*({'undo': number} for number in numbers))
        return [self._standing.pop(number) for number in numbers]

    def add_class(self, name: str, color: str | None = None) -> int:
        """Name a class, or give it another colour (``#rrggbb``); returns its number.

        Raises:
            ClickFileError: See :func:`class_row`.
        """
        row = class_row(name, color, self.path)
        self._append(row)
        name = row['add']
        self.classes = tuple(dict.fromkeys([*self.classes, name]))
        if color is not None:
            self.colors[name] = color
        return self.classes.index(name)

    def rename_class(self, old: str, new: str) -> None:
        """Give a class that was added another name.

        Raises:
            ClickFileError: There is no such class, it was not added here, or the new name is taken or is none.
        """
        new = class_row(new, None, self.path)['add']
        if old not in self.classes or old in self._given or new in self.classes:
            raise ClickFileError(f'{self.path}: rename {old!r} to {new!r}: expected a class added here and a free name')
        self._append({'rename': old, 'to': new})
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
