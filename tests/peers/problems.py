"""Problems from the tests and examples of other projects, each as a scene, its exact value and its source."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import points
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

import rig

HERE = Path(__file__).parent
G, STEEP = 9.81, math.radians(20.0)
STRIBECK = {
    "body.mass": 0.5,
    "body.stiffness": 400.0,
    "body.damping": 0.01 * math.sqrt(200.0),
    "load.force": 40.0,
    "drive.speed": 4.0,
    "friction.mu_static": 1.25,
    "friction.mu_dynamic": 1.0,
    "friction.speed_scale": 0.1,
    "start.velocity": 4.0,
    "limits": "none",
}
"""The belt of exudyn's example with a static force of 50 N, damping 0.005 of critical."""


class Answer(NamedTuple):
    """A value and the processor time [s] that it took. nan: not measured."""

    value: float
    seconds: float = math.nan


class Problem(NamedTuple):
    """A problem of another project. `stored`: the value that the project itself publishes."""

    title: str
    source: str
    measure: str
    unit: str
    exact: Callable[[], float]
    by: str
    ours: Callable[[], Answer]
    tolerance: float
    stored: Mapping[str, float] = {}


def timed(run: Callable[[], Any], least: float = 0.05) -> tuple[Any, float]:
    """The result of `run` and its shortest processor time [s] over at least two runs after a first one."""
    out, best, begin = run(), math.inf, time.process_time()
    for count in range(1000):
        at = time.process_time()
        run()
        best = min(best, time.process_time() - at)
        if count and time.process_time() - begin > least:
            break
    return out, best


def at_end(name: str, output: str) -> Callable[[], Answer]:
    """The last value of an output of the scene `name`, by rig.simulate; its time is that of the whole call."""

    def answer() -> Answer:
        scene = rig.load(HERE / f"{name}.toml")
        run, seconds = timed(lambda: rig.simulate(scene))
        return Answer(float(run.signals[output][-1]), seconds)

    return answer


def _period() -> Answer:
    cycle, seconds = timed(lambda: rig.limit_cycle(rig.load("belt", STRIBECK)))
    return Answer(cycle.period, seconds)


def _lugre() -> Answer:
    travel = at_end("lugre", "displacement")()
    return Answer(2.5 - travel.value, travel.seconds)


def _points() -> Answer:
    return Answer(*timed(points.ours(100_000, 100)))


def _end_of_stick_slip() -> Answer:
    changes = {
        "body.mass": 1.0,
        "body.stiffness": 1.0,
        "body.damping": 0.1,
        "load.force": 1.0,
        "friction.mu_static": 1.0,
        "friction.mu_dynamic": 0.5,
        "friction.speed_scale": 0.5,
        "drive.speed": 1.5,
        "limits": "none",
    }
    with TemporaryDirectory() as folder:
        begin = time.process_time()
        result = rig.branches(rig.load("belt", changes), "drive.speed=1 m/s:2 m/s", out=folder)
        return Answer(result.special("grazing")[0], time.process_time() - begin)


Phase = tuple[Any, dict[Any, Any]]
"""Matrix [1/s] of the linear equations in a phase, and for each next phase the row that is positive until then."""


def walked(
    x: Any, phase: Any, phases: Callable[[Any], Phase], span: tuple[float, float], step: float
) -> tuple[Any, Any]:
    """State and phase at the end of `span` [s]: matrix exponentials, and events as roots over them."""
    t, end = span
    matrix, ends = phases(phase)
    held = {after: bool(row @ x > 1e-9) for after, row in ends.items()}
    while t < end - 1e-12:
        h = min(step, end - t)
        later = expm(matrix * h) @ x
        passed = [after for after, row in ends.items() if held[after] and row @ later < 0.0]
        if not passed:
            t, x = t + h, later
            held = {after: held[after] or bool(row @ x > 0.0) for after, row in ends.items()}
            continue
        at = {
            after: brentq(lambda s, r=ends[after], x=x, A=matrix: r @ expm(A * s) @ x, 0.0, h, xtol=1e-16)
            for after in passed
        }
        phase = min(at, key=lambda after: at[after])
        t, x = t + at[phase], expm(matrix * at[phase]) @ x
        matrix, ends = phases(phase)
        held = dict.fromkeys(ends, False)
    return x, phase


@cache
def conveyor() -> float:
    """The box on the belt to and fro. States x, x', 1, sin, cos; phases: sign of friction, 0 in stick."""
    m, k, d, force, v, w = 20.0, 70.0, 10.0, 1.5 * 20.0 * G, 3.0, 2.0 * math.pi / 50.0
    belt, needed = np.array([0, 0, 0, v, 0]), np.array([k, d, 0, 0, m * v * w])
    one = np.array([0, 0, 1, 0, 0])

    def phases(sign: int) -> Phase:
        A = np.zeros((5, 5))
        A[0, 1], A[3, 4], A[4, 3] = 1.0, w, -w
        if not sign:
            A[1, 4] = v * w
            return A, {1: force * one - needed, -1: force * one + needed}
        A[1] = [-k / m, -d / m, sign * force / m, 0, 0]
        return A, {0: sign * (belt - np.array([0, 1, 0, 0, 0]))}

    return float(walked(np.array([0, 0, 1.0, 0, 1.0]), 0, phases, (0.0, 100.0), 0.05)[0][0])


@cache
def train() -> float:
    """The angle of the clutch at 3 s. States q3, q2, q1, their speeds, 1, sin, cos.

    Phases: signs of clutch and brake, 0 in stick, None without brake.
    """
    inertia, c, d, clutch, brake = np.array([1.0, 0.05, 1.0]), 160.0, 1.0, 80.0, 800.0
    spring = np.array([0, c, -c, 0, d, -d, 0, 0, 0])
    one = np.eye(9)[6]

    def phases(phase: tuple[int, int | None]) -> Phase:
        grip, held = phase
        motor = 200.0 * np.eye(9)[7] * (held is None)
        last = 0.0 * one if held == 0 else spring - (held or 0) * brake * one
        A = np.zeros((9, 9))
        A[[0, 1, 2, 7, 8], [3, 4, 5, 8, 7]] = 1.0, 1.0, 1.0, 100.0, -100.0
        both = (motor - spring) / inertia[:2].sum()
        torque = motor - both * inertia[0]
        A[3] = (motor - clutch * grip * one) / inertia[0] if grip else both
        A[4] = (clutch * grip * one - spring) / inertia[1] if grip else both
        A[5] = last / inertia[2]
        slip = np.eye(9)[3] - np.eye(9)[4]
        ends = {(0, held): grip * slip} if grip else {(s, held): clutch * one - s * torque for s in (1, -1)}
        if held:
            ends[grip, 0] = held * np.eye(9)[5]
        return A, ends

    x, phase = walked(np.array([0, 0, 0, 100.0, 90.0, 90.0, 1.0, 0, 1.0]), (1, None), phases, (0.0, 0.5), 1e-3)
    x, _ = walked(x, (phase[0], 1), phases, (0.5, 3.0), 1e-3)
    return float(x[0] - x[1])


@cache
def bristles() -> float:
    """The displacement of the mass on bristles at 25 s, by an implicit method at 1e-11."""
    s0 = 1e5

    def rates(t: float, q: Any) -> list[float]:
        x, v, z = q
        zt = v - z * abs(v) * s0 / (1.0 + 0.5 * math.exp(-((v / 1e-3) ** 2)))
        return [v, 2.0 * (0.1 * t - x) - (s0 * z + math.sqrt(s0) * zt + 0.4 * v), zt]

    return float(solve_ivp(rates, (0.0, 25.0), [0.0] * 3, method="Radau", rtol=1e-11, atol=1e-16).y[0, -1])


@cache
def belt_period() -> float:
    """The period of stick-slip on exudyn's belt: slip from the release, stick at the speed of the belt."""
    m, k, d, v = 0.5, 400.0, STRIBECK["body.damping"], 4.0

    def rates(t: float, y: Any) -> list[float]:
        return [y[1], (40.0 + 10.0 * math.exp(-(v - y[1]) / 0.1) - k * y[0] - d * y[1]) / m]

    def sticks(t: float, y: Any) -> float:
        return v - float(y[1]) if t > 1e-3 else 1.0

    sticks.terminal = True  # type: ignore[attr-defined]
    release = (50.0 - d * v) / k
    rise = 10.0 / 0.1 / m  # 1/s: the motion leaves the release along the steep part of the law
    start = [release + v * 1e-9, v - k * v / m * 1e-18 / 2.0 * (1.0 + rise * 1e-9)]
    s = solve_ivp(rates, (1e-9, 1.0), start, method="DOP853", rtol=1e-13, atol=1e-15, events=sticks)
    return float(s.t_events[0][0]) + (release - float(s.y_events[0][0][0])) / v


ZERO: Callable[[], float] = lambda: 0.0  # noqa: E731
PROBLEMS = {
    "slope": Problem(
        title="Block on a slope",
        source="MuJoCo documentation, Drake examples: inclined plane; 1 kg, 20 degrees, mu 0.5",
        measure="creep in 1 s",
        unit="m",
        exact=ZERO,
        by="below the limit of friction nothing moves",
        ours=at_end("slope", "displacement"),
        tolerance=0.0,
    ),
    "grip": Problem(
        title="Capsule in a grip",
        source="MuJoCo issue 3328: 45 g, mu 0.7, two fingers with 12 N",
        measure="creep in 1 s",
        unit="m",
        exact=ZERO,
        by="below the limit of friction nothing moves",
        ours=at_end("grip", "displacement"),
        tolerance=0.0,
        stored={"MuJoCo (issue 3328)": 155e-6},
    ),
    "brake": Problem(
        title="Mass that is braked",
        source="Modelica Standard Library, translational brake: 1 kg, 1 m/s, 1 N from 0.1 s",
        measure="place at rest",
        unit="m",
        exact=lambda: 0.6,
        by="0.1 + 1/2",
        ours=at_end("brake", "displacement"),
        tolerance=1e-14,
        stored={"Modelica library (its reference)": 0.6 + 7e-12},
    ),
    "drive_train": Problem(
        title="Drive train with clutch and brake",
        source="Modelica Standard Library, Rotational.Examples.Friction",
        measure="angle of the clutch at 3 s",
        unit="rad",
        exact=train,
        by="phases integrated at 1e-12",
        ours=at_end("drive_train", "clutch_angle"),
        tolerance=1e-10,
        stored={"Modelica library (its reference)": 47.210622017430},
    ),
    "conveyor": Problem(
        title="Box on a belt to and fro",
        source="PathSim, example_stickslip_event",
        measure="place at 100 s",
        unit="m",
        exact=conveyor,
        by="phases integrated at 1e-13",
        ours=at_end("conveyor", "displacement"),
        tolerance=1e-12,
    ),
    "lugre": Problem(
        title="Mass on bristles (LuGre)",
        source="Canudas de Wit et al. 1995; exudyn, lugreFrictionODE1",
        measure="displacement at 25 s",
        unit="m",
        exact=bristles,
        by="Radau at 1e-11",
        ours=_lugre,
        tolerance=1e-9,
        stored={"exudyn (its example, DOPRI5)": 1.90883919923},
    ),
    "belt": Problem(
        title="Mass, spring and belt",
        source="exudyn, massSpringFrictionInteractive; static force 50 N, damping 0.005 of critical",
        measure="period of stick-slip",
        unit="s",
        exact=belt_period,
        by="one period at 1e-13",
        ours=_period,
        tolerance=1e-9,
    ),
    "end": Problem(
        title="End of stick-slip over the speed",
        source="bSTAB (Stender, Hoffmann 2022): m = k = 1, damping ratio 0.05",
        measure="speed",
        unit="m/s",
        exact=lambda: 1.836600972198,
        by="continuation at 1e-12",
        ours=_end_of_stick_slip,
        tolerance=1e-9,
        stored={"bSTAB (shares of 4000 starts: all stick-slip from)": 1.85},
    ),
    "points": Problem(
        title="24 points that open and close",
        source="ring of 24 masses on contact springs under a travelling force (points.py)",
        measure="height of the first point at 0.2 s",
        unit="m",
        exact=points.exact,
        by="multistep method of variable order at 1e-12",
        ours=_points,
        tolerance=1e-9,
    ),
}
