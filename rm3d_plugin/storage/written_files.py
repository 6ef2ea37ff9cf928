"""Which files of a folder this program wrote, so that it removes those and no others."""

import os
from pathlib import Path

MANIFEST = 'written_files.txt'
_recorded: dict[Path, set[str]] = {}  # folder -> names it knows; of this process


def real_path(path: str | Path) -> Path:
    """The absolute path without links; links in a circle stay, for whoever opens them to tell."""
    return Path(os.path.realpath(path))


def record_writes(folder: str | Path) -> None:
    """From now on this process notes each file that it writes atomically within a folder, in the folder's manifest."""
    root = real_path(folder)
    _recorded[root] = set(written_files(root))


def note_written(path: Path) -> None:
    """Note a file that is about to be written; of no effect outside of recorded folders."""
    if not _recorded:
        return
    place = real_path(path.parent) / path.name
    for root, names in _recorded.items():
        if place.is_relative_to(root) and (name := place.relative_to(root).as_posix()) not in names:
            names.add(name)
            with (root / MANIFEST).open('a', encoding='utf-8') as file:  # one short line: whole or not at all
                file.write(f'{name}\n')


def written_files(folder: str | Path) -> list[str]:
    """Names of the files, relative to the folder; those that left it (``..``) are passed over."""
    path = Path(folder) / MANIFEST
    if not path.is_file():
        return []
    names = path.read_text(encoding='utf-8', errors='replace').splitlines()
    return [name for name in names if name and not os.path.isabs(name) and '..' not in Path(name).parts]


def _is_inside(root: Path, name: str) -> bool:
    """Whether a file of this name, or a link, lies in the folder, and no linked folder leads out of it."""
    path = root / name
    there = os.path.isfile(path) or os.path.islink(path)  # unlike Path's, False whatever a damaged name holds
    return there and real_path(path.parent).is_relative_to(real_path(root))


def remove_written(folder: str | Path) -> None:
    """Remove the files of the manifest, then the folders that they leave empty, then the manifest."""
    root = Path(folder)
    names = [name for name in written_files(root) if _is_inside(root, name)]
    for name in names:
        (root / name).unlink(missing_ok=True)
    parents = {parent for name in names for parent in (root / name).parents if parent.is_relative_to(root)} - {root}
    for parent in sorted(parents, key=lambda parent: len(parent.parts), reverse=True):
        if parent.is_dir() and not any(parent.iterdir()):
            parent.rmdir()
    (root / MANIFEST).unlink(missing_ok=True)
    _recorded.pop(real_path(root), None)
