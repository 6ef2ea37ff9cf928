"""Numbers from text, fast: hundreds of megabytes of ``x y z r g b`` lines.

A number of up to 15 digits is read by machine code and equals Python's ``float`` bit for bit; what is longer, and
``nan`` and ``inf``, goes through ``float`` itself.
"""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: ANN001, ANN202
import re

import numpy as np
from jaxtyping import Float
from numba import njit

from rm3d_plugin.structures import SceneError

POWERS = 10.0 ** np.arange(23)  # these are exact in float64
_NEWLINE, _RETURN, _HASH, _SLASH = 10, 13, 35, 47
_BLANK = np.zeros(256, dtype=np.bool_)
_BLANK[[32, 9, _RETURN, 44, 59]] = True  # space, tab, end of line, comma, semicolon
_FORTRAN = re.compile(rb'(\d\.?)[dD]([+-]?\d+)$')  # its exponents
_COMMAS = bytes.maketrans(b',;', b'  ')


class BadTextError(SceneError):
    """A line that is no row of numbers.

    Attributes:
        line: Number of the line in the text, from 1.
        content: The line.
        reason: What is wrong with it.
    """

    def __init__(self, line: int, content: bytes, reason: str) -> None:
        self.line, self.content, self.reason = line, content, reason
        super().__init__(f'line {line}: {reason}: {content[:80].decode("ascii", errors="backslashreplace")!r}')


def parse_table(text: bytes, columns: int | None = None, separator: str = '') -> Float[np.ndarray, 'rows columns']:
    r"""Rows of numbers, split by blanks, tabs, commas or semicolons.

    Empty lines, and lines that begin with ``#`` or ``//``, are passed over.

    Args:
        text: Lines of ASCII.
        columns: Numbers in each row; None: as many as the first row has.
        separator: The only letter that splits cells, so that an empty one is NaN; '': any number of any of them.

    Returns:
        (rows, columns) float64; (0, columns or 0) where there is no row.

    Raises:
        BadTextError: A line has another count of numbers, or holds something else; it tells which line.

    >>> parse_table(b'# x y\n1 2.5\n\n-3e2, 4\n')
    array([[   1. ,    2.5],
           [-300. ,    4. ]])
    """
    data = np.frombuffer(text, dtype=np.uint8)
    blank, sep = _BLANK & (np.arange(256) <= 32) if separator else _BLANK, ord(separator) if separator else -1
    if sep >= 0:
        blank[sep] = False
    rows, found = _shape(data, blank, sep)
    width = found if columns is None else columns
    if rows and width != found:
        raise _bad_line(text, int(_first_row(data, blank)), f'{found} numbers, expected {width}')
    out = np.empty((rows, width))
    if rows == 0:
        return out
    spans = np.empty((max(1024, width), 4), dtype=np.int64)
    start, row = 0, 0
    while row < rows:
        start, row, slow, bad = _fill(data, start, row, out, spans, blank, sep, POWERS)
        _read_slowly(text, spans[:slow], out)
        if bad >= 0:
            line = text[bad:].split(b'\n', 1)[0].strip()
            words = line.split(separator.encode()) if separator else line.translate(_COMMAS).split()
            two_in_one = len(words) == width
            raise _bad_line(
                text, bad, 'two words in one cell' if two_in_one else f'{len(words)} numbers, expected {width}'
            )
    return out


def _read_slowly(text: bytes, spans: np.ndarray, out: np.ndarray) -> None:
    for begin, end, row, column in spans.tolist():
        try:
            if b'_' in text[begin:end]:  # Python's float takes 1_000
                raise ValueError
            out[row, column] = float(text[begin:end])
        except ValueError:
            changed = _FORTRAN.sub(rb'\1e\2', text[begin:end])
            if changed != text[begin:end]:
                out[row, column] = float(changed)
                continue
            word = text[begin:end].decode('ascii', errors='backslashreplace')
            raise _bad_line(text, begin, f'{word!r} is not a number') from None


def _bad_line(text: bytes, at: int, reason: str) -> BadTextError:
    begin = text.rfind(b'\n', 0, at) + 1
    content = text[begin:].split(b'\n', 1)[0].rstrip(b'\r')
    return BadTextError(text.count(b'\n', 0, begin) + 1, content, reason)


@njit(cache=True)
def _first(data, i, blank):
    """Where the first number of the line at ``i`` stands; its end of line where there is none."""
    n = len(data)
    while i < n and blank[data[i]]:
        i += 1
    if i < n and (data[i] == _HASH or (data[i] == _SLASH and i + 1 < n and data[i + 1] == _SLASH)):
        while i < n and data[i] != _NEWLINE:
            i += 1
    return i


@njit(cache=True)
def _first_row(data, blank):
    """Where the first number of the first row stands."""
    i = _first(data, 0, blank)
    while i < len(data) and data[i] == _NEWLINE:
        i = _first(data, i + 1, blank)
    return i


@njit(cache=True)
def _shape(data, blank, sep):
    """Lines that are not empty, and the numbers in the first of them; with a separator, the cells."""
    n, i, rows, width = len(data), 0, 0, 0
    while i < n:
        i = _first(data, i, blank)
        if i < n and data[i] != _NEWLINE:
            rows += 1
            inside = False
            while i < n and data[i] != _NEWLINE:
                if rows == 1 and sep >= 0:
                    width += data[i] == sep
                elif rows == 1 and not blank[data[i]] and not inside:
                    width += 1
                inside = not blank[data[i]]
                i += 1
            width += rows == 1 and sep >= 0
        i += 1
    return rows, width


@njit(cache=True)
def _number(data, i, end, powers):
    """The value of data[i:end] and True, or False where it must be read slowly."""
    negative = data[i] == 45
    if data[i] == 45 or data[i] == 43:
        i += 1
    mantissa, digits, point, exponent, any_digit = np.int64(0), 0, -1, 0, False
    while i < end and (48 <= data[i] <= 57 or (data[i] == 46 and point < 0)):
        if data[i] == 46:
            point = 0
        else:
            any_digit = True
            mantissa = mantissa * 10 + (data[i] - 48)
            digits += mantissa > 0
            point += point >= 0
            if digits > 15:
                return 0.0, False
        i += 1
    if not any_digit:
        return 0.0, False
    if i < end and (data[i] == 101 or data[i] == 69):
        i += 1
        minus = i < end and data[i] == 45
        if i < end and (data[i] == 45 or data[i] == 43):
            i += 1
        if i >= end or end - i > 3:
            return 0.0, False
        while i < end and 48 <= data[i] <= 57:
            exponent = exponent * 10 + (data[i] - 48)
            i += 1
        exponent = -exponent if minus else exponent
    exponent -= max(point, 0)
    if i < end or abs(exponent) > 22:
        return 0.0, False
    value = float(mantissa)
    value = value * powers[exponent] if exponent >= 0 else value / powers[-exponent]
    return (-value if negative else value), True


@njit(cache=True)
def _fill(data, i, row, out, spans, blank, sep, powers):
    """Fill rows from the line at ``i`` on, until ``spans`` (numbers to be read slowly) could overflow."""
    n, slow, width = len(data), 0, out.shape[1]
    while row < len(out) and slow + width <= len(spans):
        i = _first(data, i, blank)
        if i >= n or data[i] == _NEWLINE:
            i += 1
            continue
        begin, column = i, 0
        while True:
            end = i
            while end < n and data[end] != _NEWLINE and not blank[data[end]] and data[end] != sep:
                end += 1
            if column >= width:
                return i, row, slow, begin
            value, quick = (np.nan, True) if end == i else _number(data, i, end, powers)
            out[row, column] = value
            if not quick:
                spans[slow, 0], spans[slow, 1], spans[slow, 2], spans[slow, 3] = i, end, row, column
                slow += 1
            column += 1
            i = end
            while i < n and blank[data[i]]:
                i += 1
            if i >= n or data[i] == _NEWLINE:
                break
            if sep >= 0:
                if data[i] != sep:
                    return i, row, slow, begin
                i += 1
                while i < n and blank[data[i]]:
                    i += 1
        if column != width:
            return i, row, slow, begin
        row += 1
        i += 1
    return i, row, slow, -1
