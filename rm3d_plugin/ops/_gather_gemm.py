"""Matrix products over gathered rows: the two kernels under sparse convolution on the CPU.

A library product needs its rows copied together first and its results added back afterwards; for 16 to 128 channels
those two copies cost several times the product itself. Here a register tile reads its rows where they lie: a tile
takes a few pairs (input row, output row) and up to four vectors of channels, and keeps its sums in registers. The
tiles are built as LLVM vector instructions, which numba inlines, so that nothing has to be compiled beforehand and
the same code serves AVX2, AVX-512 and ARM.

Every sum runs in one fixed order, whatever the number of threads and the block sizes.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import numpy as np
import torch
from llvmlite import binding, ir  # type: ignore[import-untyped]
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

Array = np.ndarray[Any, Any]

VECTOR_BYTES = 64  # one AVX-512 register or two AVX2 ones
BLOCK_ROWS = 1024  # output rows worked on together: their sums and inputs stay in the second-level cache
CHUNK_PAIRS = 96  # pairs per weight-gradient tile: both their rows stay in the first-level cache
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
    out = np.zeros((n_out, padded.shape[2]), x.dtype)
    threads = max(1, min(torch.get_num_threads(), n_out // BLOCK_ROWS))
    edges = [n_out * i // threads for i in range(threads + 1)]
    arguments = (out, np.ascontiguousarray(x), padded.reshape(-1), pair_in, pair_out, starts)
    in_threads(threads, threads, lambda i: _forward_rows(*arguments, edges[i], edges[i + 1]))
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
    edges = [len(grad) * i // parts for i in range(parts + 1)]
    in_threads(
        parts,
        torch.get_num_threads(),
        lambda i: _outer_rows(out[i].reshape(-1), x, padded, pair_in, pair_out, starts, edges[i], edges[i + 1]),
    )
    for part in range(1, parts):
        out[0] += out[part]
    return out[0] if padded.shape[1] == channels else out[0, :, :, :channels].copy()


def _pad_columns(array: Array) -> Array:
    """The array in C order, its last axis filled up with zeros to whole vectors."""
    missing = -array.shape[-1] % (VECTOR_BYTES // array.itemsize)
    if missing == 0:
        return np.ascontiguousarray(array)
    return np.pad(array, [(0, 0)] * (array.ndim - 1) + [(0, missing)])


def in_threads(count: int, threads: int, work: Callable[[int], None]) -> None:
    if count == 1 or threads == 1:
        for i in range(count):
            work(i)
    else:
        list(_pool(os.getpid(), threads).map(work, range(count)))


@cache
def _pool(process: int, threads: int) -> ThreadPoolExecutor:
    """One pool per process: threads do not survive a fork."""
    return ThreadPoolExecutor(threads)


def _vector_types(context: Any, dtype: Any) -> tuple[ir.VectorType, int]:
    size = dtype.bitwidth // 8
    return ir.VectorType(context.get_value_type(dtype), VECTOR_BYTES // size), size


def _multiply_add(builder: ir.IRBuilder, vector: ir.VectorType) -> ir.Function:
    name = f'llvm.fmuladd.v{vector.count}{"f32" if isinstance(vector.element, ir.FloatType) else "f64"}'
    found = builder.module.globals.get(name)
    return found or ir.Function(builder.module, ir.FunctionType(vector, [vector] * 3), name)


def _broadcast(builder: ir.IRBuilder, scalar: ir.Value, vector: ir.VectorType) -> ir.Value:
    undefined = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(undefined, scalar, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), vector.count), [0] * vector.count)
    return builder.shuffle_vector(first, undefined, zeros)


class _Tile:
    """Sums of a register tile, ``rows`` by ``vectors``, while its instructions are written."""

    def __init__(self, context: Any, builder: ir.IRBuilder, dtype: Any, rows: int, vectors: int) -> None:
        self.builder = builder
        self.vector, self.size = _vector_types(context, dtype)
        self.multiply_add = _multiply_add(builder, self.vector)
        self.sums = [[cgutils.alloca_once(builder, self.vector) for _ in range(vectors)] for _ in range(rows)]

    def _pointer(self, base: ir.Value, v: int) -> ir.Value:
        place = self.builder.gep(base, [ir.Constant(ir.IntType(64), v * self.vector.count)])
        return self.builder.bitcast(place, self.vector.as_pointer())

    def load(self, base: ir.Value) -> list[ir.Value]:
        """As many vectors as the tile is wide, from ``base`` on."""
        return [self.builder.load(self._pointer(base, v), align=self.size) for v in range(len(self.sums[0]))]

    def read(self, row: int, base: ir.Value) -> None:
        for place, value in zip(self.sums[row], self.load(base), strict=True):
            self.builder.store(value, place)

    def write(self, row: int, base: ir.Value) -> None:
        for v, place in enumerate(self.sums[row]):
            self.builder.store(self.builder.load(place), self._pointer(base, v), align=self.size)

    def add(self, row: int, scalar_at: ir.Value, vectors: list[ir.Value]) -> None:
        scalar = self.builder.load(scalar_at, align=self.size)
        factor = _broadcast(self.builder, scalar, self.vector)
        for place, value in zip(self.sums[row], vectors, strict=True):
            total = self.builder.call(self.multiply_add, [factor, value, self.builder.load(place)])
            self.builder.store(total, place)


def _data(context: Any, builder: ir.IRBuilder, kind: Any, value: ir.Value) -> ir.Value:
    return context.make_array(kind)(context, builder, value).data


def _columns(context: Any, builder: ir.IRBuilder, kind: Any, value: ir.Value) -> ir.Value:
    return cgutils.unpack_tuple(builder, context.make_array(kind)(context, builder, value).shape)[1]


def _row_pointer(builder: ir.IRBuilder, data: ir.Value, rows: ir.Value, pair: ir.Value, columns: ir.Value) -> ir.Value:
    """Address of row ``rows[pair]`` of a matrix."""
    row = builder.sext(builder.load(builder.gep(rows, [pair])), ir.IntType(64))
    return builder.gep(data, [builder.mul(row, columns)])


def _forward_tile(rows: int, vectors: int) -> Any:
    """``out[pair_out[p], column:] += x[pair_in[p]] @ weight[k][:, column:]`` for ``rows`` pairs from ``first`` on."""

    @intrinsic
    def tile(
        _: Any, out: Any, x: Any, w: Any, pair_in: Any, pair_out: Any, first: Any, matrix: Any, column: Any
    ) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            kinds = signature.args
            out_at, x_at, w_at, in_at, to_at = [_data(context, builder, kinds[i], args[i]) for i in range(5)]
            out_columns = _columns(context, builder, kinds[0], args[0])
            x_columns = _columns(context, builder, kinds[1], args[1])
            sums = _Tile(context, builder, kinds[0].dtype, rows, vectors)
            pairs = [builder.add(args[5], ir.Constant(ir.IntType(64), r)) for r in range(rows)]
            inputs = [_row_pointer(builder, x_at, in_at, p, x_columns) for p in pairs]
            outputs = [builder.gep(_row_pointer(builder, out_at, to_at, p, out_columns), [args[7]]) for p in pairs]
            for r in range(rows):
                sums.read(r, outputs[r])
            weights = builder.gep(w_at, [builder.add(args[6], args[7])])
            with cgutils.for_range(builder, x_columns) as loop:
                vectors_of_row = sums.load(builder.gep(weights, [builder.mul(loop.index, out_columns)]))
                for r in range(rows):
                    sums.add(r, builder.gep(inputs[r], [loop.index]), vectors_of_row)
            for r in range(rows):
                sums.write(r, outputs[r])
            return context.get_dummy_value()

        return types.void(out, x, w, pair_in, pair_out, first, matrix, column), codegen

    return tile


def _outer_tile(rows: int, vectors: int) -> Any:
    """``out[k][row:, column:] += outer(x[pair_in[p], row:], grad[pair_out[p], column:])`` for the pairs first..last."""

    @intrinsic
    def tile(
        _: Any, out: Any, x: Any, grad: Any, pair_in: Any, pair_out: Any, first: Any, last: Any, matrix: Any, row: Any,
        column: Any,
    ) -> Any:  # fmt: skip
        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            kinds = signature.args
            out_at, x_at, grad_at, in_at, to_at = [_data(context, builder, kinds[i], args[i]) for i in range(5)]
            x_columns = _columns(context, builder, kinds[1], args[1])
            columns = _columns(context, builder, kinds[2], args[2])
            sums = _Tile(context, builder, kinds[1].dtype, rows, vectors)
            corner = builder.add(args[7], builder.add(builder.mul(args[8], columns), args[9]))
            outputs = []
            for r in range(rows):
                step = builder.mul(columns, ir.Constant(ir.IntType(64), r))
                outputs.append(builder.gep(out_at, [builder.add(corner, step)]))
                sums.read(r, outputs[r])
            with cgutils.for_range(builder, args[6], start=args[5]) as loop:
                source = builder.gep(_row_pointer(builder, x_at, in_at, loop.index, x_columns), [args[8]])
                target = builder.gep(_row_pointer(builder, grad_at, to_at, loop.index, columns), [args[9]])
                vectors_of_pair = sums.load(target)
                for r in range(rows):
                    sums.add(r, builder.gep(source, [ir.Constant(ir.IntType(64), r)]), vectors_of_pair)
            for r in range(rows):
                sums.write(r, outputs[r])
            return context.get_dummy_value()

        return types.void(out, x, grad, pair_in, pair_out, first, last, matrix, row, column), codegen

    return tile


_forward_1, _forward_1_single = _forward_tile(_ROWS_1, 1), _forward_tile(1, 1)
_forward_2, _forward_2_single = _forward_tile(_ROWS_2, 2), _forward_tile(1, 2)
_forward_4, _forward_4_single = _forward_tile(_ROWS_4, 4), _forward_tile(1, 4)
_outer_1, _outer_1_single = _outer_tile(_GRAD_ROWS, 1), _outer_tile(1, 1)
_outer_2, _outer_2_single = _outer_tile(_GRAD_ROWS, 2), _outer_tile(1, 2)


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
