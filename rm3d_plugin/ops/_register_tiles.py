"""Register tiles: the innermost loops of the gathered matrix products, written as LLVM vector instructions.

numba inlines what these functions write into the kernels that call them. A vector is 64 bytes, which LLVM splits where
registers are narrower, so the same tile serves AVX-512, AVX2 and ARM. All arrays are in C order; their last axis
holds whole vectors where a tile writes.

numba's cache knows the file of a kernel only: after a change here, clear ``__pycache__``.
"""

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

VECTOR_BYTES = 64  # one AVX-512 register or two AVX2 ones


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


def forward_tile(rows: int, vectors: int) -> Any:
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


def outer_tile(rows: int, vectors: int) -> Any:
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
