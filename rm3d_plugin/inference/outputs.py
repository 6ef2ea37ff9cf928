"""Whether what is written would replace what is read."""

from collections.abc import Iterable
from pathlib import Path

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.storage.written_files import real_path


def check_targets(targets: Iterable[Path], inputs: Iterable[Path], out: Path) -> None:
    """Look at all files before the first is written.

    Args:
        targets: Files that will be written.
        inputs: Files that are read.
        out: What the user named, for the message.

    Raises:
        ConfigError: A target is an input: by its path, through a link, or as another name of the same file; or
            a folder is in its place.
    """
    read = {_identity(path): path for path in inputs}
    for target in targets:
        if target.is_dir():
            raise ConfigError(f'--out {out}: {target} is a folder, where a file is to be written; name another place')
        if (path := read.get(_identity(target))) is not None:
            raise ConfigError(f'--out {out}: {target.name} would be written over the input {path}; name another place')


def _identity(path: Path) -> tuple[int, int] | Path:
    """Device and inode of a file that exists, else its place."""
    try:
        found = path.stat()
    except OSError:
        return real_path(path)
    return found.st_dev, found.st_ino
