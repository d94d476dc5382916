"""Formulas of a part, plain functions of numbers, as a C function that kernels call by its address.

The functions that a formula calls are compiled with it: they need no decorator. Everything is inlined into one C
function: its bits do not depend on what else is loaded. It is stored on disk under a hash of all that it was made of.
"""

from __future__ import annotations

import builtins
import dis
import hashlib
import math
from collections.abc import Callable, Iterator, Mapping
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numba
import numpy as np
from numba import carray  # type: ignore[attr-defined]
from numba.core.ccallback import CFunc

from rig.compiled.kernel import FOLDER, inlined

_LIBRARIES = {math.__name__, np.__name__, numba.__name__, builtins.__name__}
"""Packages that the versions of Python and numba stand for."""
_NUMBERS = numba.types.CPointer(numba.types.float64)  # type: ignore[no-untyped-call]
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}


class Uncompilable(Exception):
    """Raised for a formula that cannot be compiled, with the reason and the (file, line) pairs that it names."""


def converted(function: Any, how: Callable[[FunctionType], Any]) -> Any:
    """`how(function)`, and likewise all functions that it calls by their names in its module: decorated ones without
    what decorates them.
    """
    return _converted(function, how, {})


def plain(function: Any) -> Any:
    """A formula in Python, with the functions that it calls."""
    return converted(function, lambda own: own)


def _converted(function: Any, how: Callable[[FunctionType], Any], known: dict[int, Any]) -> Any:
    own: FunctionType = getattr(function, "py_func", function)
    if id(own) in known:
        return known[id(own)]
    copied = FunctionType(own.__code__, dict(own.__globals__), own.__name__, own.__defaults__, own.__closure__)
    copied.__module__ = own.__module__
    copied.__qualname__ = own.__qualname__
    known[id(own)] = copied  # a function that calls itself: the compiler refuses it
    for name, called in _named(own):
        if _is_formula(called):
            copied.__globals__[name] = _converted(called, how, known)
    known[id(own)] = how(copied)
    return known[id(own)]


def _is_formula(what: Any) -> bool:
    own = getattr(what, "py_func", what)
    return isinstance(own, FunctionType) and own.__module__.partition(".")[0] not in _LIBRARIES


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _named(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """The globals that a function names."""
    names = {name for code in _codes(function.__code__) for name in code.co_names}
    return ((name, function.__globals__[name]) for name in sorted(names) if name in function.__globals__)


def raised_lines(function: Any) -> set[int]:
    """The lines that raise an exception (`raise`, `assert`), in a formula and in the functions that it calls."""
    lines = set[int]()

    def look(own: FunctionType) -> FunctionType:
        for code in _codes(own.__code__):
            for step in dis.get_instructions(code):
                if step.opname == "RAISE_VARARGS" and step.positions is not None:
                    lines.add(step.positions.lineno or code.co_firstlineno)
        return own

    converted(function, look)
    return lines


def _described(what: Any, told: set[int]) -> str:
    """All that the compiled form of a global of a formula depends on. Raises TypeError for what cannot be described."""
    own = getattr(what, "py_func", what)
    if isinstance(own, FunctionType):
        if own.__module__.partition(".")[0] in _LIBRARIES or id(own) in told:
            return f"{own.__module__}.{own.__qualname__}"
        told.add(id(own))
        if own.__closure__:
            raise TypeError("a closure")
        parts = []
        for code in _codes(own.__code__):
            parts.append(f"{code.co_code.hex()} {_constants(code)} {code.co_names} {code.co_varnames}")
        parts.append(repr(own.__defaults__))
        parts += [f"{name} = {_described(value, told)}" for name, value in _named(own)]
        return " ".join(parts)
    if isinstance(what, ModuleType) and what.__name__.partition(".")[0] in _LIBRARIES:
        return what.__name__
    if what is None or isinstance(what, bool | int | float | str):
        return repr(what)
    if isinstance(what, tuple | frozenset):
        return f"{type(what).__name__}({', '.join(_described(entry, told) for entry in what)})"
    if isinstance(what, type) and issubclass(what, tuple):
        return f"{what.__qualname__}{getattr(what, '_fields', ())}"
    if type(what).__module__.partition(".")[0] in _LIBRARIES or isinstance(what, type):
        name = getattr(what, "__qualname__", getattr(what, "__name__", ""))
        if name:
            return f"{what.__module__}.{name}"
    raise TypeError(type(what).__name__)


def _constants(code: CodeType) -> str:
    return repr([constant for constant in code.co_consts if not isinstance(constant, CodeType)])


def c_function(name: str, text: str, formulas: Mapping[str, Any], names: Mapping[str, Any]) -> Any:
    """Compile the function `name` of the source `text` as void(double *p, double w, double N, double *z, double *out).

    `formulas`: plain functions that it calls; `names`: its other globals. The result has the `address`, and the code
    stays as long as it exists. Raises Uncompilable.
    """
    told = set[int]()
    try:
        parts = [f"{key} = {_described(entry, told)}" for key, entry in sorted({**formulas, **names}.items())]
        key = hashlib.sha256("\n".join([text, *parts]).encode()).hexdigest()[:32]
        stored = True
    except TypeError:  # what numba captures is not known: compiled at every start
        key = hashlib.sha256(f"{text} {id(formulas)}".encode()).hexdigest()[:32]
        stored = False
    made: dict[str, Any] = {"__name__": __name__, "carray": carray, **names}
    exec(compile(text, __file__, "exec", dont_inherit=True), made)
    function: FunctionType = made[name]
    function.__qualname__ = f"{name}_{key}"  # no other symbol has this name
    signature = (_NUMBERS, numba.types.float64, numba.types.float64, _NUMBERS, _NUMBERS), numba.types.void
    answer: Any = CFunc(function, signature, {}, dict(_OPTIONS))  # type: ignore[no-untyped-call]
    answer.py_func = function
    if stored:
        FOLDER.keep(answer, beside_sources=False, by_address=True)
    function.__globals__.update({key: converted(formula, inlined) for key, formula in formulas.items()})
    try:
        answer.compile()
    except Exception as error:  # numba's own faults too: what it cannot compile must not end the program
        raise Uncompilable(str(error)) from error
    return answer
