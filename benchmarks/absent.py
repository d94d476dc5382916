"""The cost of an absent effect: the inner force function beside a twin compiled without the effect's source.

Products of states (nonlinear geometry, moving contacts) are the only kind of effect with code of its own in the inner
functions; all others are rows of tables. The twin is `rig.solve.runge_kutta_stage.derivative` that never asks for
products, compiled the same way. For a rig without products both must take the same time.
"""

from __future__ import annotations

import inspect
import re
import textwrap
from functools import partial
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numba

from benchmarks.kernels import interleaved
from rig.compiled.kernel import entry, inner, kernel
from rig.compiled.records import Loan
from rig.motion.motion import Motion
from rig.scenes.loader import load
from rig.solve import forces, runge_kutta_stage
from rig.solve.records import CLOSED, SLIP_PLUS
from rig.solve.specialised import KernelShape, any_shape, call

CALLS = 50_000
ROUNDS = 80
_SYMBOL = re.compile(r"[_.$A-Za-z][\w.$@]*\(%rip\)|\.L\w+|_ZN\S+|movabsq.*")
_REPEATED = """
def repeated(shape, t, w, state, log, seg, plan, ticks):
    f = right_hand_side(t, t.mode_set_of[state.progress[0].key], w.T, w.scratch)
    for _ in range(ticks):
        derivative(shape, f, True, state.x, w.k[0], t, w, state, log, seg, plan)
    return ticks
"""


def compiled_loops() -> tuple[Any, Any]:
    """Return a loop over `derivative` as a compiled function (rig.solve.specialised), and its twin."""
    functions: list[Any] = [forces.needs_inputs, runge_kutta_stage.derivative]
    source = "\n".join(textwrap.dedent(inspect.getsource(own.py_func)) for own in functions)
    bare = source.replace("has_products(shape) or ", "")
    assert len(bare) < len(source)
    return _compiled("own", source), _compiled("twin", bare)


def _compiled(name: str, source: str) -> Any:
    """A loop over the `derivative` of this source, compiled from a new file, because the compiler caches by file."""
    path = Path(mkdtemp()) / f"{name}.py"
    path.write_text(f"{source}\n{_REPEATED}")
    known = {key: value for key, value in vars(runge_kutta_stage).items() if not key.startswith("__")}
    names: dict[str, Any] = {**known, "__name__": name, "__file__": str(path)}
    exec(compile(path.read_text(), str(path), "exec"), names)
    return inner(names["repeated"])


def slipping() -> Motion:
    """Return a mass on a belt with falling friction, in slip."""
    motion = Motion(load("belt").assemble().system(), 1_000_000, "dopri5")
    key = motion.system.key([SLIP_PLUS], [CLOSED], [])
    if motion.mode_sets.tables.mode_set_of[key] < 0:
        motion.mode_sets.add(key)
    motion.state.progress["key"] = key
    motion.x[1] = 0.2
    return motion


def kinds(motion: Motion) -> tuple[Any, ...]:
    """Return the argument types of the compiled function for this motion."""
    typed: Any = numba.typeof
    parts = (motion.mode_sets.tables, motion.work, motion.state, motion.log, motion.segments, motion.plan)
    shape = KernelShape(motion.system.n, products=False, nonlinear=True)
    return shape, *(typed(Loan(part)) for part in parts), typed(1)


def instructions(loop: Any, *kinds: Any) -> list[str]:
    """Return the machine instructions for arguments of these types, without symbol names."""
    loop.compile(kinds)
    [text] = loop.inspect_asm().values()
    lines = [line.split("#")[0].strip() for line in text.partition("cpython")[0].splitlines()]
    return [_SYMBOL.sub("*", line) for line in lines if line and line[0] != "." and line[-1] != ":"]


@kernel
def _run(address, tables, loan, times):  # type: ignore[no-untyped-def]
    shape = any_shape(loan.state.x.shape[0])
    return call(address, shape, tables, loan.work, loan.state, loan.log, loan.segments, loan.plan, times)


def cost() -> dict[str, float]:
    """Measure ns per call of both, alternating, best of rounds, and their ratio."""
    motion = slipping()
    handle, loan = motion.mode_sets.handle, motion.loan
    run = entry(_run, 0, handle, loan, 1)
    calls = {}
    for name, loop in zip(("own", "twin"), compiled_loops()):
        loop.compile(kinds(motion))
        overload = loop.overloads[kinds(motion)]
        address = overload.library.get_pointer_to_function(overload.fndesc.llvm_func_name)
        run(address, handle, loan, 1)
        calls[name] = partial(run, address, handle, loan, CALLS)
    best = {name: seconds / CALLS * 1e9 for name, seconds in interleaved(calls, ROUNDS).items()}
    return {"ns": best["own"], "ns_without": best["twin"], "ratio": best["own"] / best["twin"]}
