"""Matrix products over gathered rows: the two kernels under sparse convolution on the CPU.

A library product needs its rows copied together first and its results added back afterwards; for 16 to 128 channels
those two copies cost several times the product itself. Here a register tile reads its rows where they lie: a tile
takes a few pairs (input row, output row) and up to four vectors of channels, and keeps its sums in registers. The
tiles are built as LLVM vector instructions, which numba inlines, so that nothing has to be compiled beforehand and
the same code serves AVX2, AVX-512 and ARM.

Every sum runs in one fixed order, whatever the number of threads and the block sizes.
"""

import numpy as np
from llvmlite import binding  # type: ignore[import-untyped]
from numba import njit

from rm3d_plugin.ops._parallel import Array, each_block, num_threads, take_turn
from rm3d_plugin.ops._register_tiles import VECTOR_BYTES, forward_tile, outer_tile

BLOCK_ROWS = 1024  # output rows worked on together: their sums and inputs stay in the second-level cache
CHUNK_PAIRS = 96  # pairs per weight-gradient tile: both their rows stay in the first-level cache
SHARE_OPERATIONS = 1.6e8  # of a thread's share, some 1.5 ms: shorter ones read the weights more often
SMALL_OPERATIONS = 4e7  # below, a second thread costs more than it brings
SHARE_ROWS = 64  # a share has at least so many output rows
PART_ROWS = 8192  # rows per partial weight gradient; partial sums are added in order, so threads never race
# Two AVX2 registers hold a vector where AVX-512 is missing, so tiles are smaller there.
_WIDE = bool(binding.get_host_cpu_features().get('avx512f', False))
# Pairs per tile for one, two and four vectors of channels: the sums fill the registers without spilling.
_ROWS_1, _ROWS_2, _ROWS_4 = (8, 8, 6) if _WIDE else (6, 2, 1)
_GRAD_ROWS = 8 if _WIDE else 6  # input channels per weight-gradient tile


def gather_gemm(x: Array, weight: Array, pair_in: Array, pair_out: Array, starts: Array, n_out: int) -> Array:
    """``out[pair_out] += x[pair_in] @ weight[k]`` over the pairs of every offset ``k``.

    Args:
        x: (inputs, in_channels), float32 or float64.
        weight: (offsets, in_channels, out_channels) of the same type.
        pair_in: int32 input row of each pair.
        pair_out: int32 output row of each pair, rising within an offset.
        starts: Offset ``k`` owns the pairs ``starts[k]`` to ``starts[k + 1]``.
        n_out: Number of output rows.

    Returns:
        (n_out, out_channels).
    """
    channels = weight.shape[2]
    padded = _pad_columns(weight)
    out = np.empty((n_out, padded.shape[2]), x.dtype)
    share = min(SHARE_OPERATIONS, 165 * padded.nbytes)  # to read the weights once a share costs a few per cent
    shares = _shares(2.0 * len(pair_in) * x.shape[1] * out.shape[1], share, max(1, n_out // SHARE_ROWS))
    arguments = (out, np.ascontiguousarray(x), padded.reshape(-1), pair_in, pair_out, starts)
    each_block(lambda turns: _forward_shares(turns, shares, *arguments), shares)
    return out if out.shape[1] == channels else out[:, :channels].copy()


def gather_outer(x: Array, grad: Array, pair_in: Array, pair_out: Array, starts: Array) -> Array:
    """``out[k] = sum of outer(x[pair_in], grad[pair_out])`` over the pairs of every offset ``k``.

    Args:
        x: (inputs, in_channels), float32 or float64.
        grad: (outputs, out_channels) of the same type.
        pair_in: int32 row of ``x`` of each pair.
        pair_out: int32 row of ``grad`` of each pair, rising within an offset.
        starts: Offset ``k`` owns the pairs ``starts[k]`` to ``starts[k + 1]``.

    Returns:
        (offsets, in_channels, out_channels).
    """
    channels = grad.shape[1]
    padded, x = _pad_columns(grad), np.ascontiguousarray(x)
    parts = max(1, len(grad) // PART_ROWS)
    out = np.zeros((parts, len(starts) - 1, x.shape[1], padded.shape[1]), x.dtype)
    groups = _shares(2.0 * len(pair_in) * x.shape[1] * padded.shape[1] / parts, SHARE_OPERATIONS, len(starts) - 1)
    flat = out.reshape(parts, -1)
    each_block(lambda turns: _outer_shares(turns, groups, flat, x, padded, pair_in, pair_out, starts), parts * groups)
    for part in range(1, parts):
        out[0] += out[part]
    return out[0] if padded.shape[1] == channels else out[0, :, :, :channels].copy()


def _shares(operations: float, share: float, most: int) -> int:
    """Into how many shares of so many operations to cut work for several threads; results do not depend on it."""
    threads = num_threads()
    if threads == 1 or operations < SMALL_OPERATIONS:
        return 1
    rounds = -(-operations // (threads * share))  # of one share a thread
    return max(1, min(most, int(rounds) * threads))


def _pad_columns(array: Array) -> Array:
    """The array in C order, its last axis filled up with zeros to whole vectors."""
    missing = -array.shape[-1] % (VECTOR_BYTES // array.itemsize)
    if missing == 0:
        return np.ascontiguousarray(array)
    return np.pad(array, [(0, 0)] * (array.ndim - 1) + [(0, missing)])


_forward_1, _forward_1_single = forward_tile(_ROWS_1, 1), forward_tile(1, 1)
_forward_2, _forward_2_single = forward_tile(_ROWS_2, 2), forward_tile(1, 2)
_forward_4, _forward_4_single = forward_tile(_ROWS_4, 4), forward_tile(1, 4)
_outer_1, _outer_1_single = outer_tile(_GRAD_ROWS, 1), outer_tile(1, 1)
_outer_2, _outer_2_single = outer_tile(_GRAD_ROWS, 2), outer_tile(1, 2)


@njit(cache=True, nogil=True)
def _forward_shares(
    turns: Array, shares: int, out: Array, x: Array, w: Array, pair_in: Array, pair_out: Array, starts: Array
) -> None:
    share = take_turn(turns)
    while share < shares:
        begin, end = len(out) * share // shares, len(out) * (share + 1) // shares
        _forward_rows(out, x, w, pair_in, pair_out, starts, begin, end)
        share = take_turn(turns)


@njit(cache=True, nogil=True)
def _outer_shares(
    turns: Array, groups: int, out: Array, x: Array, grad: Array, pair_in: Array, pair_out: Array, starts: Array
) -> None:
    """Shares of the weight gradient: some offsets, over one part of the rows."""
    parts, offsets, size = len(out), len(starts) - 1, x.shape[1] * grad.shape[1]
    share = take_turn(turns)
    while share < parts * groups:
        part, group = share // groups, share % groups
        low, high = offsets * group // groups, offsets * (group + 1) // groups
        begin, end = len(grad) * part // parts, len(grad) * (part + 1) // parts
        own = out[part, low * size : high * size]
        _outer_rows(own, x, grad, pair_in, pair_out, starts[low : high + 1], begin, end)
        share = take_turn(turns)


@njit(cache=True, nogil=True)
def _forward_rows(
    out: Array, x: Array, w: Array, pair_in: Array, pair_out: Array, starts: Array, begin: int, end: int
) -> None:
    """The output rows ``begin`` to ``end``, a block at a time, offset after offset, a strip of channels at a time."""
    vector = VECTOR_BYTES // x.itemsize
    channels = out.shape[1]
    cursor = np.empty(len(starts) - 1, np.int64)
    for k in range(len(cursor)):
        cursor[k] = starts[k] + np.searchsorted(pair_out[starts[k] : starts[k + 1]], begin)
    for block in range(begin, end, BLOCK_ROWS):
        block_end = min(block + BLOCK_ROWS, end)
        out[block:block_end] = 0
        for k in range(len(cursor)):
            first = cursor[k]
            last = first + np.searchsorted(pair_out[first : starts[k + 1]], block_end)
            cursor[k] = last
            matrix = k * x.shape[1] * channels
            column = 0
            while first < last and column < channels:
                pair = first
                if column + 4 * vector <= channels:
                    while pair + _ROWS_4 <= last:
                        _forward_4(out, x, w, pair_in, pair_out, pair, matrix, column)
                        pair += _ROWS_4
                    while pair < last:
                        _forward_4_single(out, x, w, pair_in, pair_out, pair, matrix, column)
                        pair += 1
                    column += 4 * vector
                elif column + 2 * vector <= channels:
                    while pair + _ROWS_2 <= last:
                        _forward_2(out, x, w, pair_in, pair_out, pair, matrix, column)
                        pair += _ROWS_2
                    while pair < last:
                        _forward_2_single(out, x, w, pair_in, pair_out, pair, matrix, column)
                        pair += 1
                    column += 2 * vector
                else:
                    while pair + _ROWS_1 <= last:
                        _forward_1(out, x, w, pair_in, pair_out, pair, matrix, column)
                        pair += _ROWS_1
                    while pair < last:
                        _forward_1_single(out, x, w, pair_in, pair_out, pair, matrix, column)
                        pair += 1
                    column += vector


@njit(cache=True, nogil=True)
def _outer_rows(
    out: Array, x: Array, grad: Array, pair_in: Array, pair_out: Array, starts: Array, begin: int, end: int
) -> None:
    """The share of the output rows ``begin`` to ``end`` in every weight gradient, a block of rows at a time."""
    cursor = np.empty(len(starts) - 1, np.int64)
    for k in range(len(cursor)):
        cursor[k] = starts[k] + np.searchsorted(pair_out[starts[k] : starts[k + 1]], begin)
    for block in range(begin, end, BLOCK_ROWS):
        block_end = min(block + BLOCK_ROWS, end)
        for k in range(len(cursor)):
            first = cursor[k]
            last = first + np.searchsorted(pair_out[first : starts[k + 1]], block_end)
            cursor[k] = last
            for chunk in range(first, last, CHUNK_PAIRS):
                _outer_chunk(out, x, grad, pair_in, pair_out, chunk, min(chunk + CHUNK_PAIRS, last), k)


@njit(cache=True, nogil=True)
def _outer_chunk(
    out: Array, x: Array, grad: Array, pair_in: Array, pair_out: Array, first: int, last: int, k: int
) -> None:
    vector = VECTOR_BYTES // x.itemsize
    rows, channels = x.shape[1], grad.shape[1]
    matrix = k * rows * channels
    column = 0
    while column < channels:
        row = 0
        if column + 2 * vector <= channels:
            while row + _GRAD_ROWS <= rows:
                _outer_2(out, x, grad, pair_in, pair_out, first, last, matrix, row, column)
                row += _GRAD_ROWS
            while row < rows:
                _outer_2_single(out, x, grad, pair_in, pair_out, first, last, matrix, row, column)
                row += 1
            column += 2 * vector
        else:
            while row + _GRAD_ROWS <= rows:
                _outer_1(out, x, grad, pair_in, pair_out, first, last, matrix, row, column)
                row += _GRAD_ROWS
            while row < rows:
                _outer_1_single(out, x, grad, pair_in, pair_out, first, last, matrix, row, column)
                row += 1
            column += vector
