"""A folder of made-up rooms: made once, complete or made on, never mixed with anything else."""

import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from tqdm import tqdm

from rm3d_plugin.storage import write_bytes

ROOMS_VERSION = 4  # raise whenever the bytes of a room change
MARKER = 'demo.json'
PARTIAL = '.partial'


def fill_demo(
    root: Path,
    recipe: Mapping[str, object],
    counts: Mapping[str, object],
    owned: Sequence[str],
    readme: str,
    todo: Sequence[tuple[Path, Callable[[Path], None]]],
    finish: Callable[[], None],
    workers: int,
    progress: bool,
    title: str,
) -> Path:
    """Make what is missing of a demo data set, or leave it as it is where it is complete and of these parameters.

    Each room is written elsewhere in the root and then moved to its place: what was interrupted goes on where it
    stopped, and there are no half rooms.

    Args:
        root: Folder to fill; a folder that holds anything else is refused.
        recipe: What the bytes of a room depend on; rooms of another recipe are deleted.
        counts: How many rooms there are; the rest of the marker.
        owned: Names in the root that belong to the demo.
        readme: Says that it is synthetic.
        todo: Folder of each room, and what writes it into a given folder.
        finish: Writes the lists, when all rooms are there.
        workers: Processes; the result does not depend on it.
        progress: Show a bar.
        title: Of the bar.

    Raises:
        ValueError: The folder holds files that were not made here, or ``workers`` is out of range.
    """
    if workers < 1:
        raise ValueError(f'workers: expected at least 1, got {workers}')
    wanted = {**recipe, **counts}
    found = _read_marker(root)
    if found == {**wanted, 'finished': True}:
        return root
    if found is None and root.is_dir() and any(root.iterdir()):
        raise ValueError(
            f'{root} holds files but no {MARKER}: not made here, so nothing is written; choose another folder'
        )
    if found is not None and any(found.get(key) != value for key, value in recipe.items()):
        for name in owned:
            shutil.rmtree(root / name, ignore_errors=True)
    root.mkdir(parents=True, exist_ok=True)
    write_bytes(root / 'README.txt', readme.encode('ascii'))
    write_bytes(root / MARKER, _marker_text(wanted, False))
    missing = [item for item in todo if not item[0].is_dir()]
    for _ in tqdm(_run(root / PARTIAL, missing, workers), title, len(missing), disable=not progress):
        pass
    shutil.rmtree(root / PARTIAL, ignore_errors=True)  # also what killed runs left
    finish()
    write_bytes(root / MARKER, _marker_text(wanted, True))
    return root


def _marker_text(wanted: Mapping[str, object], finished: bool) -> bytes:
    return (json.dumps({**wanted, 'finished': finished}, indent=2) + '\n').encode('ascii')


def _read_marker(root: Path) -> dict[str, object] | None:
    path = root / MARKER
    if not path.is_file():
        return None
    try:
        content = json.loads(path.read_text(encoding='utf-8'))
    except json.JSONDecodeError as error:
        raise ValueError(f'{path}: not JSON ({error}); delete {root} to make it afresh') from None
    return content if isinstance(content, dict) else None


def _run(partial: Path, todo: Sequence[tuple[Path, Callable[[Path], None]]], workers: int) -> Iterator[None]:
    if workers == 1 or len(todo) < 2:
        for folder, write in todo:
            _make_one(partial, folder, write)
            yield
        return
    from joblib import Parallel, delayed

    jobs = (delayed(_make_one)(partial, folder, write) for folder, write in todo)
    yield from Parallel(n_jobs=workers, return_as='generator')(jobs)


def _make_one(partial: Path, folder: Path, write: Callable[[Path], None]) -> None:
    half = partial / f'{folder.parent.name}_{folder.name}.{os.getpid()}'
    shutil.rmtree(half, ignore_errors=True)
    half.mkdir(parents=True)
    write(half)
    folder.parent.mkdir(parents=True, exist_ok=True)
    os.replace(half, folder)
