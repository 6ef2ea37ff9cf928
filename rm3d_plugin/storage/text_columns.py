"""Text with one point a line: which names its header gives, and how its cells are split."""

import csv
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from rm3d_plugin.storage.text_table import BadTextError, parse_table
from rm3d_plugin.structures import SceneError

_NUMBER = re.compile(r'[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(nan|inf|infinity)', re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r'[-+]?(\d+(,\d*)?|,\d+)([eE][-+]?\d+)?')
_THOUSANDS = re.compile(r'[-+]?\d{1,3}(,\d{3})+(\.\d*)?')
_COMMENT = ('#', '//')
_SHOWN = 4096  # bytes in which the first line is looked for
_LOOKED_AT = 20  # rows in which commas between thousands are looked for


class TextLayout(NamedTuple):
    """How a text is to be read.

    Attributes:
        names: Of the columns, from a header; '' = nameless, [] = there is no header.
        separator: Between two cells: ``;``, ``,``, ``|`` or a tab; '' = blanks, or any of them.
        decimal_comma: ``1,5`` is one number.
        announced: Points that a line of its own announces, or None.
        start: Where the first row begins.
    """

    names: list[str]
    separator: str
    decimal_comma: bool
    announced: int | None
    start: int


class TextTable(NamedTuple):
    """Rows of numbers; ``names`` is [] where no header names the columns."""

    names: list[str]
    values: Float[np.ndarray, 'rows columns']


def read_text_table(path: Path) -> TextTable:
    """Read a text of points: header, lines of units and a line with the count are found and passed over.

    An empty cell between two separators is NaN.

    Raises:
        SceneError: A line is no row of numbers, the header or the count does not fit the rows, or there are none.
    """
    text = plain_text(path.read_bytes())
    layout = find_layout(text)
    _check_thousands(path, text, layout)
    body = b'\n' * text.count(b'\n', 0, layout.start) + text[layout.start :]  # lines keep their numbers
    if b'"' in body:
        body = re.sub(rb'"([^"\n]*)"', lambda cell: cell[1].replace(b',', b'.'), body)
    body = body.replace(b',', b'.') if layout.decimal_comma else body
    try:
        table = parse_table(body, separator=layout.separator)
    except BadTextError as error:
        raise SceneError(f'{path}, {error}; expected numbers, one point a line') from error
    if len(table) == 0:
        raise SceneError(f'{path}: holds no points{_told_of(text)}')
    if layout.announced not in (None, len(table)):
        raise SceneError(f'{path}: {len(table)} points, but a line announces {layout.announced}; cut off?')
    if table.shape[1] == len(layout.names) + 1 or not layout.names:
        table = _without_empty_end(table)
    _check_header(path, layout, table.shape[1])
    return TextTable(layout.names, table)


def find_layout(text: bytes) -> TextLayout:
    r"""Look at the lines before the first row, and at the row itself.

    >>> find_layout(b'//X;Y;Z;Scalar field\n1;2;3;4\n').names
    ['X', 'Y', 'Z', 'Scalar field']
    """
    names: list[str] = []
    header_separator, count, at = '', None, 0
    while at < len(text):
        end = text.find(b'\n', at) + 1 or len(text)
        line = text[at:end].decode('utf-8', errors='replace').strip(' \r\n')
        said = line.lstrip('#/ ').rpartition(': ')[2] if line.startswith(_COMMENT) else line  # 'columns: x y z'
        words, separator = split_cells(said)
        numbers = [_is_number(word) for word in words if word]
        if line.startswith(_COMMENT):
            if names_points(words):
                names, header_separator = words, separator
        elif len(numbers) == 1 and words[0].isdecimal() and count is None:
            count = int(words[0])
        elif any(numbers):
            separator, decimal_comma = _row_separator(line, header_separator)
            return TextLayout(names, separator, decimal_comma, count, at)
        elif line and not names:
            names, header_separator = words, separator
        at = end  # what else comes before the first number is a line of units
    return TextLayout(names, '', False, None, len(text))


def split_cells(line: str) -> tuple[list[str], str]:
    """Cells of a line without their quotes, and what separates them ('' = blanks)."""
    bare = re.sub(r'"[^"]*"', '', line)
    separator = next((letter for letter in ';\t,|' if letter in bare), '')
    if not separator:
        return [quoted or plain for quoted, plain in re.findall(r'"([^"]*)"|(\S+)', line)], ''
    cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    return [cell.strip(' "\'') for cell in cells], separator


def names_points(words: list[str]) -> bool:
    """Whether x, y and z are among the words."""
    return {*'xyz'} <= {plain_name(word) for word in words}


def plain_name(name: str) -> str:
    """A column's name in small letters, without the unit behind it and ``scalar_`` before it.

    >>> plain_name('X [m]'), plain_name('scalar_Intensity')
    ('x', 'intensity')
    """
    name = re.sub(r'\s*[\[(].*[\])]$', '', name.strip()).lower()
    return re.sub(r'^scalar[_ ]', '', name)


def _row_separator(line: str, header_separator: str) -> tuple[str, bool]:
    """What separates the cells of a row, and whether their comma is a decimal one."""
    words = line.split(';' if ';' in line else None)
    if ',' in line and len(words) >= 3 and all(_DECIMAL_COMMA.fullmatch(word.strip()) for word in words if word):
        return ';' if ';' in line else header_separator.replace(',', ''), True
    separator = next((letter for letter in ';,|' if letter in line), '')
    if not separator and '\t' in line:
        separator = header_separator
    mixed = any(len(cell.split()) > 1 for cell in line.split(separator or None))
    return '' if mixed or separator not in line else separator, False


def _check_thousands(path: Path, text: bytes, layout: TextLayout) -> None:
    """Whether commas in the first rows part thousands: ``412,345.67 5,123,456.78 120.5``.

    Behind places ``100,200,250`` are red, green and blue.

    Raises:
        SceneError: Every word is a number, and places have such commas, or a number with a point behind them.
    """
    lines = text[layout.start : layout.start + _SHOWN].decode('utf-8', errors='replace').splitlines()[:_LOOKED_AT]
    rows = [[word.strip() for word in line.split(layout.separator or None)] for line in lines if line.strip()]
    if layout.decimal_comma or not all(_of_numbers(row) for row in rows[:1]):
        return
    grouped = [word for word in (rows[0] if rows else ()) if _THOUSANDS.fullmatch(word) and '.' in word]
    if not grouped and rows and all(any(map(_THOUSANDS.fullmatch, row[:3])) for row in rows):
        grouped = [word for word in rows[0][:3] if _THOUSANDS.fullmatch(word)]
    if grouped:
        number = text.count(b'\n', 0, layout.start) + 1
        raise SceneError(
            f'{path}, line {number}: {grouped[0]!r} seems to have commas between thousands; export it without'
        )


def without_decimal_commas(text: bytes, where: str) -> bytes:
    """Rows of numbers without names, with points for decimal commas: ``1,5 2,5 3,5``.

    Args:
        text: The rows; the first tells how the others are written.
        where: File and line of the first, for messages.

    Raises:
        SceneError: Commas stand between thousands.
    """
    first = text[: text.find(b'\n') + 1].decode('utf-8', errors='replace').strip()
    _, decimal_comma = _row_separator(first, '')
    thousands = [word for word in first.split() if _THOUSANDS.fullmatch(word) and '.' in word]
    if thousands and not decimal_comma and len(first.split()) > 1:
        raise SceneError(f'{where}: {thousands[0]!r} seems to have commas between thousands; export it without')
    return text.replace(b',', b'.') if decimal_comma else text


def _of_numbers(words: list[str]) -> bool:
    return all(_THOUSANDS.fullmatch(word) or _NUMBER.fullmatch(word) for word in words if word)


def _is_number(word: str) -> bool:
    return bool(_NUMBER.fullmatch(word) or _DECIMAL_COMMA.fullmatch(word))


def plain_text(data: bytes) -> bytes:
    """UTF-8 without a mark at its beginning, every line ends with a line feed."""
    if data.startswith((b'\xff\xfe', b'\xfe\xff')):
        data = data.decode('utf-16', errors='replace').encode()
    data = data.removeprefix(b'\xef\xbb\xbf')
    return data.replace(b'\r\n', b'\n').replace(b'\r', b'\n') if b'\r' in data else data


def _told_of(text: bytes) -> str:
    """What stands in a text without a row of numbers."""
    lines = [line.strip() for line in text[:_SHOWN].splitlines() if line.strip()]
    first = lines[0][:60].decode('utf-8', errors='replace') if lines else ''
    return f'; no line holds numbers split by blanks, commas, semicolons, tabs or |, the first is {first!r}' * bool(
        first
    )


def _without_empty_end(table: np.ndarray) -> np.ndarray:
    """The table without the column behind a separator at the end of every line."""
    return table[:, :-1] if table.shape[1] > 1 and np.isnan(table[:, -1]).all() else table


def _check_header(path: Path, layout: TextLayout, width: int) -> None:
    if not layout.names:
        return
    if len(layout.names) != width:
        hint = '; decimal commas? separate the cells by ;' if width == 2 * len(layout.names) else ''
        raise SceneError(
            f'{path}: the header names {len(layout.names)} columns ({" ".join(layout.names[:12])}), '
            f'but a row has {width}; correct the header{hint}'
        )
    twice = [name for name in layout.names if name and layout.names.count(name) > 1]
    if twice:
        raise SceneError(f'{path}: the header names two columns {twice[0]!r}; give each a name of its own')
