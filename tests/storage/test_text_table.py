"""Text to numbers: equal to Python's float bit for bit, and every bad line is named."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rm3d_plugin.storage.text_table import BadTextError, parse_table


def slow(text):
    rows = [line.replace(',', ' ').replace(';', ' ').split() for line in text.split('\n')]
    return [[float(word) for word in row] for row in rows if row and not row[0].startswith(('#', '//'))]


def test_comments_separators_and_empty_lines():
    text = '# x y z\n//1 2\n 1 2.5\t-3\r\n\n4,5;6\n  \n+.5, 1e2 7.\n-0 0.1 1E-3'
    table = parse_table(text.encode())
    assert table.tolist() == slow(text) == [[1, 2.5, -3], [4, 5, 6], [0.5, 100, 7], [0, 0.1, 0.001]]
    assert np.signbit(table[3, 0])


@settings(derandomize=True, max_examples=300, deadline=None)
@given(
    st.lists(st.floats(allow_nan=False), min_size=2, max_size=20), st.sampled_from(['r', '.3f', '.15e', '.6g', '.17g'])
)
def test_equals_float_bit_for_bit(values, form):
    words = [repr(v) if form == 'r' else format(v, form) for v in values]
    got = parse_table('\n'.join(words).encode(), columns=1)[:, 0]
    assert got.tobytes() == np.array([float(word) for word in words]).tobytes()


def test_many_long_numbers_and_wide_rows():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(700, 3)) * 10.0 ** rng.integers(-30, 30, size=(700, 3))
    text = '\n'.join(' '.join(map(repr, row)) for row in values.tolist())
    assert parse_table(text.encode()).tobytes() == values.tobytes()
    wide = rng.normal(size=(2, 3000))
    assert (
        parse_table('\n'.join(' '.join(map(repr, row)) for row in wide.tolist()).encode()).tobytes() == wide.tobytes()
    )


def test_exponents_as_fortran_writes_them():
    assert parse_table(b'1.5D+02 -2d0 3.D-1\n').tolist() == [[150, -2, 0.3]]
    with pytest.raises(BadTextError, match="'D2' is not a number"):
        parse_table(b'1 D2\n')


def test_nan_infinity_and_nothing():
    assert np.isnan(parse_table(b'nan 1\n')[0, 0]) and parse_table(b'-inf\n').tolist() == [[-np.inf]]
    assert parse_table(b'').shape == (0, 0) and parse_table(b'# no\n\n', columns=6).shape == (0, 6)
    assert parse_table(b'7').tolist() == [[7]]


@pytest.mark.parametrize(
    ('text', 'columns', 'line', 'reason'),
    [
        (b'1 2 3\n4 5\n', None, 2, '2 numbers, expected 3'),
        (b'1 2 3\n\n4 5 6 7\n', None, 3, '4 numbers, expected 3'),
        (b'1 2 3\n', 6, 1, '3 numbers, expected 6'),
        (b'# head\n1 2 3\n4 five 6\n', None, 3, "'five' is not a number"),
        (b'1 2 3\n1 2\x003 4\n', None, 2, r"'2\\x003' is not a number"),
        (b'1 .\n', None, 1, "'.' is not a number"),
        (b'1 1e\n', None, 1, "'1e' is not a number"),
        (b'1 --2\n', None, 1, "'--2' is not a number"),
        (b'1 1.2.3\n', None, 1, "'1.2.3' is not a number"),
    ],
)
def test_bad_lines_are_named(text, columns, line, reason):
    with pytest.raises(BadTextError, match=reason) as caught:
        parse_table(text, columns)
    assert caught.value.line == line and caught.value.content == text.split(b'\n')[line - 1]
