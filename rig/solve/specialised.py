"""Compiled code that is called by address: specialised kernels for a fixed number of states, and general parts.

Code that runs once per event, segment or sample takes the number of states at run time and is compiled once for all
rigs. Code that runs millions of times, a quiet tick or a step of an integrator, is faster if that number is a constant
of the compiled code: loops are unrolled and the state stays in registers. Such a *specialised kernel* is compiled for a
`Shape`. The general code calls it through a pointer, once per stretch of ticks (3 ns). The large *parts* of the general
code call each other in the same way. So no part is compiled again inside its caller, and parts that a rig does not need
are not compiled at all.

numba, which takes most of the time of compiling, compiles a specialised kernel once, for `UNFILLED`: the constants of
a shape are filled into the text that it hands to LLVM (rig.compiled.kernel), which then makes of it what it would have
made of a text for this shape alone.
"""

from __future__ import annotations

import math
import re
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.extending import intrinsic, register_model

from rig.compiled.kernel import UNFILLED_NAME, Emission

ROWS = 8
_WORD = ir.IntType(64)
_FLAG = ir.IntType(1)
_CONSTANT = re.compile(r'ptrtoint \(ptr @(?:"states (\d+) (\d+)"|(products|nonlinear)) to i\d+\)')


class KernelShape(types.Type):  # type: ignore[misc]
    """The constants of a specialised kernel: number of states (0: any), and whether there are products of states.

    `nonlinear`: whether at least one mode set is not linear.
    """

    def __init__(self, states: int, products: bool, nonlinear: bool) -> None:
        self.states = states
        self.products = products
        self.nonlinear = nonlinear
        super().__init__(name=f"Shape({states}, {products}, {nonlinear})")

    @property
    def unfilled(self) -> KernelShape | None:
        """The shape for which numba compiles a kernel of this shape; None: for itself."""
        return UNFILLED if self.states else None

    def whole(self, module: Any, factor: int = 1, power: int = 1) -> ir.Constant:
        """The constant factor states^power, in the code of `module`."""
        return ir.Constant(_WORD, factor * self.states**power)

    def flag(self, module: Any, name: str) -> ir.Constant:
        """The constant `name`, products or nonlinear."""
        return ir.Constant(_FLAG, getattr(self, name))

    def fill(self, text: str) -> str:
        """LLVM's text of a kernel for UNFILLED, or a name in it, with the constants of this shape."""

        def constant(which: re.Match[str]) -> str:
            factor, power, name = which.groups()
            return str(int(factor) * self.states ** int(power) if factor else int(getattr(self, name)))

        name = f"Shape_{self.states}_{self.products:d}_{self.nonlinear:d}"
        return _CONSTANT.sub(constant, text).replace(UNFILLED_NAME, name)


class _Unfilled(KernelShape):
    """The shape whose constants are addresses of variables that exist nowhere; `fill` replaces them."""

    unfilled = None

    def __init__(self) -> None:
        types.Type.__init__(self, name=UNFILLED_NAME)
        self.states = -1

    def whole(self, module: Any, factor: int = 1, power: int = 1) -> ir.Constant:
        """What stands for the constant factor states^power."""
        return _address(module, f"states {factor} {power}") if power else ir.Constant(_WORD, factor)

    def flag(self, module: Any, name: str) -> ir.Constant:
        """What stands for the constant `name`."""
        return _address(module, name).trunc(_FLAG)


def _address(module: Any, name: str) -> Any:
    known = module.globals.get(name) or ir.GlobalVariable(module, ir.IntType(8), name)
    return known.ptrtoint(_WORD)


register_model(KernelShape)(models.OpaqueModel)
register_model(_Unfilled)(models.OpaqueModel)
ANY = KernelShape(0, products=True, nonlinear=True)
"""The shape of code that serves all rigs."""
UNFILLED = _Unfilled()
"""The shape for which numba compiles a specialised kernel once."""


def _any_shape(typing: Any, n: Any) -> Emission:
    """The shape of code that is compiled for any number of states, with the actual number n."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return ANY(types.intp), codegen


any_shape: Any = intrinsic(_any_shape)


def _state_count(typing: Any, shape: Any) -> Emission:
    """The number of states of a shape."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        if shape.states:
            return shape.whole(builder.module)
        return builder.ptrtoint(arguments[0], context.get_value_type(types.intp))

    return types.intp(shape), codegen


state_count: Any = intrinsic(_state_count)


def _is_unrolled(typing: Any, shape: Any) -> Emission:
    """Whether the number of states is a constant of the compiled code."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        return context.get_constant(types.boolean, bool(shape.states))

    return types.boolean(shape), codegen


is_unrolled: Any = intrinsic(_is_unrolled)


def _has_products(typing: Any, shape: Any) -> Emission:
    """Whether there may be products of states. If not, the code that evaluates them is not compiled."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        return shape.flag(builder.module, "products")

    return types.boolean(shape), codegen


has_products: Any = intrinsic(_has_products)


def _is_nonlinear(typing: Any, shape: Any) -> Emission:
    """Whether inputs have to be computed: not if the system is linear in every mode set."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        return shape.flag(builder.module, "nonlinear")

    return types.boolean(shape), codegen


is_nonlinear: Any = intrinsic(_is_nonlinear)


def _local(typing: Any, shape: Any, like: Any) -> Emission:
    """A local array of the type of `like` on the stack: its last axis has one entry per state, other axes have `ROWS`.

    The compiler keeps it in registers, like a local array in C. If the number of states is unknown at compile time,
    `like` itself is returned.
    """
    return _on_stack(shape, like, (ROWS, 0))


def _local_stages(typing: Any, shape: Any, like: Any) -> Emission:
    """As `local`, with twice as many rows."""
    return _on_stack(shape, like, (2 * ROWS, 0))


def _local_square(typing: Any, shape: Any, like: Any) -> Emission:
    """As `local`, for a matrix over the states."""
    return _on_stack(shape, like, (1, 1))


def _on_stack(shape: Any, like: Any, rows: tuple[int, int]) -> Emission:
    """`rows`: factor and power of the number of states, which together are the length of all axes but the last."""
    kind = types.Array(like.dtype, like.ndim, "C")

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        if not shape.states:
            return arguments[1]
        lengths = [rows] * (like.ndim - 1) + [(1, 1)]

        def product(these: list[tuple[int, int]], factor: int = 1) -> ir.Constant:
            return shape.whole(
                builder.module, math.prod((factor, *(own for own, _ in these))), sum(power for _, power in these)
            )

        double = context.get_data_type(like.dtype)
        data = cgutils.alloca_once(builder, double, size=product(lengths))  # type: ignore[no-untyped-call]
        array = context.make_array(kind)(context, builder)
        context.populate_array(
            array,
            data=data,
            shape=[product([length]) for length in lengths],
            strides=[product(lengths[axis + 1 :], 8) for axis in range(like.ndim)],
            itemsize=ir.Constant(_WORD, 8),
            meminfo=None,
        )
        return array._getvalue()  # noqa: SLF001

    return kind(shape, like), codegen


local: Any = intrinsic(_local)
local_stages: Any = intrinsic(_local_stages)
local_square: Any = intrinsic(_local_square)


def _call(
    typing: Any, place: Any, shape: Any, t: Any, w: Any, state: Any, log: Any, seg: Any, plan: Any, ticks: Any
) -> Emission:
    """The result of the specialised kernel or part at an address.

    Its arguments are passed as pointers, so that the caller need not know its shape.
    """

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        kinds = signature.args[1:]
        code = context.call_conv.get_function_type(types.int64, kinds).as_pointer()
        leaf = builder.inttoptr(arguments[0], code)
        _, result = context.call_conv.call_function(builder, leaf, types.int64, kinds, arguments[1:])
        return result

    return types.int64(types.int64, shape, t, w, state, log, seg, plan, types.int64), codegen


call: Any = intrinsic(_call)
