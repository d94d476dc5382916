"""Benchmarks of rigs with one contact, in stick-slip or growing.

speed       the kernel without energy balance
growth      the slider on a flexible disc with seven modes: speed over the error of the simulated growth rate
efficiency  a map of 100 x 100 points with run-up and run-down: its rate, and the gain by a second core
steps       an environment of Gymnasium, one frame of 1 ms a step
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from benchmarks.kernels import exact_seconds
from benchmarks.studies import Workers, apart, rate
from rig.analysis.map import job
from rig.analysis.map.row import units
from rig.bench.run.runner import PlantRunner
from rig.errors import UsageError
from rig.model.method import chosen
from rig.motion.motion import Motion
from rig.scenes.loader import load
from rig.stability import linearisation


class Rubbing(NamedTuple):
    """A scene with `changes`, simulated for `seconds` at a time with its default method."""

    title: str
    scene: str
    changes: Mapping[str, Any]
    seconds: float
    most: float
    """Largest time over that of the pendulum's exact kernel."""

    def motion(self) -> tuple[Motion, int]:
        """Return a motion that already moves, with mode sets and compiled code ready, and the ticks of a round."""
        scene = load(self.scene, dict(self.changes))
        system, ticks = scene.assemble().system(), round(self.seconds * 1e9 / scene.step_ns)
        method, tolerance = chosen(scene.clock.method, system), scene.clock.tolerance
        motion = Motion(
            system, scene.step_ns, method, tolerance=tolerance, cap=100_000, with_energy=False, longest=ticks
        )
        motion.advance(ticks)
        return motion, ticks


EVEN, WAVY, SLOW = {"waviness": None, "drive.speed": 0.06}, {"drive.speed": 0.1}, {"drive.speed": 0.009}
RIGS = {
    "tip": Rubbing("tip of a beam, even surface, 60 mm/s", "tip", EVEN, 0.2, 250.0),
    "tip_waves": Rubbing("the same on waves of 25 um, 100 mm/s", "tip", WAVY, 0.05, 8000.0),
    "tip_beam": Rubbing("the same as a beam in several modes, 9 mm/s", "tip_beam", SLOW, 0.2, 1600.0),
    "four_dof": Rubbing("three bodies on a belt, growing", "four_dof", {}, 5.0, 15.0),
}


def speed(rounds: int = 10) -> dict[str, Any]:
    """Return the real-time factor of each rig in processor time, the rigs alternating, best of `rounds`, and its time
    over that of the pendulum's exact kernel.
    """
    motions = {name: rubbing.motion() for name, rubbing in RIGS.items()}
    best = dict.fromkeys(RIGS, float("inf"))
    for _ in range(rounds):
        for name, (motion, ticks) in motions.items():
            begin = time.process_time()
            motion.advance(ticks)
            best[name] = min(best[name], time.process_time() - begin)
    return over_exact({name: rubbing.seconds / best[name] for name, rubbing in RIGS.items()})


def over_exact(factors: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Return real-time factors, each with the time over that of the pendulum's exact kernel, which is measured here."""
    exact = 1.0 / exact_seconds()
    return {name: {"rtf": rtf, "over_exact": exact / rtf if rtf else math.inf} for name, rtf in factors.items()}


DISC = "disc_slider"
SECONDS = 1.0
PUSH = 1e-4
"""Amplitude of the slip speed at the start, over the speed of the surface; the growth rate changes with its square."""
ROUNDS = 5


def growth(tolerances: tuple[float, ...] = (1e-6, 1e-7, 1e-8, 1e-9, 1e-10)) -> dict[str, Any]:
    """Return for each tolerance of dopri5 the relative error of the growth rate, and the real-time factor: `rows`; and
    the best factor for 1e-4 of the growth rate: `rtf`.

    Sliding is displaced along its least stable mode. The part of that mode after one second, from its left eigenvector,
    gives the growth rate of the simulation, and the eigenvalue gives the exact one.
    """
    scene = load(DISC)
    system = scene.assemble().system()
    at = linearisation.steady(system, linearisation.sliding_key(system))
    rates, left = np.linalg.eig(at.A[np.ix_(at.moving, at.moving)].T)
    first = int(rates.real.argmax())
    shape = at.eigenvectors()[1][:, 0]
    push = shape * PUSH * float(at.speed[0]) / (system.slip_rows @ shape)[0]
    ticks = round(SECONDS / (scene.step_ns * 1e-9))

    def part(x: Any) -> float:
        return abs(complex(left[:, first] @ (x - at.x)[at.moving]))

    rows = []
    for tolerance in tolerances:
        motion = Motion(system, scene.step_ns, "dopri5", tolerance=tolerance, with_energy=False, longest=ticks)
        best = math.inf
        for _ in range(ROUNDS):
            motion.restart(at.x + push.real)
            before = part(motion.x)
            begin = time.perf_counter()
            motion.advance(ticks)
            best = min(best, time.perf_counter() - begin)
            simulated_rate = math.log(part(motion.x) / before) / SECONDS
        error = abs(simulated_rate / float(rates[first].real) - 1.0)
        rows.append({"tolerance": tolerance, "error": error, "rtf": SECONDS / best})
    fastest = max((row["rtf"] for row in rows if row["error"] <= 1e-4), default=0.0)
    return {**over_exact({DISC: fastest})[DISC], "rows": rows}


MAP = "lever"
X, Y = "drive.speed=0.5 rpm:8 rpm:{}", "load.force=10 N:30 N:{}"


def efficiency(points: int) -> dict[str, Any]:
    """Return points per second of a map of `points` x `points` with one and two workers, and what the latter are of two
    maps with one worker each at the same time.
    """
    work = units(job(load(MAP), X.format(points), Y.format(points), runs=("up", "down")))
    alone, two = (rate(work, Workers(workers)).units * points for workers in (1, 2))
    both = apart(work).units * points
    return {"points": points**2, "points_per_s": alone, "points_per_s_of_two": two, "efficiency": two / both}


DRIVEN, STEPS = "belt_normal_force", 5000


def steps(rounds: int = 7) -> dict[str, Any]:
    """Return steps per second and seconds of a reset, in processor time, steps per second of four rigs at once, and the
    time of a step over that of a frame of the bare plant runner.
    """
    try:
        from rig import gym
    except UsageError:
        return {"skipped": "gymnasium is not installed"}
    ranges = {"observe": {"vibrometer": (-0.5, 0.5)}, "act": {"load.force": (0.0, 60.0)}}
    more = {"reward": lambda now: -(now.measured["vibrometer"] ** 2), "duration": 60.0}
    single, four = gym.make(DRIVEN, **ranges, **more), gym.make_vec(DRIVEN, 4, **ranges, **more)  # type: ignore[arg-type]
    action, actions = np.array([20.0]), np.full((4, 1), 20.0)
    best = {"steps": 0.0, "reset_s": np.inf, "steps_of_four": 0.0}
    runner, frame = PlantRunner(load(DRIVEN)), np.inf
    for seed in range(rounds + 1):  # the first one loads kernels
        times = [time.process_time()]
        single.reset(seed=seed)
        times.append(time.process_time())
        for _ in range(STEPS):
            single.step(action)
        times.append(time.process_time())
        four.reset(seed=seed)
        times.append(time.process_time())
        for _ in range(STEPS // 4):
            four.step(actions)
        times.append(time.process_time())
        for _ in range(STEPS):
            runner.frames(1)
        times.append(time.process_time())
        reset, stepped, _, together, bare = np.diff(times).tolist()
        if seed:
            best["reset_s"] = min(best["reset_s"], reset)
            best["steps"] = max(best["steps"], STEPS / stepped)
            best["steps_of_four"] = max(best["steps_of_four"], STEPS // 4 * 4 / together)
            frame = min(frame, bare / STEPS)
    return best | {"over_frame": 1.0 / (best["steps"] * frame)}
