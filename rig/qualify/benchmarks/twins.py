"""Benchmark of the kernels against their C twins (twins.c, film.c): one run of each per round, the best run counts.

Benchmark of a film of points under a moving slider: the kernel's step (rig.solve.film_steps) beside its C twin
(film.c).
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.compiled.kernel import entry, kernel
from rig.motion.motion import Motion
from rig.plants import PLANTS
from rig.qualify.benchmarks.kernels import COULOMB, SECONDS, STEP_NS, event_times, interleaved, pendulum, run
from rig.scenes.loader import load
from rig.solve.film_steps import FIRST, FRICTIONAL, PITCH, POINTS, SHEAR, STIFFNESS, SUMS, TRAVEL
from rig.solve.records import STICK, TICK
from rig.solve.roots import BERNSTEIN
from rig.solve.specialised import any_shape, call

SCENE = "plate"
SLIDING = {"drive.speed": 0.01, "load.force": 108.79}
"""The slider starts at full load and speed, so that its points open and close from the start."""
TICKS = 2000
_TABLES = ("alike", "against", "which_alike", "which_against", "kick", "turn", "loss", "column", "push", "signal",
           "riders", "advance")  # fmt: skip


class _Film(ctypes.Structure):
    """The tables in the layout of the twin."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in _TABLES),
        *((name, ctypes.c_double) for name in ("pitch", "stiffness", "shear", "mu")),
        *((name, ctypes.c_int64) for name in ("places", "pushed", "travel")),
    ]


def ratio(compiled: Callable[[str, dict[str, int]], Any], ticks: int = TICKS) -> dict[str, Any]:
    """Return the time of the kernel over that of the twin, with energy balance, and the final differences of the
    states.

    `compiled`: a function that returns the library of a C file of this folder, with constants by name.
    """
    scene = load(SCENE, SLIDING)
    substeps = scene.clock.substeps(scene.step_ns)
    motion = Motion(scene.assemble().system(), scene.step_ns, "kick", substeps=substeps, longest=ticks)
    motion.advance(1)
    own = motion.mode_sets.tables.film
    numbers, where, signals = own.numbers, own.where, own.moved.shape[0]
    even, odd = own.symmetric, own.antisymmetric
    tables = (even.rows, odd.rows, even.which, odd.which, own.kick, own.turn, own.loss, own.column[0], own.push[0],
              own.signal, own.slider_rows, own.advance)  # fmt: skip
    film = _Film(
        *(table.ctypes.data for table in tables),
        *(numbers[k] for k in (PITCH, STIFFNESS, SHEAR, FRICTIONAL)),
        own.symmetric.rows.shape[0],
        int(own.pushed[0]),
        int(where[TRAVEL] - where[FIRST]) + signals,
    )
    constants = {
        "NQ": own.kick.shape[0],
        "NA": own.symmetric.which.shape[0],
        "NO": own.antisymmetric.which.shape[0],
        "M": signals,
        "R": own.slider_rows.shape[0],
        "PAIRS": int(where[POINTS]) // 2,
        "WIDTH": own.symmetric.rows.shape[2],
        "ROOM": own.slider_rows.shape[1],
    }
    c = compiled("film.c", constants)
    begun, x0 = motion.save(), motion.state.x.copy()
    x, energy, steps = x0.copy(), np.zeros(4), ticks * substeps

    def numba_run() -> None:
        motion.go_back(begun)
        motion.advance(ticks)

    def c_run() -> None:
        x[:] = x0
        written = (ctypes.c_void_p(a.ctypes.data) for a in (x, energy))
        counts = (ctypes.c_int64(n) for n in (ticks, substeps, len(SUMS)))
        c.film_run(ctypes.byref(film), *counts, *written)

    best = interleaved({"numba": numba_run, "c": c_run})
    states = 2 * own.kick.shape[0]
    ours = motion.state.x[:states]
    return {
        "coordinates": states // 2,
        "points": int(where[POINTS]),
        "ns_per_step": best["numba"] / steps * 1e9,
        "ns_per_step_c": best["c"] / steps * 1e9,
        "ratio": best["numba"] / best["c"],
        "largest_difference": float(np.abs(ours - x[:states]).max() / np.abs(ours).max()),
    }


Array = NDArray[np.float64]


@kernel
def _quiet_loop(tables, loan, ticks):  # type: ignore[no-untyped-def]
    state = loan.state
    state.ic[TICK] = 0
    shape = any_shape(state.x.shape[0])
    return call(loan.plan.quiet_ticks, shape, tables, loan.work, state, loan.log, loan.segments, loan.plan, ticks)


def twins() -> dict[str, Any]:
    """Return the time of the kernels over that of their C twins, and whether results and events are the same."""
    compiler = shutil.which("gcc")
    if compiler is None:
        return {"skipped": "gcc is not installed: the ratio to C is left out"}
    system = pendulum(COULOMB)
    stack = stiff()
    with tempfile.TemporaryDirectory() as folder:
        build = partial(compiled, compiler, folder)
        c = build("twins.c", {"N": system.n})
        return {
            "quiet": _quiet(system, c),
            "rk4": _rk4(system, c),
            "exact": _exact(stack, build("twins.c", {"N": stack.n})),
            "film": ratio(build),
        }


def stiff() -> Any:
    """Return problem P4 as matrices: a mass on a belt with a piezo stack whose shunt resonates at 3400 Hz."""
    scene = load("belt_shunt")
    return PLANTS[scene.plant].assemble(scene.parameters, {}).system()


def compiled(compiler: str, folder: str, source: str, constants: dict[str, int]) -> Any:
    """Return the library of a C file of this folder, compiled in `folder` with constants by name."""
    named = [f"-D{name}={value}" for name, value in constants.items()]
    library = Path(folder) / f"{source}{''.join(named)}.so"
    options = ["-O3", "-march=native", *named, "-shared", "-fPIC"]
    subprocess.run([compiler, *options, str(Path(__file__).with_name(source)), "-o", str(library), "-lm"], check=True)
    return ctypes.CDLL(str(library))


def _pointer(a: NDArray[Any]) -> Any:
    return ctypes.c_void_p(a.ctypes.data)


def _quiet(system: Any, c: Any) -> dict[str, Any]:
    motion = Motion(system, 20_000, "exact", with_energy=False)
    motion.advance(5000)
    t, mode_set = motion.mode_sets.tables, motion.mode_set
    x0 = motion.x.copy()
    count = int(t.guards[mode_set])
    E, G, B = (np.ascontiguousarray(a[mode_set, ...]) for a in (t.E[:, 0], t.G, t.B))
    ticks = 2000
    ours, theirs = motion.log.out, np.zeros((ticks, system.n))
    done = {}

    def numba_run() -> None:
        for _ in range(50):
            motion.state.x[:] = x0
            done["numba"] = loop(motion.mode_sets.handle, motion.loan, ticks)

    def c_run() -> None:
        for _ in range(50):
            x = x0.copy()
            g = G[:count] @ x
            done["c"] = c.quiet(_pointer(E), _pointer(G), _pointer(B), ctypes.c_int64(count), _pointer(x), _pointer(g),
                                ctypes.c_int64(ticks), _pointer(theirs))  # fmt: skip

    loop = entry(_quiet_loop, motion.mode_sets.handle, motion.loan, ticks)
    numba_run()
    best = interleaved({"numba": numba_run, "c": c_run})
    n = done["numba"]
    return {
        "states": system.n,
        "ns_per_tick": best["numba"] / 50 / n * 1e9,
        "ns_per_tick_c": best["c"] / 50 / n * 1e9,
        "ratio": best["numba"] / best["c"],
        "same_ticks": done["numba"] == done["c"],
        "largest_difference": float(np.abs(ours[:n] - theirs[:n]).max() / np.abs(ours[:n]).max()),
    }


def _rk4(system: Any, c: Any) -> dict[str, Any]:
    motion, ticks = run(system, "rk4", substeps=10)
    t = motion.mode_sets.tables
    keys = [0, 1, 2]
    for key in keys:
        if t.mode_set_of[key] < 0:
            motion.mode_sets.add(key)
    t = motion.mode_sets.tables
    at = [int(t.mode_set_of[key]) for key in keys]
    A, G = (np.ascontiguousarray(a[at]) for a in (t.A, t.G[:, :2]))
    count = np.ascontiguousarray(t.guards[at])
    stick = at[STICK]
    rows = [np.ascontiguousarray(a) for a in (t.landing[stick], t.slip[0], t.friction[stick, 0], t.load[stick, 0])]
    begun, x0, key0 = motion.save(), motion.x.copy(), motion.key
    out, ticks_of, places = np.zeros((ticks, system.n)), np.zeros(10_000, dtype=np.int64), np.zeros(10_000)
    final = ctypes.c_int64()
    events = {}

    def numba_run() -> None:
        motion.go_back(begun)
        motion.advance(ticks)

    def c_run() -> None:
        x = x0.copy()
        arrays = map(_pointer, (A, G, count, *rows))
        written = map(_pointer, (x, out, ticks_of, places))
        static, step = ctypes.c_double(system.patches[0].law.static), ctypes.c_double(STEP_NS * 1e-9)
        counts = ctypes.c_int64(10), ctypes.c_int64(ticks)
        events["c"] = c.rk4_run(*arrays, static, step, *counts, key0, *written, ctypes.byref(final))

    best = interleaved({"numba": numba_run, "c": c_run})
    rig_events = motion.events()[-motion.event_count :]
    same = len(rig_events) == events["c"]
    first = motion.tick - ticks
    ours = np.array([e.tick - first + e.place for e in rig_events])
    theirs = ticks_of[: events["c"]] + places[: events["c"]]
    return {
        "states": system.n,
        "ns_per_step": best["numba"] / ticks / 10 * 1e9,
        "ns_per_step_c": best["c"] / ticks / 10 * 1e9,
        "ratio": best["numba"] / best["c"],
        "same_events": same,
        "largest_event_difference": float(np.abs(ours - theirs).max()) if same else np.inf,
        "largest_difference": float(np.abs(motion.log.out - out).max() / np.abs(out).max()),
    }


class _Tables(ctypes.Structure):
    """The tables of the three mode sets in the layout of the twin."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("E", "A", "G", "GA", "B", "BA", "landing", "slip", "need", "load")),
        *((name, ctypes.c_void_p) for name in ("bernstein", "count", "depth", "order")),
        ("levels", ctypes.c_int64),
        ("mu_static", ctypes.c_double),
        ("step", ctypes.c_double),
    ]


def _exact(system: Any, c: Any) -> dict[str, Any]:
    """The whole exact run of P4 at 1 ms, and the event times that it must reproduce."""
    motion, ticks = run(system, "exact")
    times = event_times(system, "exact", 1e-7, 1)
    for key in range(3):
        if motion.mode_sets.tables.mode_set_of[key] < 0:
            motion.mode_sets.add(key)
    t = motion.mode_sets.tables
    at = [int(t.mode_set_of[key]) for key in range(3)]
    arrays = {name: getattr(t, name)[at] for name in ("E", "A", "depth", "order")}
    arrays |= {name: getattr(t, name)[at, :2] for name in ("G", "GA", "B", "BA")}
    stick = at[STICK]
    arrays |= {"landing": t.landing[stick], "slip": t.slip[0], "need": t.friction[stick, 0], "load": t.load[stick, 0]}
    arrays |= {"bernstein": BERNSTEIN, "count": t.guards[at]}
    arrays = {name: np.ascontiguousarray(a) for name, a in arrays.items()}
    tables = _Tables(**{name: a.ctypes.data for name, a in arrays.items()}, levels=arrays["E"].shape[1],
                     mu_static=system.patches[0].law.static, step=STEP_NS * 1e-9)  # fmt: skip
    begun, x0, key0, size0 = motion.save(), motion.x.copy(), motion.key, motion.work.size.copy()
    out, ticks_of, places = np.zeros((ticks, system.n)), np.zeros(10_000, dtype=np.int64), np.zeros(10_000)
    events = {}

    def numba_run() -> None:
        motion.go_back(begun)
        motion.advance(ticks)

    def c_run() -> None:
        x, size = x0.copy(), size0.copy()
        written = map(_pointer, (x, size, out, ticks_of, places))
        events["c"] = c.exact_run(ctypes.byref(tables), ctypes.c_int64(ticks), key0, *written)

    best = interleaved({"numba": numba_run, "c": c_run})
    seen = motion.events()[-motion.event_count :]
    same = len(seen) == events["c"]
    first = motion.tick - ticks
    ours = np.array([e.tick - first + e.place for e in seen])
    theirs = ticks_of[: events["c"]] + places[: events["c"]]
    fine = _finer(system)
    period = float(np.median(np.diff(fine[::2])))
    return {
        "states": system.n,
        "rtf": SECONDS / best["numba"],
        "error": float(np.abs(times - fine).max() / period) if len(times) == len(fine) else np.inf,
        "ns_per_tick": best["numba"] / ticks * 1e9,
        "ns_per_tick_c": best["c"] / ticks * 1e9,
        "ratio": best["numba"] / best["c"],
        "same_events": same,
        "largest_event_difference": float(np.abs(ours - theirs).max()) if same else np.inf,
        "largest_difference": float(np.abs(motion.log.out - out).max() / np.abs(out).max()),
    }


def _finer(system: Any) -> Array:
    """Event times [s] of the first SECONDS with a twentieth of the step."""
    motion, _ = run(system, "exact", step_ns=STEP_NS // 20)
    return np.array([(e.tick + e.place) * STEP_NS / 20 * 1e-9 for e in motion.events()])
