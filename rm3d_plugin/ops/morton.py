"""Morton (Z-order) codes: points that are near in space become near in memory (METHOD 4)."""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: ANN001, ANN201, ANN202
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt64
from numba import njit

from rm3d_plugin.ops import _compile_notice
from rm3d_plugin.ops._parallel import map_blocks

_compile_notice.install()  # all of the geometry path imports this module, before any kernel runs

BITS = 21  # per axis; three axes fill 63 of 64 bits
DIGIT, PASSES = 11, 6  # bits that one pass of the sort looks at, and passes
TOGETHER = 1 << 16  # codes that one thread makes or sorts at a time
RADIX_FROM = 1 << 12  # fewer codes are sorted by comparison


class Grid(NamedTuple):
    """The cube that codes refer to.

    Attributes:
        low: (3,) float64 lowest corner in metres.
        edge: Length of the cube's edge in metres, positive.
    """

    low: Float[np.ndarray, '3']
    edge: float


@njit(cache=True, nogil=True, inline='always')
def spread_bits(value):
    """Put two zero bits between the lowest 21 bits."""
    x = np.uint64(value)
    x = (x | (x << np.uint64(32))) & np.uint64(0x1F00000000FFFF)
    x = (x | (x << np.uint64(16))) & np.uint64(0x1F0000FF0000FF)
    x = (x | (x << np.uint64(8))) & np.uint64(0x100F00F00F00F00F)
    x = (x | (x << np.uint64(4))) & np.uint64(0x10C30C30C30C30C3)
    x = (x | (x << np.uint64(2))) & np.uint64(0x1249249249249249)
    return x


@njit(cache=True, nogil=True, inline='always')
def gather_bits(code):
    """Undo :func:`spread_bits`: every third bit of a code, from the lowest on."""
    x = np.uint64(code) & np.uint64(0x1249249249249249)
    x = (x | (x >> np.uint64(2))) & np.uint64(0x10C30C30C30C30C3)
    x = (x | (x >> np.uint64(4))) & np.uint64(0x100F00F00F00F00F)
    x = (x | (x >> np.uint64(8))) & np.uint64(0x1F0000FF0000FF)
    x = (x | (x >> np.uint64(16))) & np.uint64(0x1F00000000FFFF)
    x = (x | (x >> np.uint64(32))) & np.uint64(0x1FFFFF)
    return x


@njit(cache=True, nogil=True)
def _encode(points, low, scale, codes):
    top = np.float64((1 << BITS) - 1)
    for i in range(points.shape[0]):
        code = np.uint64(0)
        for axis in range(3):
            cell = min(max(np.floor((points[i, axis] - low[axis]) * scale), 0.0), top)
            code |= spread_bits(np.uint64(cell)) << np.uint64(axis)
        codes[i] = code


@njit(cache=True, nogil=True)
def _bounds(points):
    """Least and greatest coordinates; kept apart from other threads' until the end."""
    low, high = points[0].copy(), points[0].copy()
    for axis in range(3):
        least = greatest = points[0, axis]
        for i in range(points.shape[0]):
            least, greatest = min(least, points[i, axis]), max(greatest, points[i, axis])
        low[axis], high[axis] = least, greatest
    return low, high


@njit(cache=True, nogil=True)
def _count_digits(codes, start, stop, counts):
    """Count the highest digits of ``codes[start:stop]``; whether each code is at least the one before it."""
    shift = np.uint64(DIGIT * (PASSES - 1))
    counts[:] = 0
    before, ascending = codes[max(start - 1, 0)], True
    for i in range(start, stop):
        counts[codes[i] >> shift] += 1
        ascending &= codes[i] >= before
        before = codes[i]
    return ascending


@njit(cache=True, nogil=True)
def _first_places(counts, starts):
    """Turn digit counts (blocks, digits) into the place of each block's first code of a digit; ``starts``: of each."""
    place = 0
    for digit in range(counts.shape[1]):
        starts[digit] = place
        for block in range(counts.shape[0]):
            counts[block, digit], place = place, place + counts[block, digit]
    starts[counts.shape[1]] = place


@njit(cache=True, nogil=True)
def _split(codes, start, stop, place, out_codes, out_order):
    """Put ``codes[start:stop]`` and their numbers into buckets by their highest digit, in their order."""
    shift = np.uint64(DIGIT * (PASSES - 1))
    for i in range(start, stop):
        digit = codes[i] >> shift
        to = place[digit]
        out_codes[to], out_order[to] = codes[i], i
        place[digit] = to + 1


@njit(cache=True, nogil=True)
def _sort_buckets(codes, order, starts, first, last):
    """Sort each of some buckets by the lower digits, lowest first."""
    size = 0
    for bucket in range(first, last):
        size = max(size, starts[bucket + 1] - starts[bucket])
    other_codes, other_order = np.empty(size, dtype=np.uint64), np.empty(size, dtype=np.int32)
    count = np.empty(1 << DIGIT, dtype=np.int64)
    for bucket in range(first, last):
        begin, n = starts[bucket], starts[bucket + 1] - starts[bucket]
        here_codes, here_order = codes[begin : begin + n], order[begin : begin + n]
        from_codes, from_order, to_codes, to_order = here_codes, here_order, other_codes, other_order
        swapped = False
        for turn in range(PASSES - 1 if n > 1 else 0):
            shift = np.uint64(DIGIT * turn)
            count[:] = 0
            for i in range(n):
                count[(from_codes[i] >> shift) & np.uint64((1 << DIGIT) - 1)] += 1
            to = 0
            for digit in range(1 << DIGIT):
                count[digit], to = to, to + count[digit]
            for i in range(n):
                digit = (from_codes[i] >> shift) & np.uint64((1 << DIGIT) - 1)
                to = count[digit]
                to_codes[to], to_order[to] = from_codes[i], from_order[i]
                count[digit] = to + 1
            from_codes, from_order, to_codes, to_order = to_codes, to_order, from_codes, from_order
            swapped = not swapped
        if swapped:
            here_codes[:], here_order[:] = other_codes[:n], other_order[:n]


def enclosing_cube(points: Float[np.ndarray, 'points 3']) -> Grid:
    """The smallest axis-parallel cube at the lowest corner of ``points`` (metres); edge 1 m for a single place."""
    if len(points) == 0:
        return Grid(np.zeros(3), 1.0)
    array = np.ascontiguousarray(points, dtype=np.float64)

    def work(start: int, stop: int) -> tuple[np.ndarray, np.ndarray]:
        least, greatest = _bounds(array[start:stop])
        return least, greatest

    lows, highs = zip(*map_blocks(work, len(array), TOGETHER), strict=True)
    low = np.min(lows, axis=0)
    edge = float((np.max(highs, axis=0) - low).max())
    return Grid(low, edge if edge > 0 else 1.0)


def morton_codes(points: Float[np.ndarray, 'points 3'], grid: Grid | None = None) -> UInt64[np.ndarray, ' points']:
    """Codes of points (metres) on a grid of 2^21 cells along each edge of the cube.

    Args:
        points: Finite coordinates; outside of the cube they count as being at its border.
        grid: The cube; the points' own without it.

    Returns:
        uint64 codes: bit 3 i + a is bit i of the cell number along axis a.
    """
    cube = enclosing_cube(points) if grid is None else grid
    codes = np.empty(len(points), dtype=np.uint64)
    array = np.ascontiguousarray(points, dtype=np.float64)

    def work(start: int, stop: int) -> None:
        _encode(array[start:stop], cube.low, 2.0**BITS / cube.edge, codes[start:stop])

    map_blocks(work, len(points), TOGETHER)
    return codes


class SortedCodes(NamedTuple):
    """Codes along the curve.

    Attributes:
        order: (N,) int32 number of the point at each place.
        codes: (N,) uint64 ascending.
    """

    order: Int[np.ndarray, ' points']
    codes: UInt64[np.ndarray, ' points']


def sort_codes(codes: UInt64[np.ndarray, ' points']) -> SortedCodes:
    """Sort codes; equal ones keep their order."""
    n = len(codes)
    if n < RADIX_FROM:
        order = np.argsort(codes, kind='stable')
        return SortedCodes(order.astype(np.int32), codes[order])
    counts = np.empty((-(-n // TOGETHER), 1 << DIGIT), dtype=np.int64)

    def count(start: int, stop: int) -> bool:
        return bool(_count_digits(codes, start, stop, counts[start // TOGETHER]))

    if all(map_blocks(count, n, TOGETHER)):
        return SortedCodes(np.arange(n, dtype=np.int32), codes)
    out = SortedCodes(np.empty(n, dtype=np.int32), np.empty(n, dtype=np.uint64))
    starts = np.empty((1 << DIGIT) + 1, dtype=np.int64)
    _first_places(counts, starts)

    def split(start: int, stop: int) -> None:
        _split(codes, start, stop, counts[start // TOGETHER], out.codes, out.order)

    map_blocks(split, n, TOGETHER)
    # Runs of buckets of about TOGETHER codes: the blocks of the threads.
    bounds = np.unique(np.append(np.searchsorted(starts, np.arange(0, n, TOGETHER)), len(starts) - 1))

    def sort(start: int, stop: int) -> None:
        _sort_buckets(out.codes, out.order, starts, bounds[start], bounds[stop])

    map_blocks(sort, len(bounds) - 1, 1)
    return out


def morton_order(points: Float[np.ndarray, 'points 3'], grid: Grid | None = None) -> Int[np.ndarray, ' points']:
    """The order (int64 indices) that sorts points along the Morton curve; equal codes keep their order."""
    return sort_codes(morton_codes(points, grid)).order.astype(np.int64)
