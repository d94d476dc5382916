"""Benchmarks of the kernels, also against scipy: one run of each per round, alternating; the best run counts."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.motion.motion import Motion
from rig.plants import PLANTS
from rig.scenes.loader import load

Array = NDArray[np.float64]
ROUNDS = 15
SECONDS = 20.0
STEP_NS = 1_000_000
COULOMB = {
    "friction": {"law": "coulomb", "mu_static": 0.4, "mu_kinetic": 0.25},
    "drive": {"speed": 0.3},
    "start": {"displacement": 0.0, "velocity": 0.06},
}
FALLING = {"drive": {"speed": 0.3}, "start": {"displacement": 0.0, "velocity": 0.06}}


def pendulum(changes: dict[str, Any]) -> Any:
    """Return the pendulum's matrices at constant speed and load, with other values in its tables."""
    scene = load("pendulum")
    raw = scene.parameters.model_dump(exclude_none=True)
    raw["load"] = {"force": raw["load"]["force"]}
    for table, values in changes.items():
        raw[table] = values if "law" in values else {**raw.get(table, {}), **values}
    plant = PLANTS[scene.plant]
    return plant.assemble(plant.Parameters.model_validate(raw), {}).system()


def interleaved(contenders: dict[str, Callable[[], object]], rounds: int = ROUNDS) -> dict[str, float]:
    """Return the best time of each [s], with one call of each per round."""
    best = dict.fromkeys(contenders, np.inf)
    for _ in range(rounds):
        for name, call in contenders.items():
            begin = time.perf_counter()
            call()
            best[name] = min(best[name], time.perf_counter() - begin)
    return best


def run(system: Any, method: str, tolerance: float = 1e-7, substeps: int = 1, step_ns: int = STEP_NS) -> Any:
    """Return a motion that has visited its mode sets and has room for SECONDS."""
    ticks = round(SECONDS * 1e9 / step_ns)
    motion = Motion(system, step_ns, method, tolerance=tolerance, substeps=substeps, with_energy=False, longest=ticks)
    motion.advance(ticks)
    return motion, ticks


def event_times(system: Any, method: str, tolerance: float, substeps: int) -> Array:
    """Return the event times [s] of the first SECONDS."""
    motion, _ = run(system, method, tolerance, substeps)
    return np.array([(e.tick + e.place) * STEP_NS * 1e-9 for e in motion.events()])


def precision() -> list[dict[str, Any]]:
    """Return the real-time factor at 1 ms samples of each method, with its event-time error (of a period)."""
    rows: list[dict[str, Any]] = []
    falling, coulomb = pendulum(FALLING), pendulum(COULOMB)
    cases: list[tuple[str, Any, str, float, int]] = [("coulomb", coulomb, "exact", 1e-7, 1)]
    cases += [("stribeck", falling, "dopri5", 10.0**-p, 1) for p in range(3, 11)]
    cases += [
        (law, s, "rk4", 1e-7, n) for law, s in (("stribeck", falling), ("coulomb", coulomb)) for n in (1, 2, 5, 10, 30)
    ]
    truth = {
        "stribeck": event_times(falling, "dopri5", 1e-13, 1),
        "coulomb": event_times(coulomb, "exact", 1e-7, 1),
    }
    fine = event_times(coulomb, "rk4", 1e-7, 100)
    reference = {
        "stribeck": truth["stribeck"],
        "coulomb": fine if len(fine) == len(truth["coulomb"]) else truth["coulomb"],
    }
    for law, system, method, tolerance, substeps in cases:
        times, wanted = event_times(system, method, tolerance, substeps), reference[law]
        period = float(np.median(np.diff(wanted[::2])))
        error = float(np.abs(times - wanted).max() / period) if len(times) == len(wanted) else np.inf
        motion, ticks = run(system, method, tolerance, substeps)
        best = interleaved({"run": lambda m=motion, n=ticks: m.advance(n)}, 7)["run"]  # type: ignore[misc]
        rows.append({"law": law, "method": method, "tolerance": tolerance, "substeps": substeps, "error": error,
                     "rtf": SECONDS / best})  # fmt: skip
    return rows


def scipy_ratio() -> dict[str, Any]:
    """Return the time of scipy's DOP853 with events over that of `exact`, for the same Coulomb pendulum and samples."""
    from scipy.integrate import solve_ivp

    system = pendulum(COULOMB)
    seconds = 4.0
    m, c, d = 5.0, 2500.0, 2.0  # the contact's equivalent of the pendulum
    load, mu_static, mu_kinetic, v0 = 20.0, 0.4, 0.25, 0.06
    samples = np.arange(0.0, seconds, 1e-3)
    crossings: list[float] = []

    def phase(rate: Any, leaves: Any, t: float, x: list[float]) -> tuple[float, list[float], bool]:
        leaves.terminal, leaves.direction = True, -1
        s = solve_ivp(rate, (t, seconds), x, method="DOP853", rtol=1e-9, atol=1e-12, events=leaves,
                      t_eval=samples[samples > t])  # fmt: skip
        if not len(s.t_events[0]):
            return seconds, x, False
        crossings.append(float(s.t_events[0][0]))
        return crossings[-1], list(map(float, s.y_events[0][0])), True

    def by_scipy() -> None:
        crossings.clear()
        t, x, stuck, on = 0.0, [0.0, v0], True, True
        while on:
            if stuck:
                t, x, on = phase(lambda _, y: [v0, 0.0], lambda _, y: mu_static * load - c * y[0] - d * v0, t, x)
                stuck = False
            else:
                t, x, on = phase(
                    lambda _, y: [y[1], (mu_kinetic * load - c * y[0] - d * y[1]) / m], lambda _, y: v0 - y[1], t, x
                )
                x = [x[0], v0]
                stuck = abs(c * x[0] + d * v0) <= mu_static * load

    ticks = round(seconds * 1e9 / STEP_NS)
    motion = Motion(system, STEP_NS, "exact", with_energy=False, longest=ticks)
    motion.advance(ticks)
    wanted = np.array([(e.tick + e.place) * STEP_NS * 1e-9 for e in motion.events()])
    best = interleaved({"scipy": by_scipy, "exact": lambda: motion.advance(ticks)}, 7)
    same = len(crossings) == len(wanted)
    return {
        "ratio": best["scipy"] / best["exact"],
        "events": len(wanted),
        "scipy_event_error": float(np.abs(np.array(crossings) - wanted).max()) if same else np.inf,
    }
