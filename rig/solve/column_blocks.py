"""Rows over the state, lanes of eight numbers, and products of vectors with tables stored in blocks of columns.

    table [block, n, BLOCK]      columns 0 .. BLOCK - 1 of all rows, then the next BLOCK columns: read sequentially

A product with such a table is many sums side by side, each in a fixed order. The vector code is explicit, because the
compiler's own code for such a product keeps its sums in memory and takes twice as long.

Lanes are a type of compiled code with + - *, for the same formula at several instants. Each lane is rounded like the
same formula on numbers, with the same fused operations. On a processor with narrower registers the compiler splits the
vectors; results stay the same.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, register_model
from numpy.typing import NDArray

from rig.compiled.kernel import Emission, fused, inlined, inner
from rig.compiled.records import address

Array = NDArray[np.float64]
ROUND = 64.0 * 2.2e-16  # rounding error of a product of rows, over the sum of the absolute values
LANE = 8  # doubles in a vector of 512 bits
VECTOR = ir.VectorType(ir.DoubleType(), LANE)
_FLAGS = ("contract",)
_WORD = ir.IntType(32)
BLOCK = 16  # columns of a block: two vectors
_ZERO = ir.Constant(VECTOR, [0.0] * LANE)
MOST_SUMS = 6
"""Vectors of sums that are kept in registers: enough for two multiply-adds at a time, each of four cycles."""


@inner
def dot(row, x):
    """The product row . x, summed in index order."""
    s = 0.0
    for j in range(row.shape[0]):
        s += row[j] * x[j]
    return s


@inner
def sparse_dot(row, entries, x):
    """The same product, in the same order, over the indices that are not zero: entries[1 .. entries[0]]."""
    s = 0.0
    for e in range(1, entries[0] + 1):
        j = np.uintp(entries[e])  # unsigned: no index counts from the end
        s += row[j] * x[j]
    return s


def entries_of(rows: Any) -> NDArray[np.int64]:
    """Count and indices of the entries that are not zero, of rows [..., column]."""
    there = np.asarray(rows) != 0.0
    behind = np.argsort(~there, axis=-1, kind="stable")
    return np.concatenate([there.sum(axis=-1, keepdims=True), behind], axis=-1).astype(np.int64)


@inner
def rounding(row, x):
    """The size of the rounding error of row . x."""
    s = 0.0
    for j in range(row.shape[0]):
        s += abs(row[j] * x[j])
    return s * ROUND


@fused
def is_zero(row):
    """Whether every entry of a row is zero."""
    for j in range(row.shape[0]):
        if row[j] != 0.0:
            return False
    return True


@inlined
def copy(n, source, target):
    """Copy the first n numbers of a row to another one."""
    for i in range(n):
        target[i] = source[i]


class LanesType(types.Type):  # type: ignore[misc]
    """The type of LANE numbers."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


LANES = LanesType()


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, VECTOR)


def spread(builder: Any, number: Any) -> ir.Value:
    """Emit a vector with the same number in all lanes."""
    none = ir.Constant(VECTOR, ir.Undefined)
    alone = builder.insert_element(none, number, ir.Constant(_WORD, 0))
    return builder.shuffle_vector(alone, none, ir.Constant(ir.VectorType(_WORD, LANE), [0] * LANE))


def load(builder: Any, data: Any, offset: Any) -> ir.Value:
    """Emit the vector that begins at data[offset]; it need not be aligned."""
    vector = builder.load(builder.bitcast(builder.gep(data, [offset]), VECTOR.as_pointer()))
    vector.align = 8
    return vector


def store(builder: Any, vector: Any, data: Any, offset: Any) -> None:
    """Emit the store of a vector to data, beginning at data[offset]."""
    builder.store(vector, builder.bitcast(builder.gep(data, [offset]), VECTOR.as_pointer())).align = 8


def add_product(builder: Any, a: Any, b: Any, total: Any) -> ir.Value:
    """Emit the vector a b + total, rounded once where the processor can."""
    return builder.fadd(builder.fmul(a, b, flags=_FLAGS), total, flags=_FLAGS)


def sum_by_halves(builder: Any, vector: Any) -> ir.Value:
    """Emit the sum of all lanes: the upper half is added to the lower half until one number is left."""
    size = LANE
    while size > 1:
        size //= 2
        kind = ir.VectorType(_WORD, size)
        none = ir.Constant(vector.type, ir.Undefined)
        low, high = (
            builder.shuffle_vector(vector, none, ir.Constant(kind, list(range(first, first + size))))
            for first in (0, size)
        )
        vector = builder.fadd(low, high)
    return builder.extract_element(vector, ir.Constant(_WORD, 0))


def _define(operation: Any, emit: str) -> None:
    pairs = [(LANES, LANES), (LANES, types.float64), (types.float64, LANES)]
    cases = [signature(LANES, *pair) for pair in pairs]
    infer_global(operation)(type(f"_Lanes_{emit}", (ConcreteTemplate,), {"key": operation, "cases": cases}))

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        a, b = (
            given if kind == LANES else spread(builder, given)
            for kind, given in zip(signature.args, arguments, strict=True)
        )
        return getattr(builder, emit)(a, b, flags=_FLAGS)

    for pair in pairs:
        lower_builtin(operation, *pair)(codegen)


for _operation, _emit in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):
    _define(_operation, _emit)


def _data(context: Any, builder: Any, kind: Any, array: Any) -> Any:
    return context.make_array(kind)(context, builder, array).data


def _alike(typing: Any, number: Any) -> Emission:
    """The same number in all lanes."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        return spread(builder, arguments[0])

    return LANES(types.float64), codegen


def _lanes(typing: Any, row: Any) -> Emission:
    """The first LANE numbers of a contiguous row."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        return load(builder, _data(context, builder, row, arguments[0]), context.get_constant(types.intp, 0))

    return LANES(row), codegen


def _write(typing: Any, values: Any, row: Any) -> Emission:
    """Write all lanes to the begin of a contiguous row."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        data, first = _data(context, builder, row, arguments[1]), context.get_constant(types.intp, 0)
        store(builder, arguments[0], data, first)
        return context.get_dummy_value()

    return types.none(LANES, row), codegen


def _lane(typing: Any, values: Any, k: Any) -> Emission:
    """The number in lane k."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        return builder.extract_element(arguments[0], builder.trunc(arguments[1], _WORD))

    return types.float64(LANES, types.intp), codegen


def _total(typing: Any, values: Any) -> Emission:
    """The sum of all lanes."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        return sum_by_halves(builder, arguments[0])

    return types.float64(LANES), codegen


def _between(typing: Any, least: Any, values: Any, most: Any) -> Emission:
    """Whether every lane is between two numbers; False if one is not a number."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        least, values, most = arguments
        above = builder.fcmp_ordered(">", values, spread(builder, least))
        below = builder.fcmp_ordered("<", values, spread(builder, most))
        bits = builder.bitcast(builder.and_(above, below), ir.IntType(LANE))
        return builder.icmp_unsigned("==", bits, ir.Constant(ir.IntType(LANE), (1 << LANE) - 1))

    return types.boolean(types.float64, LANES, types.float64), codegen


def _pick(typing: Any, table: Any, places: Any) -> Emission:
    """The entries of a table at `places`, which are whole numbers from 0 to its length."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        data = _data(context, builder, table, arguments[0])
        at = builder.fptoui(arguments[1], ir.VectorType(_WORD, LANE))
        picked = ir.Constant(VECTOR, ir.Undefined)
        for k in range(LANE):
            lane = ir.Constant(_WORD, k)
            place = builder.zext(builder.extract_element(at, lane), ir.IntType(64))
            picked = builder.insert_element(picked, builder.load(builder.gep(data, [place])), lane)
        return picked

    return LANES(table, LANES), codegen


alike: Any = intrinsic(_alike)
lanes: Any = intrinsic(_lanes)
write: Any = intrinsic(_write)
lane: Any = intrinsic(_lane)
total: Any = intrinsic(_total)
between: Any = intrinsic(_between)
pick: Any = intrinsic(_pick)


def zeros(shape: int | tuple[int, ...]) -> Array:
    """An array of zeros that begins at a cache line of the processor.

    Vectors that straddle two cache lines take twice as long.
    """
    count = shape if isinstance(shape, int) else math.prod(shape)
    room = np.zeros(count + LANE)
    first = -(address(room) // room.itemsize) % LANE
    return room[first : first + count].reshape(shape)


def blocks(rows: Array) -> Array:
    """Rows [row, n] as blocks of columns [block, n, BLOCK]; the last block is padded with zeros."""
    count = -(-len(rows) // BLOCK)
    n = rows.shape[1]
    padded = np.zeros((count * BLOCK, n))
    padded[: len(rows)] = rows
    return np.ascontiguousarray(padded.reshape(count, BLOCK, n).transpose(0, 2, 1))


def _whole(value: int) -> ir.Value:
    """An integer constant of the type of an index."""
    return ir.Constant(ir.IntType(64), value)


def _place(builder: Any) -> ir.Value:
    """Storage for one vector, which the compiler keeps in a register."""
    return cgutils.alloca_once(builder, VECTOR)  # type: ignore[no-untyped-call]


def _arrays(context: Any, builder: Any, signature: Any, arguments: Any) -> list[Any]:
    kinds = zip(signature.args, arguments)
    return [context.make_array(k)(context, builder, a) if isinstance(k, types.Array) else a for k, a in kinds]


def _multiply(typing: Any, table: Any, x: Any, first: Any, count: Any, out: Any) -> Emission:
    """out[BLOCK b + r] = sum_j x[j] table[first + b, j, r] for b < count, two blocks at a time.

    Every sum runs in the order of j on any processor.
    """

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        table, x, first, count, out = _arrays(context, builder, signature, arguments)
        of_block = BLOCK // LANE
        length = builder.extract_value(x.shape, 0)
        size = builder.mul(length, _whole(BLOCK))

        def several(block: Any, blocks: int) -> None:
            sums = [_place(builder) for _ in range(blocks * of_block)]
            for total in sums:
                builder.store(_ZERO, total)
            begin = builder.mul(builder.add(first, block), size)
            with cgutils.for_range(builder, length) as loop:  # type: ignore[no-untyped-call]
                factor = spread(builder, builder.load(builder.gep(x.data, [loop.index])))
                row = builder.add(begin, builder.mul(loop.index, _whole(BLOCK)))
                for k, total in enumerate(sums):
                    other = builder.add(row, builder.mul(size, _whole(k // of_block)))
                    values = load(builder, table.data, builder.add(other, _whole(LANE * (k % of_block))))
                    builder.store(add_product(builder, factor, values, builder.load(total)), total)
            begin = builder.mul(block, _whole(BLOCK))
            for k, total in enumerate(sums):
                store(builder, builder.load(total), out.data, builder.add(begin, _whole(LANE * k)))

        pairs = builder.lshr(count, _whole(1))
        with cgutils.for_range(builder, pairs) as loop:  # type: ignore[no-untyped-call]
            several(builder.mul(loop.index, _whole(2)), 2)
        with builder.if_then(builder.icmp_unsigned("!=", builder.and_(count, _whole(1)), _whole(0))):
            several(builder.sub(count, _whole(1)), 1)
        return context.get_dummy_value()

    return types.none(table, x, types.intp, types.intp, out), codegen


multiply: Any = intrinsic(_multiply)


def _gather(typing: Any, total: Any, x: Any, weight: Any) -> Emission:
    """Add weight x x^T to `total`, for the rows that `total` has. x and the rows have the length of whole blocks."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        total, x, weight = _arrays(context, builder, signature, arguments)
        rows, width = (builder.extract_value(total.shape, axis) for axis in range(2))
        with cgutils.for_range(builder, builder.udiv(width, _whole(BLOCK))) as block:  # type: ignore[no-untyped-call]
            begin = builder.mul(block.index, _whole(BLOCK))
            places = [builder.add(begin, _whole(LANE * k)) for k in range(BLOCK // LANE)]
            columns = [load(builder, x.data, at) for at in places]
            with cgutils.for_range(builder, rows) as row:  # type: ignore[no-untyped-call]
                own = builder.load(builder.gep(x.data, [row.index]))
                factor = spread(builder, builder.fmul(weight, own))
                first = builder.mul(row.index, width)
                for at, column in zip(places, columns):
                    place = builder.add(first, at)
                    store(
                        builder,
                        add_product(builder, factor, column, load(builder, total.data, place)),
                        total.data,
                        place,
                    )
        return context.get_dummy_value()

    return types.none(total, x, types.float64), codegen


gather: Any = intrinsic(_gather)


def _blend(typing: Any, low: Any, rise: Any, share: Any, x: Any, now: Any, out: Any) -> Emission:
    """Compute now = low + share rise [n, lane] and out[lane] = sum_j x[j] now[j, lane].

    The number of lanes is a multiple of LANE.
    """

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        low, rise, share, x, now, out = _arrays(context, builder, signature, arguments)
        count, width = (builder.extract_value(low.shape, axis) for axis in range(2))
        part = spread(builder, share)

        def several(first: Any, vectors: int) -> None:
            sums = [_place(builder) for _ in range(vectors)]
            for total in sums:
                builder.store(_ZERO, total)
            with cgutils.for_range(builder, count) as row:  # type: ignore[no-untyped-call]
                factor = spread(builder, builder.load(builder.gep(x.data, [row.index])))
                begin = builder.add(first, builder.mul(row.index, width))
                for k, total in enumerate(sums):
                    at = builder.add(begin, _whole(LANE * k))
                    value = add_product(builder, part, load(builder, rise.data, at), load(builder, low.data, at))
                    store(builder, value, now.data, at)
                    builder.store(add_product(builder, factor, value, builder.load(total)), total)
            for k, total in enumerate(sums):
                store(builder, builder.load(total), out.data, builder.add(first, _whole(LANE * k)))

        _in_wide_blocks(builder, width, several)
        return context.get_dummy_value()

    return types.none(low, rise, types.float64, x, now, out), codegen


blend: Any = intrinsic(_blend)


def _in_blocks(builder: Any, width: Any, several: Callable[[Any, int], None]) -> None:
    """Emit the code of `several(first, vectors)` for all lanes: whole blocks first, then the vector that is left.

    `several` handles `vectors` vectors beginning at lane `first`.
    """
    blocks = builder.udiv(width, _whole(BLOCK))
    with cgutils.for_range(builder, blocks) as block:  # type: ignore[no-untyped-call]
        several(builder.mul(block.index, _whole(BLOCK)), BLOCK // LANE)
    done = builder.mul(blocks, _whole(BLOCK))
    with builder.if_then(builder.icmp_unsigned("!=", done, width)):
        several(done, 1)


def _in_wide_blocks(builder: Any, width: Any, several: Callable[[Any, int], None]) -> None:
    """The same with blocks of MOST_SUMS vectors, and then one of all vectors that are left."""
    wide = _whole(LANE * MOST_SUMS)
    whole = builder.udiv(width, wide)
    with cgutils.for_range(builder, whole) as block:  # type: ignore[no-untyped-call]
        several(builder.mul(block.index, wide), MOST_SUMS)
    done = builder.mul(whole, wide)
    left = builder.sub(width, done)
    for vectors in range(1, MOST_SUMS):
        with builder.if_then(builder.icmp_unsigned("==", left, _whole(LANE * vectors))):
            several(done, vectors)


def _across(typing: Any, table: Any, weights: Any, out: Any) -> Emission:
    """out[j] = sum of table[j, lane] weights[lane]: each lane is summed on its own, then the lanes by halves.

    The number of lanes is a multiple of LANE.
    """

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        table, weights, out = _arrays(context, builder, signature, arguments)
        count, width = (builder.extract_value(table.shape, axis) for axis in range(2))

        def rows(first: Any, together: int) -> None:
            sums = [[_place(builder) for _ in range(BLOCK // LANE)] for _ in range(together)]
            for total in (place for row in sums for place in row):
                builder.store(_ZERO, total)
            begins = [builder.mul(builder.add(first, _whole(i)), width) for i in range(together)]

            def several(lane: Any, vectors: int) -> None:
                for k in range(vectors):
                    at = builder.add(lane, _whole(LANE * k))
                    weight = load(builder, weights.data, at)
                    for begin, row in zip(begins, sums):
                        value = load(builder, table.data, builder.add(begin, at))
                        builder.store(add_product(builder, weight, value, builder.load(row[k])), row[k])

            _in_blocks(builder, width, several)
            for i, row in enumerate(sums):
                whole = builder.load(row[0])
                for total in row[1:]:
                    whole = builder.fadd(whole, builder.load(total))
                builder.store(sum_by_halves(builder, whole), builder.gep(out.data, [builder.add(first, _whole(i))]))

        pairs = builder.lshr(count, _whole(1))
        with cgutils.for_range(builder, pairs) as pair:  # type: ignore[no-untyped-call]
            rows(builder.mul(pair.index, _whole(2)), 2)
        with builder.if_then(builder.icmp_unsigned("!=", builder.and_(count, _whole(1)), _whole(0))):
            rows(builder.sub(count, _whole(1)), 1)
        return context.get_dummy_value()

    return types.none(table, weights, out), codegen


across: Any = intrinsic(_across)


def _sums_along(context: Any, builder: Any, signature: Any, arguments: Any, adds: bool) -> ir.Value:
    table, x, out = _arrays(context, builder, signature, arguments)
    count, width = (builder.extract_value(table.shape, axis) for axis in range(2))

    def several(first: Any, vectors: int) -> None:
        sums, places = [], [builder.add(first, _whole(LANE * k)) for k in range(vectors)]
        for place in places:
            sums.append(_place(builder))
            builder.store(load(builder, out.data, place) if adds else _ZERO, sums[-1])
        with cgutils.for_range(builder, count) as row:  # type: ignore[no-untyped-call]
            factor = spread(builder, builder.load(builder.gep(x.data, [row.index])))
            begin = builder.mul(row.index, width)
            for place, total in zip(places, sums):
                values = load(builder, table.data, builder.add(begin, place))
                builder.store(add_product(builder, factor, values, builder.load(total)), total)
        for place, total in zip(places, sums):
            store(builder, builder.load(total), out.data, place)

    _in_wide_blocks(builder, width, several)
    return context.get_dummy_value()


def _along(typing: Any, table: Any, x: Any, out: Any) -> Emission:
    """out[lane] = sum_j x[j] table[j, lane]; every sum runs in the order of j. `x` has an entry for every row.

    The number of lanes is a multiple of LANE.
    """
    return types.none(table, x, out), partial(_sums_along, adds=False)


def _add_along(typing: Any, table: Any, x: Any, out: Any) -> Emission:
    """Go on with the sums of `along` in `out`."""
    return types.none(table, x, out), partial(_sums_along, adds=True)


along: Any = intrinsic(_along)
add_along: Any = intrinsic(_add_along)
