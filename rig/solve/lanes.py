"""Eight numbers at once: a type of compiled code with + - *, for the same formula at several instants.

Each lane is rounded like the same formula on numbers, with the same fused operations. On a processor with narrower
registers the compiler splits the vectors; results stay the same.
"""

from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.datamodel import models
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, register_model

LANE = 8
VECTOR = ir.VectorType(ir.DoubleType(), LANE)
_FLAGS = ("contract",)
_WORD = ir.IntType(32)


class LanesType(types.Type):  # type: ignore[misc]
    """The type of LANE numbers."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


LANES = LanesType()


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, VECTOR)


def spread(builder: Any, number: Any) -> Any:
    """Emit a vector with the same number in all lanes."""
    none = ir.Constant(VECTOR, ir.Undefined)
    alone = builder.insert_element(none, number, ir.Constant(_WORD, 0))
    return builder.shuffle_vector(alone, none, ir.Constant(ir.VectorType(_WORD, LANE), [0] * LANE))


def load(builder: Any, data: Any, offset: Any) -> Any:
    """Emit the vector that begins at data[offset]; it need not be aligned."""
    found = builder.load(builder.bitcast(builder.gep(data, [offset]), VECTOR.as_pointer()))
    found.align = 8
    return found


def store(builder: Any, vector: Any, data: Any, offset: Any) -> None:
    """Emit the store of a vector to data, beginning at data[offset]."""
    builder.store(vector, builder.bitcast(builder.gep(data, [offset]), VECTOR.as_pointer())).align = 8


def add_product(builder: Any, a: Any, b: Any, total: Any) -> Any:
    """Emit the vector a b + total, rounded once where the processor can."""
    return builder.fadd(builder.fmul(a, b, flags=_FLAGS), total, flags=_FLAGS)


def sum_by_halves(builder: Any, vector: Any) -> Any:
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

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        a, b = (
            one if kind == LANES else spread(builder, one) for kind, one in zip(signature.args, arguments, strict=True)
        )
        return getattr(builder, emit)(a, b, flags=_FLAGS)

    for pair in pairs:
        lower_builtin(operation, *pair)(codegen)


for _operation, _emit in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):
    _define(_operation, _emit)


def _data(context: Any, builder: Any, kind: Any, array: Any) -> Any:
    return context.make_array(kind)(context, builder, array).data


def _alike(typing: Any, number: Any) -> Any:
    """The same number in all lanes."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return spread(builder, arguments[0])

    return LANES(types.float64), codegen


def _lanes(typing: Any, row: Any) -> Any:
    """The first LANE numbers of a contiguous row."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return load(builder, _data(context, builder, row, arguments[0]), context.get_constant(types.intp, 0))

    return LANES(row), codegen


def _write(typing: Any, values: Any, row: Any) -> Any:
    """Write all lanes to the begin of a contiguous row."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data, first = _data(context, builder, row, arguments[1]), context.get_constant(types.intp, 0)
        store(builder, arguments[0], data, first)
        return context.get_dummy_value()

    return types.none(LANES, row), codegen


def _lane(typing: Any, values: Any, k: Any) -> Any:
    """The number in lane k."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.extract_element(arguments[0], builder.trunc(arguments[1], _WORD))

    return types.float64(LANES, types.intp), codegen


def _total(typing: Any, values: Any) -> Any:
    """The sum of all lanes."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return sum_by_halves(builder, arguments[0])

    return types.float64(LANES), codegen


def _between(typing: Any, least: Any, values: Any, most: Any) -> Any:
    """Whether every lane is between two numbers; False if one is not a number."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        least, values, most = arguments
        above = builder.fcmp_ordered(">", values, spread(builder, least))
        below = builder.fcmp_ordered("<", values, spread(builder, most))
        bits = builder.bitcast(builder.and_(above, below), ir.IntType(LANE))
        return builder.icmp_unsigned("==", bits, ir.Constant(ir.IntType(LANE), (1 << LANE) - 1))

    return types.boolean(types.float64, LANES, types.float64), codegen


def _pick(typing: Any, table: Any, places: Any) -> Any:
    """The entries of a table at `places`, which are whole numbers from 0 to its length."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = _data(context, builder, table, arguments[0])
        at = builder.fptoui(arguments[1], ir.VectorType(_WORD, LANE))
        found = ir.Constant(VECTOR, ir.Undefined)
        for k in range(LANE):
            lane = ir.Constant(_WORD, k)
            place = builder.zext(builder.extract_element(at, lane), ir.IntType(64))
            found = builder.insert_element(found, builder.load(builder.gep(data, [place])), lane)
        return found

    return LANES(table, LANES), codegen


alike: Any = intrinsic(_alike)
lanes: Any = intrinsic(_lanes)
write: Any = intrinsic(_write)
lane: Any = intrinsic(_lane)
total: Any = intrinsic(_total)
between: Any = intrinsic(_between)
pick: Any = intrinsic(_pick)
