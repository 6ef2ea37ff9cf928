"""One process at a time in a folder."""

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from rm3d_plugin.user_error import UserError

LOCK = 'run.lock'


class FolderInUseError(UserError):
    """Another process works in the folder; the message names it."""


@contextmanager
def folder_lock(folder: str | Path) -> Iterator[None]:
    """Keep other processes out of a folder; what a killed process left of its lock counts for nothing.

    Raises:
        FolderInUseError: A living process holds the lock.
    """
    with process_lock(Path(folder) / LOCK):
        yield


@contextmanager
def process_lock(path: str | Path) -> Iterator[None]:
    """The same by a file of any name.

    Raises:
        FolderInUseError: A living process holds the lock.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    own = f'{os.getpid()} {_started(os.getpid())} {socket.gethostname()}'
    with path.open('a+', encoding='utf-8') as file:
        _hold(file)  # for as long as it takes to look
        file.seek(0)
        holder = file.read().strip()
        if _lives(holder) and holder != own:
            raise FolderInUseError(
                f'{path.parent}: process {holder.split()[0]} on {holder.split()[2]} works there ({path.name}); wait, '
                'choose another folder, or remove that file if no such process runs'
            )
        file.seek(0)
        file.truncate()
        file.write(own)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)


@contextmanager
def waiting_lock(path: str | Path) -> Iterator[None]:
    """Wait until no other process is within this lock; it ends with its process."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open('a', encoding='utf-8') as file:
        _hold(file)
        yield


def _hold(file: IO[str]) -> None:
    if os.name == 'posix':
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX)


def _lives(holder: str) -> bool:
    """Whether the process of a lock runs: on this machine, and no later one with its number."""
    words = holder.split()
    if len(words) != 3 or not words[0].isdecimal():
        return False
    if words[2] != socket.gethostname():
        return True  # cannot be asked
    return _started(int(words[0])) == words[1] != ''


def _started(process: int) -> str:
    """When a process began, in ticks of the kernel; '0' where only its life can be told, '' where there is none."""
    try:
        return Path(f'/proc/{process}/stat').read_text().rpartition(')')[2].split()[19]
    except (OSError, IndexError):
        pass
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return ''
    except OSError:
        pass
    return '' if Path('/proc/self/stat').exists() else '0'
