"""What a measured table has measured already, so that it goes on where it was stopped."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from rm3d_plugin.experiments.spec import Request
from rm3d_plugin.storage import read_json, write_json
from rm3d_plugin.storage.files import plain_json
from rm3d_plugin.storage.fingerprint import Fingerprinted

AnyRow = TypeVar('AnyRow', bound=tuple[Any, ...])


def kept_rows(
    path: Path, asked: Mapping[str, Any], kind: Callable[..., AnyRow], measure: Callable[[], list[AnyRow]]
) -> list[AnyRow]:
    """Rows of a file where they were measured as asked, else measured anew and written.

    Args:
        path: The JSON file.
        asked: All that the rows depend on, as plain values.
        kind: Of a row; its fields are plain values.
        measure: Makes the rows.
    """
    plain = plain_json(asked)
    content = read_json(path) if path.is_file() else {}
    if content.get('asked') == plain:
        return [kind(*(math.nan if value is None else value for value in row)) for row in content['rows']]
    rows = measure()
    write_json(path, {'asked': plain, 'rows': [list(row) for row in rows]})
    return rows


def descriptor_asked(request: Request, part: Fingerprinted) -> dict[str, Any]:
    """What rows of one descriptor depend on: scenes, points, seed, and its settings and weights."""
    return {
        'scenes': request.scenes,
        'points': request.points,
        'seed': request.seed,
        'descriptor': part.fingerprint(),
    }
