"""Products of vectors with tables stored in blocks of columns: many sums side by side, each in a fixed order.

    table [block, n, BLOCK]      columns 0 .. BLOCK - 1 of all rows, then the next BLOCK columns: read sequentially

The vector code is explicit, because the compiler's own code for such a product keeps its sums in memory and takes twice
as long. On a processor with narrower registers the compiler splits the vectors; sums and their rounding
stay the same.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from rig.solve import lanes
from rig.solve.lanes import LANE

Array = NDArray[np.float64]
BLOCK = 16
_ZERO = ir.Constant(lanes.VECTOR, [0.0] * LANE)


def zeros(shape: int | tuple[int, ...]) -> Array:
    """An array of zeros that begins at a cache line of the processor.

    Vectors that straddle two cache lines take twice as long.
    """
    count = int(np.prod(shape))
    room = np.zeros(count + LANE)
    first = -(room.ctypes.data // room.itemsize) % LANE
    return room[first : first + count].reshape(shape)


def blocks(rows: Array) -> Array:
    """Rows [row, n] as blocks of columns [block, n, BLOCK]; the last block is padded with zeros."""
    count, n = -(-len(rows) // BLOCK), rows.shape[1]
    padded = np.zeros((count * BLOCK, n))
    padded[: len(rows)] = rows
    return np.ascontiguousarray(padded.reshape(count, BLOCK, n).transpose(0, 2, 1))


def _whole(value: int) -> Any:
    """An integer constant of the type of an index."""
    return ir.Constant(ir.IntType(64), value)


def _place(builder: Any) -> Any:
    """Storage for one vector, which the compiler keeps in a register."""
    return cgutils.alloca_once(builder, lanes.VECTOR)  # type: ignore[no-untyped-call]


def _arrays(context: Any, builder: Any, signature: Any, arguments: Any) -> list[Any]:
    kinds = zip(signature.args, arguments)
    return [context.make_array(k)(context, builder, a) if isinstance(k, types.Array) else a for k, a in kinds]


def _multiply(typing: Any, table: Any, x: Any, first: Any, count: Any, out: Any) -> Any:
    """out[BLOCK b + r] = sum_j x[j] table[first + b, j, r] for b < count, two blocks at a time.

    Every sum runs in the order of j on any processor.
    """

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
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
                factor = lanes.spread(builder, builder.load(builder.gep(x.data, [loop.index])))
                row = builder.add(begin, builder.mul(loop.index, _whole(BLOCK)))
                for k, total in enumerate(sums):
                    other = builder.add(row, builder.mul(size, _whole(k // of_block)))
                    values = lanes.load(builder, table.data, builder.add(other, _whole(LANE * (k % of_block))))
                    builder.store(lanes.add_product(builder, factor, values, builder.load(total)), total)
            begin = builder.mul(block, _whole(BLOCK))
            for k, total in enumerate(sums):
                lanes.store(builder, builder.load(total), out.data, builder.add(begin, _whole(LANE * k)))

        pairs = builder.lshr(count, _whole(1))
        with cgutils.for_range(builder, pairs) as loop:  # type: ignore[no-untyped-call]
            several(builder.mul(loop.index, _whole(2)), 2)
        with builder.if_then(builder.icmp_unsigned("!=", builder.and_(count, _whole(1)), _whole(0))):
            several(builder.sub(count, _whole(1)), 1)
        return context.get_dummy_value()

    return types.none(table, x, types.intp, types.intp, out), codegen


multiply: Any = intrinsic(_multiply)


def _gather(typing: Any, total: Any, x: Any, weight: Any) -> Any:
    """Add weight x x^T to `total`, for the rows that `total` has. x and the rows have the length of whole blocks."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        total, x, weight = _arrays(context, builder, signature, arguments)
        rows, width = (builder.extract_value(total.shape, axis) for axis in range(2))
        with cgutils.for_range(builder, builder.udiv(width, _whole(BLOCK))) as block:  # type: ignore[no-untyped-call]
            begin = builder.mul(block.index, _whole(BLOCK))
            places = [builder.add(begin, _whole(LANE * k)) for k in range(BLOCK // LANE)]
            columns = [lanes.load(builder, x.data, at) for at in places]
            with cgutils.for_range(builder, rows) as row:  # type: ignore[no-untyped-call]
                own = builder.load(builder.gep(x.data, [row.index]))
                factor = lanes.spread(builder, builder.fmul(weight, own))
                first = builder.mul(row.index, width)
                for at, column in zip(places, columns):
                    place = builder.add(first, at)
                    lanes.store(
                        builder,
                        lanes.add_product(builder, factor, column, lanes.load(builder, total.data, place)),
                        total.data,
                        place,
                    )
        return context.get_dummy_value()

    return types.none(total, x, types.float64), codegen


gather: Any = intrinsic(_gather)


def _blend(typing: Any, low: Any, rise: Any, share: Any, x: Any, now: Any, out: Any) -> Any:
    """Compute now = low + share rise [n, lane] and out[lane] = sum_j x[j] now[j, lane].

    The number of lanes is a multiple of LANE.
    """

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        low, rise, share, x, now, out = _arrays(context, builder, signature, arguments)
        count, width = (builder.extract_value(low.shape, axis) for axis in range(2))
        part = lanes.spread(builder, share)

        def several(first: Any, vectors: int) -> None:
            sums = [_place(builder) for _ in range(vectors)]
            for total in sums:
                builder.store(_ZERO, total)
            with cgutils.for_range(builder, count) as row:  # type: ignore[no-untyped-call]
                factor = lanes.spread(builder, builder.load(builder.gep(x.data, [row.index])))
                begin = builder.add(first, builder.mul(row.index, width))
                for k, total in enumerate(sums):
                    at = builder.add(begin, _whole(LANE * k))
                    value = lanes.add_product(
                        builder, part, lanes.load(builder, rise.data, at), lanes.load(builder, low.data, at)
                    )
                    lanes.store(builder, value, now.data, at)
                    builder.store(lanes.add_product(builder, factor, value, builder.load(total)), total)
            for k, total in enumerate(sums):
                lanes.store(builder, builder.load(total), out.data, builder.add(first, _whole(LANE * k)))

        _in_blocks(builder, width, several)
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


def _across(typing: Any, table: Any, weights: Any, out: Any) -> Any:
    """out[j] = sum of table[j, lane] weights[lane]: each lane is summed on its own, then the lanes by halves.

    The number of lanes is a multiple of LANE.
    """

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        table, weights, out = _arrays(context, builder, signature, arguments)
        count, width = (builder.extract_value(table.shape, axis) for axis in range(2))

        def rows(first: Any, together: int) -> None:
            sums = [[_place(builder) for _ in range(BLOCK // LANE)] for _ in range(together)]
            for total in (one for row in sums for one in row):
                builder.store(_ZERO, total)
            begins = [builder.mul(builder.add(first, _whole(i)), width) for i in range(together)]

            def several(lane: Any, vectors: int) -> None:
                for k in range(vectors):
                    at = builder.add(lane, _whole(LANE * k))
                    weight = lanes.load(builder, weights.data, at)
                    for begin, row in zip(begins, sums):
                        value = lanes.load(builder, table.data, builder.add(begin, at))
                        builder.store(lanes.add_product(builder, weight, value, builder.load(row[k])), row[k])

            _in_blocks(builder, width, several)
            for i, row in enumerate(sums):
                whole = builder.load(row[0])
                for total in row[1:]:
                    whole = builder.fadd(whole, builder.load(total))
                builder.store(
                    lanes.sum_by_halves(builder, whole), builder.gep(out.data, [builder.add(first, _whole(i))])
                )

        pairs = builder.lshr(count, _whole(1))
        with cgutils.for_range(builder, pairs) as pair:  # type: ignore[no-untyped-call]
            rows(builder.mul(pair.index, _whole(2)), 2)
        with builder.if_then(builder.icmp_unsigned("!=", builder.and_(count, _whole(1)), _whole(0))):
            rows(builder.sub(count, _whole(1)), 1)
        return context.get_dummy_value()

    return types.none(table, weights, out), codegen


across: Any = intrinsic(_across)
