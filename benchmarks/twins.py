"""Benchmark of the kernels against their C twins: one run of each per round, the best run counts.

quiet, rk4, exact   twins.c: quiet ticks, a run at a fixed step, the exact run of a stiff shunt
film                film.c: the step of a film of points under a moving slider (rig.solve.film_steps)
points              points.c: the step of a film of points of a structure with 40 modes, at 0.5 us
run                 run.c: a whole run in open loop, with events, energy balance, four instruments and all outputs
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rig
from benchmarks import kernels
from benchmarks.kernels import SECONDS, STEP_NS
from rig.bench.run.runner import PlantRunner
from rig.compiled.kernel import entry, kernel
from rig.model.assembly import Assembly
from rig.model.film import Film
from rig.model.system import System
from rig.motion.motion import Motion
from rig.plants import PLANTS
from rig.scenes.loader import load
from rig.sensors.chain.instants import Stream
from rig.solve.energy_balance import NAMES
from rig.solve.film_steps import SUMS
from rig.solve.records import STICK
from rig.solve.roots import BERNSTEIN
from rig.solve.specialised import any_shape, call

SCENE = "plate"
SLIDING = {"drive.speed": 0.01, "load.force": 108.79}
"""The slider starts at full load and speed, so that its points open and close from the start."""
TICKS = 2000
_REPEATED = 50  # quiet ticks in a round: so many times TICKS
_MOST_EVENTS = 10_000
Array = NDArray[np.float64]


def twins() -> dict[str, Any]:
    """Return the time of the kernels over that of their C twins, and whether results and events are the same."""
    compiler = shutil.which("gcc")
    if compiler is None:
        return {"skipped": "gcc is not installed"}
    system, stack = kernels.pendulum(kernels.COULOMB), stiff()
    with tempfile.TemporaryDirectory() as folder:
        build = partial(compiled, compiler, folder)
        c = build("twins.c", {"N": system.n})
        return {
            "quiet": _quiet(system, c),
            "rk4": _rk4(system, c),
            "exact": _exact(stack, build("twins.c", {"N": stack.n})),
            "film": film(build),
            "points": points(build),
            "run": run(build),
        }


def compiled(compiler: str, folder: str, source: str, constants: dict[str, int]) -> ctypes.CDLL:
    """Return the library of a C file of this folder, compiled in `folder` with constants by name."""
    named = [f"-D{name}={value}" for name, value in constants.items()]
    library = Path(folder) / f"{source}{''.join(named)}.so"
    options = ["-O3", "-march=native", *named, "-shared", "-fPIC"]
    subprocess.run([compiler, *options, str(Path(__file__).with_name(source)), "-o", str(library), "-lm"], check=True)
    return ctypes.CDLL(str(library))


def stiff() -> System:
    """Return problem P4 as matrices: a mass on a belt with a piezo stack whose shunt resonates at 3400 Hz."""
    scene = load("belt_shunt")
    assembly: Assembly = PLANTS[scene.plant].assemble(scene.parameters, {})
    return assembly.system()


@kernel
def _quiet_loop(tables, loan, ticks):  # type: ignore[no-untyped-def]
    state = loan.state
    state.progress[0].tick = 0
    shape = any_shape(state.x.shape[0])
    return call(loan.plan.quiet_ticks, shape, tables, loan.work, state, loan.log, loan.segments, loan.plan, ticks)


def _compared(
    ours: Callable[[], object],
    theirs: Callable[[], object],
    unit: str,
    units: int,
    states: Callable[[], tuple[Any, Any]],
) -> dict[str, Any]:
    """Run both in turns: ns of each per `unit`, their ratio, and the largest difference of the final `states`."""
    best = kernels.interleaved({"ours": ours, "theirs": theirs}, clock=time.process_time)
    mine, other = states()
    return {
        f"ns_per_{unit}": best["ours"] / units * 1e9,
        f"ns_per_{unit}_c": best["theirs"] / units * 1e9,
        "ratio": best["ours"] / best["theirs"],
        "largest_difference": float(np.abs(mine - other).max() / np.abs(mine).max()),
    }


def _quiet(system: System, c: ctypes.CDLL) -> dict[str, Any]:
    motion = Motion(system, 20_000, "exact", with_energy=False)
    motion.advance(5000)
    t, mode_set, x0 = motion.mode_sets.tables, motion.mode_set, motion.x.copy()
    count = int(t.guards[mode_set])
    E, G, B = (np.ascontiguousarray(a[mode_set, ...]) for a in (t.E[:, 0], t.G, t.B))
    written = np.zeros((TICKS, system.n))
    loop = entry(_quiet_loop, motion.mode_sets.handle, motion.loan, TICKS)

    def ours() -> int:
        for _ in range(_REPEATED):
            motion.state.x[:] = x0
            ticks = loop(motion.mode_sets.handle, motion.loan, TICKS)
        return int(ticks)

    def theirs() -> int:
        for _ in range(_REPEATED):
            x = x0.copy()
            g = G[:count] @ x
            ticks = c.quiet(
                E.ctypes,
                G.ctypes,
                B.ctypes,
                ctypes.c_int64(count),
                x.ctypes,
                g.ctypes,
                ctypes.c_int64(TICKS),
                written.ctypes,
            )
        return int(ticks)

    n = ours()
    result = _compared(ours, theirs, "tick", _REPEATED * n, lambda: (motion.log.out[:n], written[:n]))
    return {"states": system.n, "same_ticks": theirs() == n, **result}


class _Contact:
    """The tables of a rig with one friction patch in its mode sets slip+, slip- and stick, as its twins take them."""

    def __init__(self, motion: Motion) -> None:
        self.motion, self.step = motion, STEP_NS * 1e-9
        for key in range(3):
            if motion.mode_sets.tables.mode_set_of[key] < 0:
                motion.mode_sets.add(key)
        t = motion.mode_sets.tables
        self.sets = [int(t.mode_set_of[key]) for key in range(3)]
        stick = self.sets[STICK]
        rows = {"landing": t.landing[stick], "slip": t.slip[0], "need": t.friction[stick, 0], "load": t.load[stick, 0]}
        self.rows = {name: np.ascontiguousarray(row) for name, row in rows.items()}
        self.static = motion.system.patches[0].law.static

    def tables(self, *names: str) -> list[NDArray[Any]]:
        """Return tables of the mode sets; of guards those of the patch."""
        t = self.motion.mode_sets.tables
        tables = ((name, getattr(t, name)[self.sets]) for name in names)
        return [np.ascontiguousarray(a[:, :2] if name in ("G", "GA", "B", "BA") else a) for name, a in tables]

    def exact(self) -> tuple[_Tables, dict[str, NDArray[Any]]]:
        """Return what a twin of the exact method is given, and the arrays to which it points."""
        arrays = dict(zip(_OF_MODE_SETS, self.tables(*_OF_MODE_SETS))) | self.rows
        arrays |= dict(zip(("count", "depth", "order"), self.tables("guards", "depth", "order")))
        arrays["bernstein"] = np.ascontiguousarray(BERNSTEIN)
        pointers = {name: a.ctypes.data for name, a in arrays.items()}
        return _Tables(**pointers, levels=arrays["E"].shape[1], mu_static=self.static, step=self.step), arrays


class _OneContact(_Contact):
    """A run of SECONDS of such a rig, and what its C twin is given and writes."""

    def __init__(self, system: System, method: str, substeps: int = 1) -> None:
        motion, self.ticks, self.times = kernels.run(system, method, substeps=substeps)
        super().__init__(motion)
        self.system = system
        self.begun, self.x0, self.key0 = motion.save(), motion.x.copy(), motion.key
        self.out = np.zeros((self.ticks, system.n))
        self.event_ticks, self.places = np.zeros(_MOST_EVENTS, dtype=np.int64), np.zeros(_MOST_EVENTS)

    def again(self) -> None:
        """Run the kernel from the same state again."""
        self.motion.go_back(self.begun)
        self.motion.advance(self.ticks)

    def compared(self, c_run: Callable[[], int], unit: str, units: int) -> dict[str, Any]:
        """Compare with the twin `c_run`, which returns the number of its events."""
        result = _compared(self.again, c_run, unit, units, lambda: (self.motion.log.out, self.out))
        count, first = c_run(), self.motion.tick - self.ticks
        ours = np.array([e.tick - first + e.place for e in self.motion.events()])
        theirs = self.event_ticks[:count] + self.places[:count]
        same = len(ours) == count
        apart = float(np.abs(ours - theirs).max()) if same else np.inf
        return {"states": self.system.n, "same_events": same, "largest_event_difference": apart, **result}


def _rk4(system: System, c: ctypes.CDLL) -> dict[str, Any]:
    substeps, final = 10, ctypes.c_int64()
    r = _OneContact(system, "rk4", substeps)
    given = [a.ctypes for a in (*r.tables("A", "G", "guards"), *r.rows.values())]

    def c_run() -> int:
        x = r.x0.copy()
        written = (a.ctypes for a in (x, r.out, r.event_ticks, r.places))
        return int(
            c.rk4_run(
                *given,
                ctypes.c_double(r.static),
                ctypes.c_double(r.step),
                ctypes.c_int64(substeps),
                ctypes.c_int64(r.ticks),
                r.key0,
                *written,
                ctypes.byref(final),
            )
        )

    return r.compared(c_run, "step", r.ticks * substeps)


_OF_MODE_SETS = ("E", "A", "G", "GA", "B", "BA")


class _Tables(ctypes.Structure):
    """The tables of the three mode sets in the layout of the twin."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in (*_OF_MODE_SETS, "landing", "slip", "need", "load")),
        *((name, ctypes.c_void_p) for name in ("bernstein", "count", "depth", "order")),
        ("levels", ctypes.c_int64),
        ("mu_static", ctypes.c_double),
        ("step", ctypes.c_double),
    ]


def _exact(system: System, c: ctypes.CDLL) -> dict[str, Any]:
    """The whole exact run of P4 at 1 ms, and the event times that it must reproduce: those of a twentieth of the
    step.
    """
    r = _OneContact(system, "exact")
    tables, _kept = r.exact()
    size0 = r.motion.work.size.copy()

    def c_run() -> int:
        x, size = r.x0.copy(), size0.copy()
        written = (a.ctypes for a in (x, size, r.out, r.event_ticks, r.places))
        return int(c.exact_run(ctypes.byref(tables), ctypes.c_int64(r.ticks), r.key0, *written))

    result = r.compared(c_run, "tick", r.ticks)
    *_, fine = kernels.run(system, "exact", step_ns=STEP_NS // 20)
    rtf = SECONDS / (result["ns_per_tick"] * r.ticks * 1e-9)
    return {"rtf": rtf, "error": kernels.event_error(r.times, fine), **result}


_FILM_TABLES = (
    "alike",
    "against",
    "which_alike",
    "which_against",
    "kick",
    "turn",
    "loss",
    "column",
    "push",
    "signal",
    "riders",
    "advance",
)


class _Film(ctypes.Structure):
    """The tables in the layout of the twin."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in _FILM_TABLES),
        *((name, ctypes.c_double) for name in ("pitch", "stiffness", "shear", "mu")),
        *((name, ctypes.c_int64) for name in ("places", "pushed", "travel")),
    ]


def film(build: Callable[[str, dict[str, int]], ctypes.CDLL], ticks: int = TICKS) -> dict[str, Any]:
    """Return the time of the film's step over that of its twin, with energy balance, and the difference of the states.

    `build`: returns the library of a C file of this folder, with constants by name.
    """
    scene = load(SCENE, SLIDING)
    substeps = scene.clock.substeps(scene.step_ns)
    motion = Motion(scene.assemble().system(), scene.step_ns, "kick", substeps=substeps, longest=ticks)
    motion.advance(1)
    own = motion.mode_sets.tables.film
    signals = own.moved.shape[0]
    even, odd = own.symmetric, own.antisymmetric
    pushed = [np.ascontiguousarray(own.column[:, :, 0]), np.ascontiguousarray(own.push[:, 0])]
    tables = (
        even.rows,
        odd.rows,
        even.which,
        odd.which,
        own.kick,
        own.turn,
        own.loss,
        *pushed,
        own.signal,
        own.slider_rows,
        own.advance,
    )
    given = _Film(
        *(table.ctypes.data for table in tables),
        *(own.pitch, own.stiffness[0], own.shear[0], own.mu[0]),
        even.rows.shape[0],
        int(own.pushed[0]),
        own.travel - own.first + signals,
    )
    constants = {
        "NQ": own.kick.shape[0],
        "NA": even.which.shape[0],
        "NO": odd.which.shape[0],
        "M": signals,
        "R": own.slider_rows.shape[0],
        "PAIRS": own.points // 2,
        "WIDTH": even.rows.shape[2],
        "ROOM": own.slider_rows.shape[1],
    }
    c = build("film.c", constants)
    begun, x0 = motion.save(), motion.state.x.copy()
    x, energy, states = x0.copy(), np.zeros(4), 2 * own.kick.shape[0]

    def ours() -> None:
        motion.go_back(begun)
        motion.advance(ticks)

    def theirs() -> None:
        x[:] = x0
        counts = (ctypes.c_int64(n) for n in (ticks, substeps, len(SUMS)))
        c.film_run(ctypes.byref(given), *counts, x.ctypes, energy.ctypes)

    result = _compared(ours, theirs, "step", ticks * substeps, lambda: (motion.state.x[:states], x[:states]))
    return {"coordinates": states // 2, "points": own.points, **result}


_POINTS_TABLES = (
    "now",
    "back",
    "kick",
    "turn",
    "loss",
    "column",
    "push",
    "signal",
    "stiffness",
    "shear",
    "give",
    "mu",
    "reach",
)


class _Points(ctypes.Structure):
    """The tables in the layout of the twin."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in _POINTS_TABLES),
        *((name, ctypes.c_int64) for name in ("slid", "ticks", "substeps", "sums")),
    ]


def squeal(modes: int = 40, points: int = 24) -> System:
    """Return a structure with random mode shapes at its contact points, which open and close from the start."""
    random = np.random.default_rng(1)
    omega = 2.0 * np.pi * np.linspace(800.0, 20_000.0, modes)
    normal, along = random.normal(size=(2, points, modes))
    stiffness = 2e7 * np.linspace(0.8, 1.2, points)
    a = Assembly(title="points")
    names = tuple(f"q{i + 1}" for i in range(modes))
    a.block(names, np.eye(modes), np.diag(0.01 * omega), np.diag(omega**2))
    for name, force in zip(names, (40.0 * normal.sum(axis=0)).tolist()):
        a.push(name, {"one": force})
        a.start[f"{name}'"] = 1e-3
    a.signal("slid", {"one": 5.0}, 0.0, "drive")
    rows, where = np.stack([normal.T, along.T])[None], np.zeros(points)
    a.film = Film(
        rows, "slid", stiffness, stiffness, np.array(0.3), where, where, reach=np.linspace(0.08, 0.12, points)
    )
    return a.system()


def points(build: Callable[[str, dict[str, int]], ctypes.CDLL], ticks: int = TICKS) -> dict[str, Any]:
    """Return the same of a film whose points stay in place, and the processor time of a simulated second."""
    substeps = 20
    motion = Motion(squeal(), 10_000, "kick", substeps=substeps, longest=ticks)
    motion.advance(1)
    own = motion.mode_sets.tables.film
    side, count = own.symmetric, own.kick.shape[0]
    arrays = {name: getattr(side if hasattr(side, name) else own, name) for name in _POINTS_TABLES}
    signals = own.moved.shape[0]
    addresses = (array.ctypes.data for array in arrays.values())
    given = _Points(*addresses, own.slid - own.first + signals, ticks, substeps, len(SUMS))
    constants = {
        "NQ": count,
        "M": signals,
        "POINTS": own.points,
        "WIDTH": side.now.shape[1],
        "BACK": side.back.shape[1],
    }
    c = build("points.c", constants)
    begun, x0 = motion.save(), motion.state.x.copy()
    x, energy = x0.copy(), np.zeros(4)

    def ours() -> None:
        motion.go_back(begun)
        motion.advance(ticks)

    def theirs() -> None:
        x[:] = x0
        c.points_run(ctypes.byref(given), x.ctypes, energy.ctypes)

    result = _compared(ours, theirs, "step", ticks * substeps, lambda: (motion.state.x[: 2 * count], x[: 2 * count]))
    return {"coordinates": count, "points": own.points, **result, "s_per_s": result["ns_per_step"] * 1e-3 / 0.5}


OPEN = {
    "friction.law": "coulomb",
    "friction.mu_static": 0.4,
    "friction.mu_kinetic": 0.25,
    "sensors.strain.kind": "strain_gauge",
    "sensors.strain.rate": 1000.0,
}
"""A mass on a belt that sticks and slips for ever, with four sensors of 1 kHz."""
SHORT, LONG = 20, 120
_MOST_GAPS = 60.0  # of a sensor in a second


class _Whole(ctypes.Structure):
    """The further tables in the layout of the twin."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("signals", "work", "powers", "nodes", "weights", "noise")),
        *((name, ctypes.c_void_p) for name in ("active", "gaps")),
        *((name, ctypes.c_int64) for name in ("instruments", "room", "most")),
        ("bound", ctypes.c_double),
    ]


def run(
    build: Callable[[str, dict[str, int]], ctypes.CDLL], short: int = SHORT, long: int = LONG, rounds: int = 9
) -> dict[str, Any]:
    """Return the processor time of further seconds of `rig.simulate` in open loop over that of its twin, and whether
    samples, outputs and energy are the same. Both draw the noise of the sensors by numpy.
    """
    scene = load("belt", OPEN)
    runner = PlantRunner(scene, truthful=True)
    motion, bank, ticks = runner.motion, runner.bank.loan.content, (long - short) * 1000
    assert motion.integration.method == "exact"
    contact = _Contact(motion)
    rig_tables, _kept = contact.exact()
    t, names = motion.mode_sets.tables, ("signals", "powers", "active", "work")
    assert not t.output_needs_inputs.any()
    assert not t.depth.any()
    arrays = dict(zip(names, contact.tables(*names)))
    gaps = np.full((len(bank.instruments), int(_MOST_GAPS * (long - short)), 2), np.iinfo(np.int64).max)
    arrays["gaps"] = gaps
    arrays |= {"nodes": motion.work.nodes, "weights": motion.work.weights}
    constants = {
        "N": motion.system.n,
        "OUTPUTS": len(runner.outputs),
        "READ": motion.segments.coef.shape[1],
        "TERMS": len(NAMES),
    }
    c = build("run.c", constants)
    x0, size0, key0, energy0 = motion.x.copy(), motion.work.size.copy(), motion.key, motion.state.energy.copy()
    instruments0, poles0 = bank.instruments.copy(), bank.poles.copy()
    outputs, energy = np.zeros((len(runner.outputs), ticks)), energy0.copy()
    samples, noise = np.zeros((len(instruments0), ticks)), np.zeros((len(instruments0), ticks + 8))
    event_ticks, places = np.zeros(_MOST_EVENTS, dtype=np.int64), np.zeros(_MOST_EVENTS)
    given = _Whole(
        **{name: a.ctypes.data for name, a in arrays.items()},
        noise=noise.ctypes.data,
        instruments=len(samples),
        room=noise.shape[1],
        most=gaps.shape[1],
        bound=scene.limits["displacement"],
    )

    def theirs() -> int:
        for (name, section), row, lost in zip(scene.sensors.items(), noise, gaps):
            stream, end = Stream(scene.seed, name), section.front_end()
            stream.noise(row)
            if end.dropout_rate:
                lost[:] = stream.gaps(len(lost), end.dropout_rate, end.dropout_shortest, end.dropout_longest)
        energy[:] = energy0
        written = (x0.copy(), size0.copy(), instruments0.copy(), poles0.copy(), outputs, samples, energy, event_ticks)
        return int(
            c.whole_run(
                ctypes.byref(rig_tables),
                ctypes.byref(given),
                ctypes.c_int64(ticks),
                key0,
                *(a.ctypes for a in written),
                places.ctypes,
            )
        )

    runs = {"short": lambda: rig.simulate(scene, short), "long": lambda: rig.simulate(scene, long), "c": theirs}
    best = kernels.interleaved(runs, rounds, time.process_time)
    again, count = rig.simulate(scene, long - short), theirs()
    kept = [again.measurements[name][1][n:] for name, n in zip(runner.bank.names, instruments0["taken"])]
    differences = {
        "outputs": [np.abs(again.signals[name][1:] - row).max() for name, row in zip(runner.outputs, outputs)],
        "samples": [np.abs(a - b[: len(a)]).max() for a, b in zip(kept, samples)],
        "energy": [abs(again.energy[name] - value) for name, value in zip(NAMES, energy) if name in again.energy],
    }
    contacts = sum(event["kind"] == "contact" for event in again.events)
    ours = best["long"] - best["short"]
    return {
        "ns_per_tick": ours / ticks * 1e9,
        "ns_per_tick_c": best["c"] / ticks * 1e9,
        "ratio": ours / best["c"],
        "rtf": (long - short) / ours,
        "same_events": contacts == count,
        **{f"largest_difference_of_{name}": float(max(values)) for name, values in differences.items()},
    }
