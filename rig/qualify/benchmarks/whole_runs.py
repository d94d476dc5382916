"""Benchmark of whole runs of `rig simulate` with sensors, controller, protocol and outputs, and of the process
start.

The cost of an absent effect: the inner force function beside a twin compiled without the effect's source.

Products of states (nonlinear geometry, moving contacts) are the only kind of effect with code of its own in the inner
functions; all others are rows of tables. The twin is `rig.solve.forces.derivative` without the source line of products,
compiled the same way. For a rig without products both must take the same time.
"""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
import textwrap
import time
from collections.abc import Mapping
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, NamedTuple

import numba
import numpy as np

import rig
from rig.bench.run import local_controllers
from rig.compiled.kernel import entry, inner, kernel
from rig.compiled.records import Loan
from rig.motion.motion import Motion
from rig.qualify.bug_report import warmup
from rig.scenes.loader import load
from rig.scenes.scene import Scene
from rig.solve import forces
from rig.solve.records import CLOSED, KEY, SLIP_PLUS
from rig.solve.specialised import KernelShape, any_shape, call

SQUEAL = {
    "start.velocity": 0.2,
    "sensors.microphone.kind": "microphone",
    "sensors.microphone.rate": 50e3,
    "sensors.voltage.kind": "voltmeter",
    "sensors.voltage.rate": 50e3,
}


class Case(NamedTuple):
    """Runs of `short` and `long` seconds; their difference excludes the cost of start and end."""

    title: str
    scene: str
    changes: Mapping[str, Any]
    short: float
    long: float
    compiled: bool = False
    """Whether controllers are compiled, however short the run is."""


LOOP = {"controllers.nf.enable_at": 0.0}
CASES = {
    "open": Case(
        "belt, four sensors, no controller",
        "belt",
        {"sensors.strain.kind": "strain_gauge", "sensors.strain.rate": 1000.0},
        20.0,
        120.0,
    ),
    "python": Case("belt, closed loop at 1 kHz, controller in Python", "belt_normal_force", LOOP, 10.0, 60.0),
    "compiled": Case("the same, controller compiled", "belt_normal_force", LOOP, 10.0, 60.0, compiled=True),
    "squeal": Case("brake that squeals, three instruments at 50 kHz", "brake_shunt", SQUEAL, 1.0, 3.0),
    "disc_slider": Case("slider on a flexible disc, stick-slip", "disc_slider", {}, 1.0, 3.0),
    "plate": Case("plate of 40 modes under a slider on 40 points that open and close", "plate", {}, 0.2, 0.8),
    "plate_96": Case("the same, 96 points", "plate_96", {}, 0.2, 0.8),
}


def simulate(rounds: int = 5) -> dict[str, Any]:
    """Return the real-time factor of the pendulum with sensors and controller, in this process, kernels compiled."""
    scene = rig.load("pendulum")
    rig.simulate(scene, 1.0)
    best, length = float("inf"), 0.0
    for _ in range(rounds):
        begin = time.perf_counter()
        length = float(rig.simulate(scene).time[-1])
        best = min(best, time.perf_counter() - begin)
    return {"seconds": length, "wall": best, "rtf": length / best}


def marginal(rounds: int = 5) -> dict[str, float]:
    """Return the real-time factor of a further second of each case, in processor time, the cases alternating."""
    scenes = {name: rig.load(case.scene, dict(case.changes)) for name, case in CASES.items()}
    best: dict[tuple[str, float], float] = {}
    for turn in range(rounds + 1):  # the first one compiles
        for name, case in CASES.items():
            for seconds in (case.short, case.long):
                taken = _taken(scenes[name], seconds, case.compiled)
                if turn:
                    best[name, seconds] = min(best.get((name, seconds), taken), taken)
    return {
        name: (case.long - case.short) / (best[name, case.long] - best[name, case.short])
        for name, case in CASES.items()
    }


def _taken(scene: Scene, seconds: float, compiled: bool) -> float:
    """Processor time of a run [s]."""
    worth, local_controllers.WORTH = local_controllers.WORTH, 0 if compiled else sys.maxsize
    try:
        begin = time.process_time()
        rig.simulate(scene, seconds)
        return time.process_time() - begin
    finally:
        local_controllers.WORTH = worth


def start(rounds: int = 5) -> dict[str, Any]:
    """Return the wall time of `rig simulate pendulum --duration 10` as a new process, after `rig warmup`."""
    warmup(names=["pendulum"])
    command = [sys.executable, "-m", "rig", "simulate", "pendulum", "--duration", "10"]
    times = []
    for _ in range(rounds + 1):
        begin = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        times.append(time.perf_counter() - begin)
    return {"wall": min(times[1:]), "worst": max(times[1:])}


CALLS = 50_000
ROUNDS = 80
_SYMBOL = re.compile(r"[_.$A-Za-z][\w.$@]*\(%rip\)|\.L\w+|_ZN\S+|movabsq.*")
_REPEATED = """
def repeated(shape, t, w, state, log, seg, plan, ticks):
    f = right_hand_side(t, t.mode_set_of[state.ic[KEY]], w.T, w.scratch)
    for _ in range(ticks):
        derivative(shape, f, True, state.x, w.k[0])
    return ticks
"""


def compiled_loops() -> tuple[Any, Any]:
    """Return a loop over `derivative` as a compiled function (rig.solve.specialised), and its twin."""
    own: Any = forces.derivative
    source = textwrap.dedent(inspect.getsource(own.py_func))
    bare = source.replace("has_products(shape) or ", "")
    assert len(bare) < len(source)
    return _compiled("own", source), _compiled("twin", bare)


def _compiled(name: str, source: str) -> Any:
    """A loop over the `derivative` of this source, compiled from a new file, because the compiler caches by file."""
    path = Path(mkdtemp()) / f"{name}.py"
    path.write_text(f"{source}\n{_REPEATED}")
    known = {key: value for key, value in vars(forces).items() if not key.startswith("__")}
    names: dict[str, Any] = {**known, "KEY": KEY, "__name__": name, "__file__": str(path)}
    exec(compile(path.read_text(), str(path), "exec"), names)
    return inner(names["repeated"])


def slipping() -> Motion:
    """Return a mass on a belt with falling friction, in slip."""
    motion = Motion(load("belt").assemble().system(), 1_000_000, "dopri5")
    key = motion.system.key([SLIP_PLUS], [CLOSED], [])
    if motion.mode_sets.tables.mode_set_of[key] < 0:
        motion.mode_sets.add(key)
    motion.state.ic[KEY] = key
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
    pair, run = compiled_loops(), entry(_run, 0, motion.mode_sets.handle, motion.loan, 1)
    addresses = []
    for loop in pair:
        loop.compile(kinds(motion))
        overload = loop.overloads[kinds(motion)]
        addresses.append(overload.library.get_pointer_to_function(overload.fndesc.llvm_func_name))
    best = [np.inf, np.inf]
    for address in addresses:
        run(address, motion.mode_sets.handle, motion.loan, 1)
    for _ in range(ROUNDS):
        for i, address in enumerate(addresses):
            begin = time.perf_counter()
            run(address, motion.mode_sets.handle, motion.loan, CALLS)
            best[i] = min(best[i], (time.perf_counter() - begin) / CALLS * 1e9)
    return {"ns": float(best[0]), "ns_without": float(best[1]), "ratio": float(best[0] / best[1])}
