"""The formulas of a friction law as C functions, which kernels call (rig.model.friction_law.Formula)."""

from __future__ import annotations

import inspect
import re
from collections import namedtuple
from collections.abc import Iterator, Sequence
from functools import cache
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from rig.compiled.c_functions import Uncompilable, c_function, plain, raised_lines
from rig.errors import PartError
from rig.model.friction_law import Formula, InternalState
from rig.parts import calling, file_of
from rig.units import brief

STATIC = {"mu": "mu(p, w)", "slope": "slope(p, w)"}
"""Formulas of a law without internal states, as a message shows them."""
MEMORY = {"mu": "mu(p, w, N, z)", "rates": "rates(p, w, N, z, dz)", "slopes": "slopes(p, w, N, z, d)"}
"""Those of a law with internal states; `stored` may be absent."""
STORED = "stored(p, N, z)"
_WHY = {
    "slope": "the derivative of mu with respect to w, which rig modes and the stability report need",
    "slopes": "the derivatives of mu and of the rates, which rig modes and implicit steps need",
    "rates": "the rates of its internal states",
    "mu": "the coefficient of friction",
}
_LOST = "0.0 / 0.0"
"""No number: the coefficient where a formula fails in compiled code, which writes nothing then and goes on."""
_LINE = re.compile(r'File "(.*?)", line (\d+)')


class Shape(NamedTuple):
    """How the numbers of a law are built: `kind` is "float", "int" or "bool", or a tuple class with its `entries`."""

    kind: Any
    entries: tuple[Shape, ...] = ()


def shape_of(value: Any) -> Shape:
    """The shape of the numbers of a law. Raises TypeError for what is no number or tuple of numbers."""
    if isinstance(value, tuple):
        return Shape(type(value), tuple(shape_of(entry) for entry in value))
    for kind in (bool, int, float):
        if isinstance(value, kind):
            return Shape(kind.__name__)
    raise TypeError(brief(value))


def flat(value: Any) -> Iterator[float]:
    """The numbers of a law, one after the other."""
    if isinstance(value, tuple):
        for entry in value:
            yield from flat(entry)
    else:
        yield float(value)


def _text(shape: Shape, names: dict[str, Any], next_number: Iterator[int]) -> str:
    """The source text that builds numbers of `shape` from the array `_p`."""
    if not isinstance(shape.kind, type):
        number = f"_p[{next(next_number)}]"
        return {"float": number, "int": f"int({number})", "bool": f"({number} != 0.0)"}[shape.kind]
    inside = "".join(f"{_text(entry, names, next_number)}, " for entry in shape.entries)
    if not hasattr(shape.kind, "_fields"):
        return f"({inside})"
    name = f"_tuple_{len(names)}"
    names[name] = shape.kind
    return f"{name}({inside})"


def formulas_of(kind: type) -> dict[str, Any]:
    """The formulas that the class of a law defines, as functions."""
    named = [*STATIC, *MEMORY, "stored"]
    return {name: inspect.getattr_static(kind, name).__func__ for name in dict.fromkeys(named) if hasattr(kind, name)}


def lacking(kind: type, memory: bool) -> list[str]:
    """What is wrong with the formulas that a class defines, a line each."""
    expected = dict(MEMORY if memory else STATIC)
    lines = []
    for name, call in expected.items():
        if not hasattr(kind, name):
            lines.append(f"{kind.__name__} defines no {call}: {_WHY[name]}")
    if memory and hasattr(kind, "stored"):
        expected["stored"] = STORED
    for name, call in expected.items():
        if hasattr(kind, name):
            own = inspect.getattr_static(kind, name)
            if not isinstance(own, staticmethod):
                lines.append(f"{kind.__name__}.{name} is no static method; write @staticmethod above def {call}")
            elif len(inspect.signature(own.__func__).parameters) != call.count(",") + 1:
                wanted = "a law with internal states" if memory else "a law without internal states"
                lines.append(f"{kind.__name__}.{name} takes other arguments; {wanted} defines {call}")
    return lines


@cache
def numbers_class(kind: type, fields: tuple[str, ...]) -> Any:
    """The named tuple of the values of a law that defines no `numbers` of its own."""
    return namedtuple(f"{kind.__name__}Numbers", fields)


def formula_of(kind: type, module: ModuleType, shape: Shape, states: Sequence[InternalState], sticks: bool) -> Formula:
    """The compiled formulas of a law. Raises PartError, with file and line, for what numba cannot compile."""
    return _formula(kind, module, shape, tuple(states), sticks)


@cache
def _formula(kind: type, module: ModuleType, shape: Shape, states: tuple[InternalState, ...], sticks: bool) -> Formula:
    functions = formulas_of(kind)
    m = len(states)
    names: dict[str, Any] = {}
    counted = iter(range(1_000_000))
    numbers = _text(shape, names, counted)
    head = [f"_p = carray(_p, ({max(next(counted), 1)},))", f"p = {numbers}"]
    if m:
        head.append(f"z = carray(_z, ({m},))")
    values = [*head, f"out = carray(_out, ({m + 2},))"]
    slopes = [*head, f"out = carray(_out, ({m + 1}, {m + 2}))"]
    if m:
        stored = "stored(p, N, z)" if "stored" in functions else "0.0"
        values += [
            f"out[0] = {_LOST}",
            "out[0] = mu(p, w, N, z)",
            f"for i in range({m}):",
            "    out[1 + i] = 0.0",
            f"rates(p, w, N, z, out[1:{m + 1}])",
            f"out[{m + 1}] = {stored}",
        ]
        slopes += [
            f"for i in range({m + 1}):",
            f"    for j in range({m + 2}):",
            "        out[i, j] = 0.0",
            "slopes(p, w, N, z, out)",
        ]
    else:
        values += [f"out[0] = {_LOST}", "out[0] = mu(p, w)", "out[1] = 0.0"]
        slopes += [f"out[0, 0] = {_LOST}", "out[0, 0] = slope(p, w)", "out[0, 1] = 0.0"]
    made = []
    for name, lines in (("values", values), ("slopes", slopes)):
        text = "\n    ".join([f"def {name}(_p, w, N, _z, _out):", *lines]) + "\n"
        called = {formula: function for formula, function in functions.items() if f"{formula}(" in text}
        try:
            made.append(c_function(name, text, called, names))
        except Uncompilable as error:
            raise PartError(_refused(str(error), functions, module)) from error
    return Formula(made[0].address, made[1].address, states, sticks, keeps=made)


def _refused(message: str, functions: dict[str, Any], module: ModuleType) -> str:
    """What numba says of a formula, in a line: file, line, reason."""
    files = {function.__code__.co_filename for function in functions.values()}
    lines = [int(line) for file, line in _LINE.findall(message) if file in files]
    texts = [line.strip() for line in message.splitlines() if line.strip()]
    reasons = [
        line for line in texts if not line.startswith(("Failed in", "During:", "File ", "- ", "<source", "def "))
    ]
    where = f" (line {lines[-1]})" if lines else ""
    return f"{file_of(module)}: numba cannot compile a formula: {' '.join(reasons[:2])}{where}"


def try_in_python(kind: type, module: ModuleType, numbers: Any, states: Sequence[InternalState]) -> None:
    """Run the formulas once in Python, where what fails has its line. Raises PartError."""
    functions = formulas_of(kind)
    m = len(states)
    for name, function in functions.items():
        if lines := raised_lines(function):
            what = f"{name} raises an exception (line {min(lines)}), which compiled code loses"
            raise PartError(f"{file_of(module)}: {what}; return a number for every slip speed from 0 to 100 m/s")
    z = np.array([state.start for state in states])
    for w in (0.0, 1e-6, 1e-2, 1.0, 100.0):
        own: dict[str, tuple[Any, ...]] = dict.fromkeys(STATIC, (w,))
        if m:
            own = {"mu": (w, 1.0, z.copy()), "rates": (w, 1.0, z.copy(), np.zeros(m))}
            own |= {"slopes": (w, 1.0, z.copy(), np.zeros((m + 1, m + 2))), "stored": (1.0, z.copy())}
        for name in own:
            if name not in functions:
                continue
            with calling(module), np.errstate(all="ignore"):
                try:
                    value = plain(functions[name])(numbers, *own[name])
                except (ArithmeticError, ValueError):  # infinite or no number in compiled code, which the checks find
                    continue
            if name not in ("rates", "slopes") and not isinstance(value, int | float):
                raise PartError(f"{file_of(module)}: {name} gives {brief(value)}; expected a number")
