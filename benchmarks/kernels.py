"""Benchmarks of the kernels, also against scipy: one run of each per round, alternating; the best run counts."""

from __future__ import annotations

import inspect
import shutil
import tempfile
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from rig.laws.lugre import LuGre
from rig.model.assembly import Assembly
from rig.model.system import System
from rig.motion.motion import Motion
from rig.plants import PLANTS
from rig.scenes import loader

Array = NDArray[np.float64]
ROUNDS = 15
SECONDS = 20.0
STEP_NS = 1_000_000
P1_SECONDS = 4.0
P1 = Path(__file__).parents[1] / "tests" / "problems" / "p1.toml"
COULOMB = {
    "friction": {"law": "coulomb", "mu_static": 0.4, "mu_kinetic": 0.25},
    "drive": {"speed": 0.3},
    "start": {"displacement": 0.0, "velocity": 0.06},
}
FALLING = {"drive": {"speed": 0.3}, "start": {"displacement": 0.0, "velocity": 0.06}}


def pendulum(changes: dict[str, Any]) -> System:
    """Return the pendulum's matrices at constant speed and load, with other values in its tables."""
    scene = loader.load("pendulum")
    raw = scene.parameters.model_dump(exclude_none=True)
    raw["load"] = {"force": raw["load"]["force"]}
    for table, values in changes.items():
        raw[table] = values if "law" in values else {**raw.get(table, {}), **values}
    plant = PLANTS[scene.plant]
    assembly: Assembly = plant.assemble(plant.Parameters.model_validate(raw), {})
    return assembly.system()


def interleaved(
    contenders: Mapping[str, Callable[[], object]],
    rounds: int = ROUNDS,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, float]:
    """Return the best time of each [s], with one call of each per round."""
    best = dict.fromkeys(contenders, np.inf)
    for _ in range(rounds):
        for name, call in contenders.items():
            begin = clock()
            call()
            best[name] = min(best[name], clock() - begin)
    return best


def run(
    system: System, method: str, tolerance: float = 1e-7, substeps: int = 1, step_ns: int = STEP_NS
) -> tuple[Motion, int, Array]:
    """Return a motion after its first SECONDS, with room for as many again, its ticks, and its event times [s]."""
    ticks = round(SECONDS * 1e9 / step_ns)
    motion = Motion(system, step_ns, method, tolerance=tolerance, substeps=substeps, with_energy=False, longest=ticks)
    motion.advance(ticks)
    return motion, ticks, np.array([(e.tick + e.place) * step_ns * 1e-9 for e in motion.events()])


def exact_seconds(rounds: int = 5) -> float:
    """Return the processor time of the pendulum's exact kernel for a simulated second: the yardstick of other rigs."""
    motion, ticks, _ = run(pendulum(COULOMB), "exact")
    return interleaved({"run": lambda: motion.advance(ticks)}, rounds, time.process_time)["run"] / SECONDS


def event_error(times: Array, reference: Array) -> float:
    """Return the largest error of event times over the period; infinite if events are missed or invented."""
    if len(times) != len(reference):
        return float("inf")
    return float(np.abs(times - reference).max() / np.median(np.diff(reference[::2])))


def precision() -> dict[str, Any]:
    """Return the real-time factor at 1 ms samples of each method, with its event-time error (of a period): `rows`, the
    best factor of each method for three errors, that of the Stribeck law for 1e-6 (`kernel`), and its time over that of
    exact (`over_exact`).
    """
    systems = {"stribeck": pendulum(FALLING), "coulomb": pendulum(COULOMB)}
    reference = {
        "stribeck": run(systems["stribeck"], "dopri5", 1e-13)[2],
        "coulomb": run(systems["coulomb"], "rk4", substeps=100)[2],
    }
    settings: list[tuple[str, str, float, int]] = [("coulomb", "exact", 1e-7, 1)]
    settings += [("stribeck", "dopri5", 10.0**-p, 1) for p in range(3, 11)]
    settings += [(law, "rk4", 1e-7, n) for law in systems for n in (1, 2, 5, 10, 30)]
    rows: list[dict[str, Any]] = []
    for law, method, tolerance, substeps in settings:
        motion, ticks, times = run(systems[law], method, tolerance, substeps)
        best = interleaved({"run": lambda m=motion, n=ticks: m.advance(n)}, 7)["run"]  # type: ignore[misc]
        rows.append(
            {
                "law": law,
                "method": method,
                "tolerance": tolerance,
                "substeps": substeps,
                "error": event_error(times, reference[law]),
                "rtf": SECONDS / best,
            }
        )

    def fastest(error: float, key: str, value: str) -> float:
        return max((row["rtf"] for row in rows if row[key] == value and row["error"] <= error), default=0.0)

    at = {
        f"{method} at {error:.0e}": fastest(error, "method", method)
        for error in (1e-4, 1e-6, 1e-8)
        for method in ("exact", "dopri5", "rk4")
    }
    kernel = fastest(1e-6, "law", "stribeck")
    return {"kernel": kernel, "over_exact": at["exact at 1e-06"] / kernel, "best": at, "rows": rows}


def _by_rig(system: System) -> Callable[[], list[float]]:
    """P1 by `exact` with a state every millisecond: a function that runs it and returns the times [s] of events."""
    ticks = round(P1_SECONDS * 1e9 / STEP_NS)
    motion = Motion(system, STEP_NS, "exact", with_energy=False, longest=ticks)

    def run() -> list[float]:
        motion.x[:], first = system.start, motion.tick
        motion.advance(ticks)
        from_tick, events, places = motion.met()
        times: list[float] = ((events[:, 0] + (from_tick - first) + places) * (STEP_NS * 1e-9)).tolist()
        return times

    return run


def _by_scipy(p: Any) -> list[float]:
    """The same by scipy: slip with a terminal event, stick in closed form; samples every millisecond."""
    force, speed = p.friction.mu_kinetic * p.load.force, p.drive.speed
    mass, damping, stiffness = p.body.mass, p.body.damping, p.body.stiffness

    def rate(t: float, y: Array) -> list[float]:
        return [y[1], (force - stiffness * y[0] - damping * y[1]) / mass]

    def sticks(t: float, y: Array) -> float:
        return float(speed - y[1])

    sticks.terminal, sticks.direction = True, -1  # type: ignore[attr-defined]
    release = (p.friction.mu_static * p.load.force - damping * speed) / stiffness
    grid, times, t, x = np.arange(0.0, P1_SECONDS + 5e-4, 1e-3), list[float](), 0.0, p.start.displacement
    while (t := t + max(release - x, 0.0) / speed) < P1_SECONDS:
        times.append(t)
        samples = grid[np.searchsorted(grid, t, side="right") :]
        slip = solve_ivp(
            rate,
            (t, P1_SECONDS),
            [release, speed],
            method="DOP853",
            rtol=1e-9,
            atol=1e-12,
            events=sticks,
            t_eval=samples,
        )
        if not len(slip.t_events[0]):
            break
        t, x = float(slip.t_events[0][0]), float(slip.y_events[0][0][0])
        times.append(t)
    return times


def scipy_ratio() -> dict[str, Any]:
    """Return the time of scipy's DOP853 with events over that of `exact`, for tests/problems/p1.toml: a mass on a belt
    under Coulomb friction, samples of 1 ms.
    """
    scene = loader.load(str(P1))
    solvers: dict[str, Callable[[], list[float]]] = {
        "scipy": partial(_by_scipy, scene.parameters),
        "exact": _by_rig(scene.assemble().system()),
    }
    times = {name: np.array(solve()) for name, solve in solvers.items()}
    best = interleaved(solvers, 7)
    return {
        "ratio": best["scipy"] / best["exact"],
        "events": len(times["exact"]),
        "scipy_event_error": event_error(times["scipy"], times["exact"]),
    }


BRISTLES = {"mu_static": 0.5, "mu_kinetic": 0.3, "speed_scale": 0.02, "sigma0": 1e4, "sigma1": 3.0}


def memory(rounds: int = 12) -> dict[str, float]:
    """Return microseconds of a tick of the belt under LuGre's law, shipped and as a file outside of the program, in
    processor time, the two alternating, and their ratio.
    """
    values = {f"friction.{key}": value for key, value in BRISTLES.items()} | {"friction.mu_dynamic": None}
    ticks, calls = 2000, {}
    with tempfile.TemporaryDirectory() as folder:
        file = shutil.copy(inspect.getfile(LuGre), Path(folder) / "own.py")
        for name, law in {"shipped": "lugre", "file": str(file)}.items():
            scene = loader.load("belt", {"friction.law": law, **values})
            motion = Motion(scene.assemble().system(), scene.step_ns, "rosenbrock", longest=ticks)
            motion.advance(ticks)
            calls[name] = partial(motion.advance, ticks)
        best = interleaved(calls, rounds, time.process_time)
    return {f"{name}_us": seconds / ticks * 1e6 for name, seconds in best.items()} | {
        "ratio": best["file"] / best["shipped"]
    }
