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
    log_line,
    read_click_log,
    row_of_click,
)


class ClickLog:
    """Clicks of a session on disk, in a file that only grows; one process may write it at a time.

    A click is on the disk when :meth:`add` returns. An undo is a line of its own, so that the whole session can be
    read back later. The file is a label budget as it is: ``budget=clicks=session.jsonl``.

    Args:
        path: The ``.jsonl`` file; a session that is there is taken up, else one begins.
        classes: Class names.

    Raises:
        ClickFileError: The file is there but is no log of clicks, or its name has another ending.
    """

    def __init__(self, path: str | Path, classes: Sequence[str]) -> None:
        self.path = Path(path)
        self.classes = tuple(classes)
        if self.path.suffix != '.jsonl':
            raise ClickFileError(f'{path}: a log of clicks is named *.jsonl')
        self._standing, self._last, size = self._open()
        self._forget_what_was_cut_off(size)

    @property
    def clicks(self) -> list[Click]:
        """Clicks that stand, in the order they came."""
        return list(self._standing.values())

    def add(self, click: Click) -> int:
        """Keep a click; returns its number, by which :meth:`undo` takes it back.

        Raises:
            ClickFileError: Its class is not among the classes of the log.
        """
        self._append({'click': self._last + 1, **row_of_click(click, self.classes)})
        self._last += 1
        self._standing[self._last] = click
        return self._last

    def undo(self, number: int | None = None) -> Click:
        """Take a click back, the latest one that stands where no number is given; returns it.

        Raises:
            ClickFileError: There is no such click, or it was taken back before.
        """
        number = max(self._standing, default=0) if number is None else number
        if number not in self._standing:
            raise ClickFileError(f'{self.path}: undo: no click {number} stands; {len(self._standing)} do')
        self._append({'undo': number})
        return self._standing.pop(number)

    def _open(self) -> LoggedClicks:
        if not self.path.exists() or not self.path.stat().st_size:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._append(LOG_HEAD)
        return read_click_log(self.path, self.classes)

    def _forget_what_was_cut_off(self, size: int) -> None:
        """Make the file end with a whole line, so that the next one stands alone."""
        with self.path.open('r+b') as file:
            file.truncate(size)
            file.seek(size - 1)
            if file.read(1) != b'\n':
                file.write(b'\n')

    def _append(self, row: Mapping[str, Any]) -> None:
        """Write one line by one call and flush it to the disk; the line is there as a whole, or counts as cut off."""
        line = log_line(row).encode()
        handle = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
        before = os.fstat(handle).st_size
        try:
            if os.write(handle, line) != len(line):
                os.ftruncate(handle, before)
                raise ClickFileError(f'{self.path}: the disk is full; this line is not kept')
            os.fsync(handle)
        finally:
            os.close(handle)
