"""A controller whose `update` is compiled: the same answers, to the last bit, without Python.

What can be translated (`translate`) is compiled without leave to fuse or to reorder, so that it rounds as
Python does. Where Python would have raised, or a value is not finite, it declines, and nothing has changed: who asked
then asks the controller itself. Before it is trusted it has to give the answers that the controller has given.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numba import typeof as _typeof
from numba import types

from rig.controllers.blocks.base import Controller, State, Values, hears
from rig.controllers.runtime.body import Untranslatable
from rig.controllers.runtime.translate import Translated, fact, found, translate, words
from rig.kernel import announce_compiling, as_python, called_by_address

typeof: Any = _typeof
_MADE: dict[Any, Any] = {}
"""What was compiled in this process, None where it failed: (update function, facts, type of the state) -> code."""


class Native:
    """The compiled `update` of a controller that is in `state`. Raises Untranslatable.

    `address` is that of `answer(line, t_ns, heard, command, memory)`, a function of C: 1, or 0 where it declines.
    `memory`: address of what it keeps, which are the controller's words and its state.
    """

    def __init__(self, controller: Controller, state: State) -> None:
        if hears(controller):
            raise Untranslatable("it hears every sample")
        self._shape = _Shape(state)
        self._paths, self._facts, self._code = _made(controller, state, self._shape)
        self._first = len(words(controller, self._paths))
        self.memory = np.zeros(max(self._first + self._shape.size, 1))
        self._whole = self.memory.view(np.int64)
        self.address: int = self._code.address
        self._controller: Controller | None = None
        self._call = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 5)(self.address)

    def take(self, controller: Controller, state: State) -> bool:
        """Go on as this controller, which may have been retuned, from this state; False if the text does not hold."""
        if controller is not self._controller:
            if not all(_holds(controller, path, told) for path, told in self._facts):
                return False
            self._controller = controller
            self._lay(words(controller, self._paths), 0)
        if not self._shape.fits(state):
            return False
        self._lay(_leaves(state), self._first)
        return True

    def _lay(self, values: Iterable[float | int], first: int) -> None:
        for at, value in enumerate(values, first):
            (self._whole if isinstance(value, int) else self.memory)[at] = value

    def state(self) -> State:
        """The state that it has come to."""
        return self._shape.built(self.memory, self._whole, self._first)

    def agrees(self, t_ns: int, values: Sequence[float], command: Values, state: State) -> bool:
        """Whether it comes from `values` to this command and state, to the last bit."""
        heard, answer = np.array(values, dtype=np.float64), np.zeros(len(command))
        answers = self._call(0, t_ns, heard.ctypes.data, answer.ctypes.data, self.memory.ctypes.data)
        given = np.array(command, dtype=np.float64)
        return bool(answers) and answer.tobytes() == given.tobytes() and repr(self.state()) == repr(state)


class _Shape:
    """How a state is laid out in words."""

    def __init__(self, state: State) -> None:
        self._like = state
        self.size = sum(1 for _ in _leaves(state))

    def fits(self, state: State) -> bool:
        """Whether a state is laid out so."""
        return _alike(self._like, state)

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
        """The same as an expression of `_r` and `_i`; `names`: classes that it speaks of."""
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

    def leaves(self, name: str) -> Iterator[tuple[str, bool]]:
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


def _leaves(state: State) -> Iterator[float | int]:
    if isinstance(state, tuple):
        for entry in state:
            yield from _leaves(entry)
    elif isinstance(state, complex):
        yield from (state.real, state.imag)
    elif isinstance(state, int | float):
        yield int(state) if isinstance(state, int) else state
    else:
        raise Untranslatable(f"its state holds a {type(state).__name__}")


def _alike(a: State, b: State) -> bool:
    if type(a) is not type(b):
        return False
    return not isinstance(a, tuple) or (len(a) == len(b) and all(map(_alike, a, b)))


def _made(controller: Any, state: State, shape: _Shape) -> tuple[Any, Any, Any]:
    """Paths of its words, facts that it depends on, compiled code."""
    key = type(controller).update, typeof(state)
    for paths, facts, code in _MADE.setdefault(key, []):
        if all(_holds(controller, path, told) for path, told in facts):
            if code is None:
                raise Untranslatable("it could not be compiled before")
            return paths, facts, code
    translated = translate(controller)
    try:
        with announce_compiling(f"controllers of class {type(controller).__name__}"):
            code = _compiled(controller, translated, state, shape)
    except Exception as error:
        _MADE[key].append((translated.paths, translated.facts, None))
        raise Untranslatable(str(error).partition("\n")[0]) from error
    _MADE[key].append((translated.paths, translated.facts, code))
    return translated.paths, translated.facts, code


def _holds(controller: Any, path: tuple[str, ...], told: Any) -> bool:
    try:
        return bool(fact(found(controller, path)) == told)
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
    """The text of `answer`: what is heard and remembered in, what is answered and remembered out, if it can be used."""
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
    words_out = list(shape.leaves("state"))
    for text in [f"isnan({text})" for text, real in words_out if real] + [
        f"not isfinite(given[{k}])" for k in range(drives)
    ]:
        lines += [f"if {text}:", "    return 0"]
    lines += [f"_c[{k}] = given[{k}]" for k in range(drives)]
    lines += [f"{'_r' if real else '_i'}[{at}] = {text}" for at, (text, real) in enumerate(words_out, first)]
    return "\n    ".join(["def answer(line, t_ns, heard, command, memory):", *lines, "return 1", ""])
