"""Semantic3D's text files, read in pieces: up to 10^8 lines ``x y z intensity r g b``, and ``.labels`` beside them."""

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.datasets.downsampled import VoxelThinner
from rm3d_plugin.storage.scans import has_place
from rm3d_plugin.storage.signatures import check_signature
from rm3d_plugin.storage.text_table import BadTextError, parse_table
from rm3d_plugin.structures import UNLABELLED, SceneError

CLASSES = (
    'man-made terrain', 'natural terrain', 'high vegetation', 'low vegetation', 'buildings', 'hard scape',
    'scanning artefacts', 'cars',
)  # fmt: skip
NUM_IDS = len(CLASSES) + 1  # id 0 is unlabelled, id k is class k - 1
COLUMNS = 'x y z intensity r g b'
CHUNK = 16 << 20  # bytes of text at a time; larger: faster, more memory
LEAST, GREATEST = -2048.0, 2047.0  # intensities are signed numbers of 12 bits


class ThinScene(NamedTuple):
    """A thinned scene.

    Attributes:
        xyz: (n, 3) float64 metres: the first point of each voxel, in the order of the file.
        colors: (n, 3) float32 in [0, 1], of that point.
        intensity: (n,) float32 in [0, 1], of that point.
        semantic: (n,) int64 class that most labelled points of the voxel have, ties to the lowest; -1 where none is
            labelled. Empty where there is no label file.
        num_points: Lines of the file.
    """

    xyz: Float[np.ndarray, 'points 3']
    colors: Float[np.ndarray, 'points 3']
    intensity: Float[np.ndarray, ' points']
    semantic: Int[np.ndarray, ' labels']
    num_points: int


class Votes:
    """How many points of each label id fall into each row; grows with the rows."""

    def __init__(self) -> None:
        self._count = np.zeros((1024, NUM_IDS), dtype=np.int32)

    def add(self, rows: Int[np.ndarray, ' points'], ids: Int[np.ndarray, ' points'], num_rows: int) -> None:
        """Count points."""
        if num_rows > len(self._count):
            grown = np.zeros((max(num_rows, 2 * len(self._count)), NUM_IDS), dtype=np.int32)
            grown[: len(self._count)] = self._count
            self._count = grown
        cells, count = np.unique(rows * NUM_IDS + ids, return_counts=True)
        self._count.reshape(-1)[cells] += count.astype(np.int32)

    def classes(self, num_rows: int) -> Int[np.ndarray, ' rows']:
        """The class with most votes; unlabelled points have no say."""
        count = self._count[:num_rows, 1:]
        return np.where(count.max(axis=1) > 0, count.argmax(axis=1), UNLABELLED).astype(np.int64)


def thin_scene(
    points: str | Path,
    labels: str | Path | None,
    voxel: float,
    keep_rows: Callable[[Int[np.ndarray, ' points']], object] | None = None,
    chunk: int = CHUNK,
) -> ThinScene:
    """Read a scene piece by piece and keep the first point of each voxel.

    Memory grows with the points kept, not with the file.

    Args:
        points: The ``.txt`` file.
        labels: The ``.labels`` file, or None.
        voxel: Edge of a voxel, metres.
        keep_rows: Receives, piece by piece, the row of the kept point that stands for each line.
        chunk: Bytes of text at a time.

    Raises:
        SceneError: A file is missing, empty or cut off, a line is no row of numbers, the files have different numbers
            of lines, or a label is unknown.
    """
    thinner, votes, num_points = VoxelThinner(voxel), Votes(), 0
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    ids = None if labels is None else LabelLines(labels, chunk)
    for table in read_chunks(points, 7, COLUMNS, chunk):
        _check(table, points, num_points)
        try:
            thin = thinner.add(table[:, :3])
        except ValueError as error:
            raise SceneError(f'{points}: {error}') from None
        if ids is not None:
            votes.add(thin.rows, ids.take(len(table), points), len(thinner))
        if keep_rows is not None:
            keep_rows(thin.rows)
        kept = table[thin.kept]
        parts.append((kept[:, :3], _unit(kept[:, 4:], 0.0, 255.0), _unit(kept[:, 3], LEAST, GREATEST)))
        num_points += len(table)
    if num_points == 0:
        raise SceneError(f'{points}: holds no points')
    semantic = np.zeros(0, dtype=np.int64)
    if ids is not None:
        ids.finish(num_points, points)
        semantic = votes.classes(len(thinner))
    xyz, colors, intensity = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return ThinScene(xyz, colors, intensity, semantic, num_points)


def read_chunks(path: str | Path, columns: int, what: str, chunk: int = CHUNK) -> Iterator[Float[np.ndarray, '_r c']]:
    """The rows of a text file, some megabytes of text at a time.

    Args:
        path: The file.
        columns: Numbers on each line.
        what: Names of the columns, for errors.
        chunk: Bytes of text at a time.

    Raises:
        SceneError: The file is missing, or a line is not such a row; the line is told.
    """
    path = Path(path)
    if not path.is_file():
        raise SceneError(f'{path}: no such file; expected lines of {what}')
    check_signature(path)
    lines = 0
    with path.open('rb') as file:
        while text := _whole_lines(file, chunk):
            text = text if lines else text.removeprefix(b'\xef\xbb\xbf')
            try:
                yield parse_table(text, columns)
            except BadTextError as error:
                raise SceneError(
                    f'{path}, line {lines + error.line}: {error.reason}; expected {what}. Cut off? unpack it again'
                ) from None
            lines += text.count(b'\n')


def _whole_lines(file: IO[bytes], chunk: int) -> bytes:
    return file.read(chunk) + file.readline()


class LabelLines:
    """A ``.labels`` file, one id a line, handed out in the portions that its points are read in."""

    def __init__(self, path: str | Path, chunk: int = CHUNK) -> None:
        self.path = Path(path)
        self._chunks = read_chunks(self.path, 1, 'one label', chunk // 8)
        self._rest = np.zeros(0, dtype=np.int64)
        self._taken = 0

    def take(self, number: int, points: str | Path) -> Int[np.ndarray, ' points']:
        """The next labels.

        Raises:
            SceneError: There are fewer, or an id is unknown.
        """
        portion = [self._rest]
        while sum(map(len, portion)) < number and (table := next(self._chunks, None)) is not None:
            portion.append(self._checked(table[:, 0]))
        found = np.concatenate(portion)
        if len(found) < number:
            raise SceneError(
                f'{self.path}: {self._taken + len(found)} labels, but {points} has more points; unpack both again'
            )
        self._rest = found[number:]
        self._taken += number
        return found[:number]

    def finish(self, num_points: int, points: str | Path) -> None:
        """Check that nothing is left.

        Raises:
            SceneError: There are more labels than points.
        """
        left = len(self._rest) + sum(len(table) for table in self._chunks)
        if left:
            raise SceneError(f'{self.path}: {num_points + left} labels, but {points} has {num_points} points')

    def _checked(self, values: Float[np.ndarray, ' labels']) -> Int[np.ndarray, ' labels']:
        strange = ~np.isin(values, np.arange(NUM_IDS))
        if strange.any():
            ids, count = np.unique(values[strange], return_counts=True)
            found = ', '.join(f'{i:g} ({n} points)' for i, n in zip(ids.tolist(), count.tolist(), strict=True))
            raise SceneError(f'{self.path}: unknown labels {found}; Semantic3D has 0 (unlabelled) to {NUM_IDS - 1}')
        return values.astype(np.int64)


def _unit(values: Float[np.ndarray, '...'], low: float, high: float) -> Float[np.ndarray, '...']:
    return np.clip((values - low) / (high - low), 0.0, 1.0).astype(np.float32)


def _check(table: Float[np.ndarray, 'rows 7'], path: str | Path, before: int) -> None:
    bad = np.flatnonzero(~(np.isfinite(table).all(axis=1) & has_place(table[:, :3])))
    if len(bad):
        raise SceneError(f'{path}: point {before + int(bad[0]) + 1} holds NaN or an infinite number; drop it first')
    if len(table) and not (table[:, 4:].min() >= 0 and table[:, 4:].max() <= 255):
        raise SceneError(f'{path}: colours outside 0 to 255; expected lines of {COLUMNS}')
    if len(table) and 0 < table[:, 4:].max() <= 1 and (table[:, 4:] % 1).any():
        raise SceneError(f'{path}: colours from 0 to 1; expected 0 to 255: lines of {COLUMNS}')
    if len(table) and not (table[:, 3].min() >= LEAST and table[:, 3].max() <= GREATEST):
        warnings.warn(
            f'{path}: intensities beyond {LEAST:g} to {GREATEST:g} are taken for these; expected lines of {COLUMNS}',
            stacklevel=2,
        )
