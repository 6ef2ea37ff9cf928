"""Click files: labels that a person gave point by point, as CSV, JSON, or a log that only grows.

All three hold the same fields. CSV begins with a line that names its columns; JSON is a list of objects; for a log
(``.jsonl``) see :mod:`rm3d_plugin.storage.click_log_lines`.
"""

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rm3d_plugin.class_names import one_spelling
from rm3d_plugin.storage.click_log_lines import LOG_HEAD, log_line, log_rows
from rm3d_plugin.storage.clicks import COLUMNS, Click, ClickFileError, Line, click_from_row, row_of_click
from rm3d_plugin.storage.files import read_json, write_json, write_text
from rm3d_plugin.storage.plain_files import read_text


def read_clicks(path: str | Path, classes: Sequence[str]) -> list[Click]:
    """Read ``scene,index,class[,instance]`` or ``scene,x,y,z,class[,instance]``.

    Args:
        path: ``.json`` (a list of objects), ``.jsonl`` (a log; clicks taken back are left out), anything else is CSV
            with named columns in any order; with semicolons or tabs it may have decimal commas. Where both index and
            place are given, the place must be that of the point.
        classes: The class of a click is one of these names, or its number.

    Raises:
        ClickFileError: The file or one of its lines cannot be used; the message names both.
    """
    logged = Path(path).suffix.lower() == '.jsonl'
    return [click_from_row(where, row, classes, logged) for where, row in _rows(Path(path))]


def click_classes(path: str | Path) -> list[str]:
    """Class names of a file of clicks, sorted, each in one spelling; for a file whose classes nobody listed.

    Raises:
        ClickFileError: The file cannot be used.
    """
    return [*one_spelling(sorted({str(row['class']) for _, row in _rows(Path(path)) if row.get('class') is not None}))]


def write_clicks(path: str | Path, clicks: Sequence[Click], classes: Sequence[str]) -> None:
    """Write clicks so that :func:`read_clicks` reads them back: ``.json``, ``.jsonl``, anything else is CSV.

    Raises:
        ClickFileError: A click has a class that is not among ``classes``.
    """
    path = Path(path)
    rows = [row_of_click(click, classes) for click in clicks]
    if path.suffix.lower() == '.json':
        write_json(path, rows)
    elif path.suffix.lower() == '.jsonl':
        numbered = ({'click': number, **row} for number, row in enumerate(rows, start=1))
        write_text(path, ''.join(map(log_line, [LOG_HEAD, *numbered])))
    else:
        text = io.StringIO()
        writer = csv.DictWriter(text, COLUMNS, restval='', lineterminator='\n')
        writer.writeheader()
        writer.writerows(rows)
        write_text(path, text.getvalue())


def _rows(path: Path) -> list[Line]:
    if not path.is_file():
        raise ClickFileError(f'{path}: no such file of clicks; looked for at {path.absolute()}')
    readers = {'.json': _json_rows, '.jsonl': log_rows}
    rows = readers.get(path.suffix.lower(), _csv_rows)(path)
    if not rows:
        raise ClickFileError(f'{path}: holds no click')
    return rows


def _json_rows(path: Path) -> list[Line]:
    content = read_json(path)
    if not isinstance(content, list) or not all(isinstance(row, dict) for row in content):
        raise ClickFileError(f'{path}: expected a list of objects with scene, class and index or x, y, z')
    return [(f'{path} entry {i}', row) for i, row in enumerate(content, start=1)]


def _csv_rows(path: Path) -> list[Line]:
    text = read_text(path)
    separator = max(',;\t', key=text.partition('\n')[0].count)
    reader = csv.DictReader(io.StringIO(text), delimiter=separator, skipinitialspace=True)
    names = [name.strip().lower() for name in reader.fieldnames or ()]
    if 'scene' not in names or 'class' not in names or not ('index' in names or {'x', 'y', 'z'} <= set(names)):
        raise ClickFileError(
            f'{path}: the first line must name the columns: scene,index,class[,instance] or '
            f'scene,x,y,z,class[,instance]; got {",".join(names)!r}'
        )
    if twice := [name for name in names if name and names.count(name) > 1]:
        raise ClickFileError(f'{path}: the first line names two columns {twice[0]!r}; leave one of them')
    reader.fieldnames = names
    return [_csv_line(f'{path} line {reader.line_num}', row, separator) for row in reader]


def _csv_line(where: str, row: dict[Any, Any], separator: str) -> Line:
    """The cells by name, without blanks; places with decimal commas where these separate nothing."""
    if row.get(None):
        raise ClickFileError(f'{where}: more cells than the first line has names: {separator.join(row[None])!r}')
    cells = {name: cell.strip() for name, cell in row.items() if isinstance(cell, str)}
    if separator != ',':
        cells |= {name: cells[name].replace(',', '.') for name in 'xyz' if name in cells}
    return where, cells
