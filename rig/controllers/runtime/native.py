"""A controller with a compiled law: the same answers as in Python, to the last bit.

The `update` of such a controller is `functools.partial(law, constants)`: a function of a module and a (named) tuple of
numbers. `law(constants, state, t_ns, values)` and the functions of its module that it calls are compiled without fused
or reordered operations, so they round as Python does. What a compiler rounds differently is refused: powers, `sum`
(compensated in newer Python), most functions of `math`. If Python would raise an exception, or a value is not finite,
the compiled code declines and changes nothing; the caller then calls the controller itself. Before the compiled code is
used, it has to reproduce answers of the controller. `Uncompiled` states why a law has no compiled code; it then runs in
Python, only slower.
"""

from __future__ import annotations

import ctypes
import dis
import math
from collections.abc import Iterator, Sequence
from functools import partial
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
from numba import carray, types  # type: ignore[attr-defined]
from numba import typeof as _typeof
from numba.cpython.unsafe.tuple import tuple_setitem
from numba.extending import overload

from rig.compiled.kernel import announce_compiling, as_python, called_by_address
from rig.controllers.blocks.base import Controller, State, Values, dot, gets_every_sample, mapped

_MATH = {
    "acos",
    "asin",
    "atan",
    "atan2",
    "copysign",
    "cos",
    "cosh",
    "e",
    "exp",
    "expm1",
    "fabs",
    "floor",
    "inf",
    "isfinite",
    "isnan",
    "log",
    "log1p",
    "nan",
    "phase",
    "pi",
    "sin",
    "sinh",
    "sqrt",
    "tan",
    "tanh",
    "tau",
}
_BUILTIN = {"abs", "bool", "complex", "enumerate", "float", "int", "len", "max", "min", "range", "reversed", "zip"}
_OBJECTS = {"BUILD_MAP", "BUILD_CONST_KEY_MAP", "BUILD_STRING", "FORMAT_VALUE", "FORMAT_SIMPLE"}
"""Instructions for what is no number; the compiler would take seconds to find out."""
typeof: Any = _typeof

_COMPILED: dict[Any, Any] = {}
"""Code compiled in this process: (law, types of constants and state) -> code, or the reason why there is none."""


class Uncompiled(Exception):
    """The controller has no compiled law; why."""


@overload(mapped)
def _mapped(like: Any, entry: Any, given: Any, *columns: Any) -> Any:
    entries = ", ".join(f"columns[{k}][i]" for k in range(len(columns)))
    filled = ["for i in range(len(like)):", f"    made = set_entry(made, i, entry({entries}, *given))"]
    head = "def mapped(like: Any, entry: Any, given: Any, *columns: Any) -> Any:"  # as above, which numba compares
    names: dict[str, Any] = {"set_entry": tuple_setitem}
    exec("\n    ".join([head, "made = like", *(filled if len(like) else ()), "return made"]), names)
    return names["mapped"]


@overload(dot)
def _dot(a: Any, b: Any) -> Any:
    if not len(a) or not len(b):
        return lambda a, b: 0.0

    def over_equal_entries(a: Any, b: Any) -> float:
        total = 0.0
        for x, y in zip(a, b):
            total += x * y
        return total

    return over_equal_entries


def law_of(controller: Controller) -> tuple[FunctionType, tuple[Any, ...]]:
    """The law of a controller and its constants. Raises Uncompiled for a controller that is written in another way."""
    update = controller.update
    if gets_every_sample(controller):
        raise Uncompiled("it gets every sample of its sensors")
    if not isinstance(update, partial) or update.keywords or len(update.args) != 1:
        raise Uncompiled("its update is not functools.partial(law, constants)")
    law = update.func
    (constants,) = update.args
    if not isinstance(law, FunctionType):
        raise Uncompiled(f"{law!r} is not a plain function")
    return law, constants


def _for_compiler(function: FunctionType, known: dict[FunctionType, Any]) -> Any:
    """The function with compiled functions in place of those of its module that it calls."""
    if function in known:
        return known[function]
    if function.__closure__:
        raise Uncompiled(f"{function.__qualname__} is not a plain function: it refers to names of another one")
    names = dict(function.__globals__)
    used = list(dis.get_instructions(function))
    of_module = False
    for instruction in used:
        name = str(instruction.argval)
        value = names.get(str(instruction.argval))
        if instruction.opname == "BINARY_OP" and instruction.argrepr.strip("=") in ("**", "@"):
            raise Uncompiled(f"{function.__qualname__} has a power")
        if instruction.opname in _OBJECTS:
            raise Uncompiled(f"{function.__qualname__} makes a text or a dictionary")
        if instruction.opname in ("LOAD_ATTR", "LOAD_METHOD") and of_module and name not in _MATH:
            raise Uncompiled(f"{function.__qualname__} uses {name}, which a compiler may round differently")
        of_module = instruction.opname == "LOAD_GLOBAL" and isinstance(value, ModuleType)
        if instruction.opname != "LOAD_GLOBAL":
            continue
        if of_module and value is not None and value.__name__ not in ("math", "cmath"):
            raise Uncompiled(f"{function.__qualname__} uses {name}")
        if isinstance(value, FunctionType) and value not in (mapped, dot):
            names[name] = _for_compiler(value, known)
        elif name not in names and name not in _BUILTIN:
            raise Uncompiled(f"{function.__qualname__} uses {name}")
    plain = FunctionType(function.__code__, names, function.__name__, function.__defaults__)
    known[function] = as_python(plain)
    return known[function]


class Native:
    """The compiled law of a controller in `state`. Raises Uncompiled if there is none.

    `address`: address of the C function `answer(line, t_ns, heard, command, memory)`; it returns 0 if it declines.
    `memory`: address of the controller's constants and its state.
    """

    def __init__(self, controller: Controller, state: State) -> None:
        self._law, constants = law_of(controller)
        self._constants = _Shape(constants, 0)
        self._state = _Shape(state, sum(1 for _ in _words(constants)))
        self._code = _compiled_code(controller, self._law, self._constants, self._state)
        self.memory = np.zeros(max(self._state.first + self._state.size, 1))
        self._whole = self.memory.view(np.int64)
        self.address: int = self._code.address
        self._controller: Controller | None = None
        self._call = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 5)(self.address)

    def resume(self, controller: Controller, state: State) -> bool:
        """Continue as this controller (it may have been retuned) from this state; False if the code does not fit it."""
        if controller is not self._controller:
            law, constants = law_of(controller)
            if law is not self._law or not self._constants.fits(constants):
                return False
            self._controller = controller
            self._write(constants, 0)
        if not self._state.fits(state):
            return False
        self._write(state, self._state.first)
        return True

    def _write(self, numbers: State, first: int) -> None:
        for at, value in enumerate(_words(numbers), first):
            (self._whole if isinstance(value, int) else self.memory)[at] = value

    def state(self) -> State:
        """The present state."""
        return self._state.built(self.memory, self._whole)

    def reproduces(self, t_ns: int, values: Sequence[float], command: Values, state: State) -> bool:
        """Whether an update with `values` gives this command and state, to the last bit."""
        heard = np.array(values, dtype=np.float64)
        answer = np.zeros(len(command))
        answers = self._call(0, t_ns, heard.ctypes.data, answer.ctypes.data, self.memory.ctypes.data)
        given = np.array(command, dtype=np.float64)
        return bool(answers) and answer.tobytes() == given.tobytes() and repr(self.state()) == repr(state)


class _Shape:
    """The layout of constants or a state in words, from the word `first` on."""

    def __init__(self, like: State, first: int) -> None:
        self.like = like
        self.first = first
        self.size = sum(1 for _ in _words(like))

    def fits(self, numbers: State) -> bool:
        """Whether other numbers have this layout."""
        return _equal(self.like, numbers)

    def built(self, real: Any, whole: Any) -> State:
        """The numbers in the words."""
        places = iter(range(self.first, self.first + self.size))

        def part(like: Any) -> Any:
            if isinstance(like, tuple):
                entries = [part(entry) for entry in like]
                return type(like)(*entries) if hasattr(like, "_fields") else tuple(entries)
            if isinstance(like, complex):
                return complex(real[next(places)], real[next(places)])
            at = next(places)
            return type(like)(whole[at]) if isinstance(like, int) else float(real[at])

        return part(self.like)

    def read(self, names: dict[str, Any]) -> str:
        """The numbers as an expression of the words `_r` and `_i`; adds the classes in it to `names`."""
        places = iter(range(self.first, self.first + self.size))

        def part(like: Any) -> str:
            if isinstance(like, tuple):
                entries = "".join(f"{part(entry)}, " for entry in like)
                if not hasattr(like, "_fields"):
                    return f"({entries})"
                name = f"_{type(like).__name__}_{id(type(like))}"
                names[name] = type(like)
                return f"{name}({entries})"
            if isinstance(like, complex):
                return f"complex(_r[{next(places)}], _r[{next(places)}])"
            if isinstance(like, bool):
                return f"(_i[{next(places)}] != 0)"
            return f"_i[{next(places)}]" if isinstance(like, int) else f"_r[{next(places)}]"

        return part(self.like)

    def words(self, name: str) -> Iterator[tuple[str, bool]]:
        """Expressions of all words of the numbers called `name`, and whether each is a floating-point number."""

        def part(like: Any, text: str) -> Iterator[tuple[str, bool]]:
            if isinstance(like, tuple):
                for k, entry in enumerate(like):
                    yield from part(entry, f"{text}[{k}]")
            elif isinstance(like, complex):
                yield f"{text}.real", True
                yield f"{text}.imag", True
            else:
                yield text, not isinstance(like, int)

        return part(self.like, name)


def _words(numbers: State) -> Iterator[float | int]:
    if isinstance(numbers, tuple):
        for entry in numbers:
            yield from _words(entry)
    elif isinstance(numbers, complex):
        yield from (numbers.real, numbers.imag)
    elif isinstance(numbers, int | float):
        yield int(numbers) if isinstance(numbers, int) else numbers
    else:
        raise Uncompiled(f"its constants or its state hold a {type(numbers).__name__}")


def _equal(a: State, b: State) -> bool:
    if type(a) is not type(b):
        return False
    return not isinstance(a, tuple) or (len(a) == len(b) and all(map(_equal, a, b)))


def _compiled_code(controller: Controller, law: FunctionType, constants: _Shape, state: _Shape) -> Any:
    key = law, typeof(constants.like), typeof(state.like), len(controller.reads), len(controller.drives)
    if key not in _COMPILED:
        try:
            with announce_compiling(f"controllers of class {type(controller).__name__}"):
                _COMPILED[key] = _compiled(controller, law, constants, state)
        except Exception as error:
            _COMPILED[key] = Uncompiled(str(error).partition("\n")[0])
    if isinstance(_COMPILED[key], Uncompiled):
        raise _COMPILED[key]
    return _COMPILED[key]


def _compiled(controller: Controller, law: FunctionType, constants: _Shape, state: _Shape) -> Any:
    compiled = _for_compiler(law, {})
    kinds = typeof(constants.like), typeof(state.like), types.int64, typeof((0.0,) * len(controller.reads))
    compiled.compile(kinds)
    returned: Any = compiled.overloads[kinds].signature.return_type
    if list(getattr(returned, "types", ()))[:1] != [typeof(state.like)]:
        raise Uncompiled(f"its state does not keep its type: {returned}")
    if len(returned[1]) != len(controller.drives):
        raise Uncompiled("it does not command its actuators")
    names: dict[str, Any] = {"law": compiled, "carray": carray, "isfinite": math.isfinite, "isnan": math.isnan}
    names["int64"] = np.int64
    exec(_wrapped(controller, constants, state, names), names)
    return called_by_address(names["answer"])


def _wrapped(controller: Controller, constants: _Shape, state: _Shape, names: dict[str, Any]) -> str:
    """The source text of `answer`: it reads measurements and state, and writes command and state if both are finite."""
    reads = len(controller.reads)
    drives = len(controller.drives)
    measured = "".join(f"_h[{k}], " for k in range(reads))
    words_out = list(state.words("state"))
    lines = [
        f"_r = carray(memory, ({max(state.first + state.size, 1)},))",
        "_i = _r.view(int64)",
        f"_h = carray(heard, ({max(reads, 1)},))",
        f"_c = carray(command, ({drives},))",
        f"for k in range({reads}):",
        "    if not isfinite(_h[k]):",
        "        return 0",
        f"constants = {constants.read(names)}",
        f"before = {state.read(names)}",
        "try:",
        f"    made = law(constants, before, t_ns, ({measured}))",
        "except Exception:",
        "    return 0",
        "state, given = made",
    ]
    for text in [f"isnan({text})" for text, real in words_out if real] + [
        f"not isfinite(given[{k}])" for k in range(drives)
    ]:
        lines += [f"if {text}:", "    return 0"]
    lines += [f"_c[{k}] = given[{k}]" for k in range(drives)]
    lines += [f"{'_r' if real else '_i'}[{at}] = {text}" for at, (text, real) in enumerate(words_out, state.first)]
    return "\n    ".join(["def answer(line, t_ns, heard, command, memory):", *lines, "return 1", ""])
