"""PTS and PTX, the text formats of terrestrial scanners: one or several scans in a file, each behind its own header.

PTS: a line with the number of points, then ``x y z [intensity] [red green blue]`` of each. PTX: the numbers of columns
and rows, the scanner's place and axes, a transform, then ``x y z intensity [red green blue]`` of each cell in the
scanner's frame, zeros where nothing came back.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from rm3d_plugin.storage.text_columns import plain_text, without_decimal_commas
from rm3d_plugin.storage.text_table import BadTextError, parse_table
from rm3d_plugin.structures import SceneError

PARTS = {
    3: 'x y z',
    4: 'x y z intensity',
    6: 'x y z red green blue',
    7: 'x y z intensity red green blue',
}
"""What a row of either holds, by its numbers."""
_SHORT = 8  # letters; a line of more is taken as not empty
_PTX_HEADER = (1, 1, 3, 3, 3, 3, 4, 4, 4, 4)  # numbers in its lines


class _PtxScan(NamedTuple):
    """One scan of a PTX file: where the scanner stood, its (4, 4) transform for rows (x, y, z, 1), and its points."""

    place: Float[np.ndarray, '3']
    transform: Float[np.ndarray, '4 4']
    rows: Float[np.ndarray, 'points columns']


def read_pts(path: str | Path) -> dict[str, np.ndarray]:
    """Columns of a PTS file, all scans together; intensities as they are.

    Raises:
        SceneError: A line is no row of numbers, or there are more or fewer than announced.
    """
    path = Path(path)
    lines, at = _Lines(path), 0
    tables: list[np.ndarray] = []
    while at < len(lines):
        words = lines.words(at)
        announced = len(words) == 1
        if not announced and tables:
            raise SceneError(
                f'{path}, line {lines.line_number(at)}: more points than announced; correct the number before them'
            )
        count = lines.whole(at, 0) if announced else len(lines)
        at += announced
        stop = at + count if announced else count
        tables.append(lines.table(at, stop))
        at = stop
    return _columns(path, tables)


def read_ptx(path: str | Path) -> dict[str, np.ndarray]:
    """Columns of a PTX file, all scans together, moved by their transforms; cells of zeros are no points.

    Raises:
        SceneError: A header is incomplete, a line is no row of numbers, or there are fewer than announced.
    """
    return _columns(Path(path), [_placed(scan) for scan in _ptx_scans(Path(path))])


def ptx_sensor(path: str | Path) -> tuple[float, float, float] | None:
    """Where the scanner stood, in the frame of :func:`read_ptx`; None where several scans make the file."""
    lines = _Lines(Path(path))
    if len(lines) > len(_PTX_HEADER) + lines.whole(0, 0) * lines.whole(1, 0):
        return None
    x, y, z = lines.numbers(2, 3).tolist()
    return x, y, z


def _ptx_scans(path: Path) -> Iterator[_PtxScan]:
    lines, at = _Lines(path), 0
    while at < len(lines):
        header = [lines.numbers(at + i, count) for i, count in enumerate(_PTX_HEADER)]
        if (header[6][3], header[7][3], header[8][3], header[9][3]) != (0, 0, 0, 1):
            raise SceneError(
                f'{path}, line {at + 7}: the last column of the transform is not 0 0 0 1; expected its translation '
                'in the fourth line: transpose it'
            )
        turn = np.stack(header[6:9])[:, :3]
        if abs(np.linalg.det(turn)) < 1e-6:
            raise SceneError(
                f'{path}, line {at + 7}: the transform puts all points into a plane; correct its first lines'
            )
        at += len(_PTX_HEADER)
        cells = lines.whole(at - 10, 0) * lines.whole(at - 9, 0)
        yield _PtxScan(header[2], np.stack(header[6:]), lines.table(at, at + cells))
        at += cells


def _placed(scan: _PtxScan) -> Float[np.ndarray, 'points columns']:
    """The points of a scan, moved by its transform."""
    rows = scan.rows[scan.rows[:, :3].any(axis=1)]
    return np.concatenate([rows[:, :3] @ scan.transform[:3, :3] + scan.transform[3, :3], rows[:, 3:]], axis=1)


def _columns(path: Path, tables: list[np.ndarray]) -> dict[str, np.ndarray]:
    """The rows of all scans, which must hold the same, by name."""
    widths = sorted({table.shape[1] for table in tables if len(table)})
    if not widths:
        raise SceneError(f'{path}: holds no points')
    if len(widths) > 1 or widths[0] not in PARTS:
        raise SceneError(
            f'{path}: rows of {widths} numbers; expected one of {sorted(PARTS)}: x y z [intensity] [r g b]'
        )
    table = np.concatenate([table for table in tables if len(table)])
    return {name: table[:, i] for i, name in enumerate(PARTS[widths[0]].split())}


class _Lines:
    """The lines of a text that are neither empty nor a remark behind ``#`` or ``//``."""

    def __init__(self, path: Path) -> None:
        self.path, self.text = path, plain_text(path.read_bytes()).rstrip() + b'\n'
        self.ends = np.flatnonzero(np.frombuffer(self.text, dtype=np.uint8) == ord('\n'))
        self.starts = np.concatenate([[0], self.ends[:-1] + 1])
        kept = self.ends - self.starts > _SHORT
        for line in np.flatnonzero(~kept):
            kept[line] = bool(self.text[self.starts[line] : self.ends[line]].strip())
        marks = np.flatnonzero(np.isin(np.frombuffer(self.text, dtype=np.uint8), [ord('#'), ord('/')]))
        for line in np.unique(np.searchsorted(self.ends, marks)):
            remark = self.text[self.starts[line] : self.ends[line]].lstrip().startswith((b'#', b'//'))
            kept[line] &= not remark
        self.starts, self.ends = self.starts[kept], self.ends[kept]

    def __len__(self) -> int:
        return len(self.ends)

    def line_number(self, line: int) -> int:
        """As an editor counts, from 1."""
        return self.text.count(b'\n', 0, int(self.starts[line])) + 1 if line < len(self) else len(self) + 1

    def words(self, line: int) -> list[bytes]:
        """Words of a line; none behind the last."""
        return self.text[self.starts[line] : self.ends[line]].split() if line < len(self) else []

    def numbers(self, line: int, count: int) -> Float[np.ndarray, ' numbers']:
        """The numbers of a header line."""
        where = f'{self.path}, line {self.line_number(line)}'
        words = without_decimal_commas(b' '.join(self.words(line)) + b'\n', where).split()
        try:
            numbers = np.array([float(word) for word in words])
            if len(words) == count and np.isfinite(numbers).all():
                return numbers
        except ValueError:
            pass
        raise SceneError(f'{where}: expected {count} numbers of a header, got {self._shown(line)}')

    def whole(self, line: int, least: int) -> int:
        """The one whole number of a header line."""
        value = float(self.numbers(line, 1)[0])
        if not (least <= value < 2**53 and value == int(value)):
            raise SceneError(
                f'{self.path}, line {self.line_number(line)}: expected how many there are, got {self._shown(line)}'
            )
        return int(value)

    def _shown(self, line: int) -> str:
        return repr(b' '.join(self.words(line))[:60].decode('ascii', errors='backslashreplace'))

    def table(self, start: int, stop: int) -> Float[np.ndarray, 'rows columns']:
        """Rows of numbers in lines ``start`` to ``stop``."""
        if stop > len(self):
            raise SceneError(f'{self.path}: {len(self) - start} points, but {stop - start} are announced; cut off?')
        if start == stop:
            return np.zeros((0, 3))
        text = self.text[self.starts[start] : self.ends[stop - 1] + 1]
        text = without_decimal_commas(text, f'{self.path}, line {self.line_number(start)}')
        try:
            table = parse_table(text)
        except BadTextError as error:
            line, shown = (
                error.line + self.line_number(start) - 1,
                error.content[:80].decode('ascii', 'backslashreplace'),
            )
            told = f'line {line}: {error.reason}: {shown!r}'
            raise SceneError(f'{self.path}, {told}; expected numbers, one point a line') from error
        if len(table) != stop - start:
            raise SceneError(f'{self.path}: {len(table)} points in lines {start + 1} to {stop}; comments?')
        return table
