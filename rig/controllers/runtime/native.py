"""A controller with compiled `update`: the same answers as in Python, to the last bit.

The translation (`translate`) is compiled without fused or reordered operations, so it rounds as Python does. If Python
would raise an exception, or a value is not finite, the compiled code declines and changes nothing; the caller then
calls the controller itself. Before the compiled code is used, it has to reproduce answers of the controller.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numba import typeof as _typeof
from numba import types

from rig.controllers.blocks.base import Controller, State, Values, gets_every_sample
from rig.controllers.runtime.body import Untranslatable
from rig.controllers.runtime.translate import Translated, fact, found, translate, words
from rig.kernel import announce_compiling, as_python, called_by_address

typeof: Any = _typeof
_COMPILED: dict[Any, Any] = {}
"""Code compiled in this process: (update function, facts, type of the state) -> code, or None if compiling failed."""


class Native:
    """The compiled `update` of a controller in `state`. Raises Untranslatable if there is no translation.

    `address`: address of the C function `answer(line, t_ns, heard, command, memory)`; it returns 0 if it declines.
    `memory`: address of the controller's words and its state.
    """

    def __init__(self, controller: Controller, state: State) -> None:
        if gets_every_sample(controller):
            raise Untranslatable("it gets every sample of its sensors")
        self._shape = _Shape(state)
        self._paths, self._facts, self._code = _compiled_code(controller, state, self._shape)
        self._first = len(words(controller, self._paths))
        self.memory = np.zeros(max(self._first + self._shape.size, 1))
        self._whole = self.memory.view(np.int64)
        self.address: int = self._code.address
        self._controller: Controller | None = None
        self._call = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 5)(self.address)

    def resume(self, controller: Controller, state: State) -> bool:
        """Continue as this controller (it may have been retuned) from this state; False if the code does not fit it."""
        if controller is not self._controller:
            if not all(_holds(controller, path, expected) for path, expected in self._facts):
                return False
            self._controller = controller
            self._write_words(words(controller, self._paths), 0)
        if not self._shape.fits(state):
            return False
        self._write_words(_state_words(state), self._first)
        return True

    def _write_words(self, values: Iterable[float | int], first: int) -> None:
        for at, value in enumerate(values, first):
            (self._whole if isinstance(value, int) else self.memory)[at] = value

    def state(self) -> State:
        """The present state."""
        return self._shape.built(self.memory, self._whole, self._first)

    def reproduces(self, t_ns: int, values: Sequence[float], command: Values, state: State) -> bool:
        """Whether an update with `values` gives this command and state, to the last bit."""
        heard, answer = np.array(values, dtype=np.float64), np.zeros(len(command))
        answers = self._call(0, t_ns, heard.ctypes.data, answer.ctypes.data, self.memory.ctypes.data)
        given = np.array(command, dtype=np.float64)
        return bool(answers) and answer.tobytes() == given.tobytes() and repr(self.state()) == repr(state)


class _Shape:
    """The layout of a state in words."""

    def __init__(self, state: State) -> None:
        self._like = state
        self.size = sum(1 for _ in _state_words(state))

    def fits(self, state: State) -> bool:
        """Whether a state has this layout."""
        return _equal(self._like, state)

    def built(self, real: Any, whole: Any, first: int) -> State:
        """The state in the words from `first` on."""
        values = iter(range(first, first + self.size))

        def one(like: Any) -> Any:
            if isinstance(like, tuple):
                entries = [one(entry) for entry in like]
                return type(like)(*entries) if hasattr(like, "_fields") else tuple(entries)
            if isinstance(like, complex):
                return complex(real[next(values)], real[next(values)])
            at = next(values)
            return type(like)(whole[at]) if isinstance(like, int) else float(real[at])

        return one(self._like)

    def read(self, first: int, names: dict[str, Any]) -> str:
        """The state as an expression of `_r` and `_i`; adds the classes in it to `names`."""
        at = iter(range(first, first + self.size))

        def one(like: Any) -> str:
            if isinstance(like, tuple):
                entries = "".join(f"{one(entry)}, " for entry in like)
                if not hasattr(like, "_fields"):
                    return f"({entries})"
                name = type(like).__name__
                if names.setdefault(name, type(like)) is not type(like):
                    raise Untranslatable(f"{name} has two meanings")
                return f"{name}({entries})"
            if isinstance(like, complex):
                return f"complex(_r[{next(at)}], _r[{next(at)}])"
            if isinstance(like, bool):
                return f"(_i[{next(at)}] != 0)"
            return f"_i[{next(at)}]" if isinstance(like, int) else f"_r[{next(at)}]"

        return one(self._like)

    def words(self, name: str) -> Iterator[tuple[str, bool]]:
        """Expressions of all words of the state called `name`, and whether each is a number."""

        def one(like: Any, text: str) -> Iterator[tuple[str, bool]]:
            if isinstance(like, tuple):
                for k, entry in enumerate(like):
                    yield from one(entry, f"{text}[{k}]")
            elif isinstance(like, complex):
                yield f"{text}.real", True
                yield f"{text}.imag", True
            else:
                yield text, not isinstance(like, int)

        return one(self._like, name)


def _state_words(state: State) -> Iterator[float | int]:
    if isinstance(state, tuple):
        for entry in state:
            yield from _state_words(entry)
    elif isinstance(state, complex):
        yield from (state.real, state.imag)
    elif isinstance(state, int | float):
        yield int(state) if isinstance(state, int) else state
    else:
        raise Untranslatable(f"its state holds a {type(state).__name__}")


def _equal(a: State, b: State) -> bool:
    if type(a) is not type(b):
        return False
    return not isinstance(a, tuple) or (len(a) == len(b) and all(map(_equal, a, b)))


def _compiled_code(controller: Any, state: State, shape: _Shape) -> tuple[Any, Any, Any]:
    """Paths of the words, facts on which the code depends, compiled code."""
    key = type(controller).update, typeof(state)
    for paths, facts, code in _COMPILED.setdefault(key, []):
        if all(_holds(controller, path, expected) for path, expected in facts):
            if code is None:
                raise Untranslatable("it could not be compiled before")
            return paths, facts, code
    translated = translate(controller)
    try:
        with announce_compiling(f"controllers of class {type(controller).__name__}"):
            code = _compiled(controller, translated, state, shape)
    except Exception as error:
        _COMPILED[key].append((translated.paths, translated.facts, None))
        raise Untranslatable(str(error).partition("\n")[0]) from error
    _COMPILED[key].append((translated.paths, translated.facts, code))
    return translated.paths, translated.facts, code


def _holds(controller: Any, path: tuple[str, ...], expected: Any) -> bool:
    try:
        return bool(fact(found(controller, path)) == expected)
    except (AttributeError, IndexError):
        return False


def _compiled(controller: Any, translated: Translated, state: State, shape: _Shape) -> Any:
    names: dict[str, Any] = {**translated.names}
    first = len(words(controller, translated.paths))
    entry = _wrapped(controller, translated, shape, first, names)
    for name, text in translated.functions.items():
        exec(text, names)
        names[name] = as_python(names[name])
    update = names[next(reversed(translated.functions))]
    array = types.Array(types.float64, 1, "C")
    heard = typeof((0.0,) * len(controller.reads))
    kinds = array, types.Array(types.int64, 1, "C"), typeof(state), types.int64, heard
    update.compile(kinds)
    returned: Any = update.overloads[kinds].signature.return_type
    if list(getattr(returned, "types", ()))[:1] != [typeof(state)]:
        raise Untranslatable(f"its state does not keep its type: {returned}")
    if len(returned[1]) != len(controller.drives):
        raise Untranslatable("it does not command its actuators")
    exec(entry, names)
    return called_by_address(names["answer"])


def _wrapped(controller: Any, translated: Translated, shape: _Shape, first: int, names: dict[str, Any]) -> str:
    """The source text of `answer`: it reads measurements and state, and writes command and state if both are finite."""
    from numba import carray  # type: ignore[attr-defined]

    reads, drives = len(controller.reads), len(controller.drives)
    names |= {"carray": carray, "isfinite": math.isfinite, "isnan": math.isnan, "int64": np.int64}
    update = next(reversed(translated.functions))
    measured = "".join(f"_h[{k}], " for k in range(reads))
    lines = [
        f"_r = carray(memory, ({max(first + shape.size, 1)},))",
        "_i = _r.view(int64)",
        f"_h = carray(heard, ({max(reads, 1)},))",
        f"_c = carray(command, ({drives},))",
        f"for k in range({reads}):",
        "    if not isfinite(_h[k]):",
        "        return 0",
        "try:",
        f"    made = {update}(_r, _i, {shape.read(first, names)}, t_ns, ({measured}))",
        "except Exception:",
        "    return 0",
        "state, given = made",
    ]
    words_out = list(shape.words("state"))
    for text in [f"isnan({text})" for text, real in words_out if real] + [
        f"not isfinite(given[{k}])" for k in range(drives)
    ]:
        lines += [f"if {text}:", "    return 0"]
    lines += [f"_c[{k}] = given[{k}]" for k in range(drives)]
    lines += [f"{'_r' if real else '_i'}[{at}] = {text}" for at, (text, real) in enumerate(words_out, first)]
    return "\n    ".join(["def answer(line, t_ns, heard, command, memory):", *lines, "return 1", ""])
