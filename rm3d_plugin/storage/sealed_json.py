"""JSON with its own hash: records that a run cannot make again."""

import hashlib
import json
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rm3d_plugin.storage.files import DamagedFileError, content_of, plain_json, read_json, write_bytes, write_json

SEAL = 'sha256'


def write_sealed(path: str | Path, content: Mapping[str, Any], keep_previous: bool = False) -> Path:
    """Write a mapping as JSON with its hash, atomically.

    Args:
        path: The file.
        content: What :func:`rm3d_plugin.storage.files.write_json` can write.
        keep_previous: Keep the version before it, if it is whole, as ``NAME.previous.json``.

    Returns:
        The path.

    Raises:
        ValueError: The mapping uses the name of the hash itself.
    """
    path, plain = Path(path), plain_json(content)
    if SEAL in plain:
        raise ValueError(f'{path}: {SEAL!r} cannot name a value, it names the hash')
    if keep_previous and path.is_file() and _damage(path) is None:
        write_bytes(_previous(path), path.read_bytes())
    return write_json(path, {**plain, SEAL: _seal(plain)})


def read_sealed(path: str | Path) -> dict[str, Any]:
    """Read what :func:`write_sealed` wrote, without the hash; a file without one, of an older version, is taken too.

    Raises:
        FileNotFoundError: There is no such file.
        DamagedFileError: It is damaged, and so is the version before it, or there is none.

    Warns:
        UserWarning: It is damaged, and the version before it was read.
    """
    path = Path(path)
    damage = _damage(path)
    if damage is None:
        return _opened(path)
    if not _previous(path).is_file():
        raise damage
    warnings.warn(f'{damage}. {_previous(path).name}, the version before it, is read instead.', stacklevel=2)
    return _opened(_previous(path))


def _previous(path: Path) -> Path:
    return path.with_name(f'{path.stem}.previous{path.suffix}')


def _damage(path: Path) -> DamagedFileError | None:
    try:
        _opened(path)
    except DamagedFileError as error:
        return error
    return None


def _opened(path: Path) -> dict[str, Any]:
    content = read_json(path)
    if not isinstance(content, dict):
        raise DamagedFileError(f'{path}: expected a JSON object, got {type(content).__name__}; delete it')
    seal = content.pop(SEAL, None)
    with content_of(path, 'a record with finite numbers'):
        fits = seal is None or seal == _seal(content)
    if not fits:
        raise DamagedFileError(f'{path}: the content does not fit its {SEAL}: it was altered or damaged')
    return content


def _seal(plain: Mapping[str, Any]) -> str:
    text = json.dumps(plain, sort_keys=True, separators=(',', ':'), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
