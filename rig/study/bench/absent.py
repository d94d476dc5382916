"""What an effect costs that is not there: the inner kernel of the forces beside a twin whose source never knew of it.

Products of states (geometry that bends, moving contacts) are the one kind of effect that kernels have code for; all
others are rows of tables. The twin is `rig.solve.forces.fill` without the lines that evaluate products, compiled the
same way; a rig without products must not be able to tell one from the other.
"""

from __future__ import annotations

import inspect
import re
import textwrap
import time
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numba
import numpy as np

from rig.kernel import inner, kernel
from rig.scenes.loader import load
from rig.solve import forces
from rig.solve.slots import Slots
from rig.solve.system import CLOSED, SLIP_PLUS

CALLS = 50_000
ROUNDS = 80
_SYMBOL = re.compile(r"[_.$A-Za-z][\w.$@]*\(%rip\)|\.L\w+|_ZN\S+")
_PRODUCTS = re.compile(r"^\s*(early|late)\(.*\)\n", re.MULTILINE)


def kernels() -> tuple[Any, Any]:
    """`fill` called again and again (field, x, times), and its twin; for other kernels to call."""
    fill: Any = forces.fill
    source = textwrap.dedent(inspect.getsource(fill.py_func))
    bare = _PRODUCTS.sub("", source)
    assert len(bare) < len(source)
    return _compiled("own", source), _compiled("twin", bare)


def _compiled(name: str, source: str) -> Any:
    """A kernel that calls the `fill` of this source; from a file of its own, because the cache wants one."""
    path = Path(mkdtemp()) / f"{name}.py"
    path.write_text(f"{source}\n\ndef repeated(f, x, times):\n    for _ in range(times):\n        fill(f, x)\n")
    known = {key: value for key, value in vars(forces).items() if not key.startswith("__")}
    names: dict[str, Any] = {**known, "__name__": name, "__file__": str(path)}
    exec(compile(path.read_text(), str(path), "exec"), names)
    return inner(names["repeated"])


def arguments() -> tuple[Any, Any]:
    """The field of a mass on a belt under a falling law, and a state in slip."""
    system = load("belt").assemble().system()
    slots = Slots(system, 1e-3, [])
    slots.add(system.key([SLIP_PLUS], [CLOSED], []))
    t, slot = slots.tables, len(slots.sets) - 1
    count = int(t.guards[slot])
    field = forces.Field(
        t.A[slot], t.b[slot], t.sigma[slot], t.code[slot], t.numbers[slot], t.pace[slot], t.bear[slot],
        t.bear_t[slot], int(t.coupled[slot]), np.zeros(system.inputs), np.zeros((len(system.patches),) * 2),
        t.G[slot, :count], t.GT[slot, :count], t.needs[slot, :count], t.products, slot, None,
    )  # fmt: skip
    x = system.start.copy()
    x[1] = 0.2
    return field, x


def instructions(function: Any, *examples: Any) -> list[str]:
    """The instructions of a kernel compiled for arguments like these, names of symbols left out."""
    typed: Any = numba.typeof
    function.compile(tuple(map(typed, examples)))
    [text] = function.inspect_asm().values()
    lines = [line.split("#")[0].strip() for line in text.partition("cpython")[0].splitlines()]
    return [_SYMBOL.sub("*", line) for line in lines if line and line[0] != "." and line[-1] != ":"]


def cost() -> dict[str, float]:
    """Ns of a call of both, in turns, best of rounds, and their ratio."""
    field, x = arguments()
    pair = tuple(map(_called, kernels()))
    best = [np.inf, np.inf]
    for one in pair:
        one(field, x, 1)
    for _ in range(ROUNDS):
        for i, one in enumerate(pair):
            begin = time.perf_counter()
            one(field, x, CALLS)
            best[i] = min(best[i], (time.perf_counter() - begin) / CALLS * 1e9)
    return {"ns": float(best[0]), "ns_without": float(best[1]), "ratio": float(best[0] / best[1])}


def _called(repeated: Any) -> Any:
    def call(f: Any, x: Any, times: int) -> None:
        repeated(f, x, times)

    return kernel(call)
