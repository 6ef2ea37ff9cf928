"""Tables of the Waymo Open Dataset, perception v2: parquet files, one a segment and component.

Needs pyarrow, the extra ``waymo``.
"""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from rm3d_plugin.structures import SceneError

SEGMENT, TIME, LASER = 'key.segment_context_name', 'key.frame_timestamp_micros', 'key.laser_name'
_ROWS_AT_ONCE = 16  # a range image of the top laser is 2.7 MB


def parquet() -> Any:
    """The module pyarrow.parquet.

    Raises:
        SceneError: It is not installed.
    """
    try:
        import pyarrow.parquet
    except ImportError:
        raise SceneError("Waymo's parquet files need pyarrow: pip install 'rm3d_plugin[waymo]'") from None
    return pyarrow.parquet


@lru_cache(maxsize=256)
def _times(path: Path, stamp: tuple[int, int]) -> Int[np.ndarray, ' rows']:
    column = _open(path).read(columns=[TIME]).column(TIME)
    if column.null_count or not str(column.type).startswith(('int', 'uint')):
        raise SceneError(f'{path}: {TIME}: expected whole microseconds, got {column.type}, {column.null_count} empty')
    return np.asarray(column.to_numpy(), dtype=np.int64)


@lru_cache(maxsize=256)
def _segments(path: Path, stamp: tuple[int, int]) -> frozenset[str]:
    """Segments that the rows of a file are about."""
    return frozenset(map(str, _open(path).read(columns=[SEGMENT]).column(SEGMENT).unique().to_pylist()))


def _stamp(path: Path) -> tuple[int, int]:
    state = path.stat()
    return state.st_mtime_ns, state.st_size


def _open(path: Path) -> Any:
    if not path.is_file():
        component, segment = path.parent.name, path.stem
        raise SceneError(
            f'{path}: no such file; segment {segment} lacks the component {component!r}: download it, or take the '
            'segment off the list'
        )
    try:
        return parquet().ParquetFile(path)
    except Exception as error:  # pyarrow raises errors of its own for every kind of damage
        raise SceneError(f'{path}: not a parquet file ({error}); download it again') from error


def frame_times(path: Path) -> Int[np.ndarray, ' rows']:
    """Time of each row of a file, microseconds.

    Raises:
        SceneError: The file is missing, damaged, or has no such column.
    """
    if path.is_file():
        _check_columns(_open(path), (TIME,), path)
    else:
        _open(path)  # tells what is missing
    return _times(path, _stamp(path))


def _check_columns(file: Any, columns: Sequence[str], path: Path) -> None:
    there = set(file.schema_arrow.names)
    if missing := [name for name in columns if name not in there]:
        raise SceneError(
            f'{path}: no column {missing[0]!r}; expected perception v2 of the Waymo Open Dataset, got '
            f'{", ".join(sorted(there)[:6])} ...'
        )


def read_rows(path: Path, columns: Sequence[str], time: int | None = None) -> dict[str, list[Any]]:
    """Columns of the rows of one frame, or of all rows.

    Args:
        path: ``SPLIT/COMPONENT/SEGMENT.parquet``.
        columns: Their names.
        time: Microseconds; None: every row.

    Raises:
        SceneError: The file or a column is missing.
    """
    file = _open(path)
    _check_columns(file, (SEGMENT, *columns), path)
    if strangers := sorted(_segments(path, _stamp(path)) - {path.stem}):
        raise SceneError(f'{path}: its rows are of segment {strangers[0]}; download the file again, and keep its name')
    if time is None:
        return file.read(columns=list(columns)).to_pydict()
    wanted = np.flatnonzero(frame_times(path) == time)
    found: dict[str, list[Any]] = {name: [] for name in columns}
    ends = np.cumsum([file.metadata.row_group(g).num_rows for g in range(file.metadata.num_row_groups)])
    groups = np.unique(np.searchsorted(ends, wanted, side='right'))
    for group in groups.tolist():
        first = 0 if group == 0 else int(ends[group - 1])
        for batch in file.iter_batches(_ROWS_AT_ONCE, row_groups=[group], columns=list(columns)):
            here = wanted[(wanted >= first) & (wanted < first + len(batch))] - first
            for name in columns if len(here) else ():
                found[name] += [batch.column(name)[row] for row in here.tolist()]
            first += len(batch)
    return found
