"""Benchmark of rigs with one contact, in stick-slip or growing: the kernel without energy balance.

Benchmark of the slider on a flexible disc with seven modes: speed over the error of the simulated growth rate.

Sliding is displaced along its least stable mode. The part of that mode after one second, from its left eigenvector,
gives the growth rate of the simulation, and the eigenvalue gives the exact one.

Benchmark of a map of 100 x 100 points with run-up and run-down: its rate, and the gain by a second core.

Benchmark of the steps of an environment of Gymnasium, one frame of 1 ms each.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from rig.analysis.map import job
from rig.analysis.map.row import units
from rig.errors import UsageError
from rig.model.method import chosen
from rig.motion.motion import Motion
from rig.qualify.benchmarks.studies import Workers, rate
from rig.scenes.loader import load


class Case(NamedTuple):
    """A scene with `changes`, simulated for `seconds` at a time with its default method."""

    title: str
    scene: str
    changes: Mapping[str, Any]
    seconds: float


CASES = {
    "tip": Case("tip of a beam, even surface, 60 mm/s", "tip", {"waviness": None, "drive.speed": 0.06}, 0.2),
    "tip_waves": Case("the same on waves of 25 um, 100 mm/s", "tip", {"drive.speed": 0.1}, 0.05),
    "tip_beam": Case("the same as a beam in several modes, 9 mm/s", "tip_beam", {"drive.speed": 0.009}, 0.2),
    "four_dof": Case("three bodies on a belt, growing", "four_dof", {}, 5.0),
}


def speed(rounds: int = 10) -> dict[str, float]:
    """Return the real-time factor of each case in processor time, the cases alternating, best of `rounds`."""
    motions = {name: _motion(case) for name, case in CASES.items()}
    best = dict.fromkeys(CASES, float("inf"))
    for _ in range(rounds):
        for name, (motion, ticks) in motions.items():
            begin = time.process_time()
            motion.advance(ticks)
            best[name] = min(best[name], time.process_time() - begin)
    return {name: case.seconds / best[name] for name, case in CASES.items()}


def _motion(case: Case) -> tuple[Motion, int]:
    """A motion that already moves, with its mode sets and compiled code ready, and the ticks of a round."""
    scene = load(case.scene, dict(case.changes))
    system, ticks = scene.assemble().system(), round(case.seconds * 1e9 / scene.step_ns)
    method = chosen(scene.clock.method, system)
    motion = Motion(
        system, scene.step_ns, method, tolerance=scene.clock.tolerance, cap=100_000, with_energy=False, longest=ticks
    )
    motion.advance(ticks)
    return motion, ticks


DISC = "disc_slider"
SECONDS = 1.0
PUSH = 1e-4
"""Amplitude of the slip speed at the start, over the speed of the surface; the growth rate changes with its square."""
ROUNDS = 5


def growth(tolerances: tuple[float, ...] = (1e-6, 1e-7, 1e-8, 1e-9, 1e-10)) -> list[dict[str, Any]]:
    """Return for each tolerance of dopri5 the relative error of the growth rate, and the real-time factor (best of
    rounds).
    """
    from rig import load
    from rig.stability.linearisation import sliding_key, steady

    scene = load(DISC)
    system = scene.assemble().system()
    at = steady(system, sliding_key(system))
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
    return rows


MAP = "lever"
X, Y = "drive.speed=0.5 rpm:8 rpm:{}", "load.force=10 N:30 N:{}"


def efficiency(points: int, scene: str = MAP, x: str = X, y: str = Y) -> dict[str, Any]:
    """Return points per second of a map of `points` x `points` with one and two workers, and the efficiency."""
    work = units(job(load(scene), x.format(points), y.format(points), runs=("up", "down")))
    one_worker, two = (rate(work, Workers(workers)).units * points for workers in (1, 2))
    return {"points": points**2, "one": one_worker, "two": two, "efficiency": two / (2.0 * one_worker)}


DRIVEN, STEPS = "belt_normal_force", 5000


def steps(rounds: int = 7) -> dict[str, float]:
    """Return steps per second and seconds of a reset, in processor time, and steps per second of four rigs at once.

    Empty without gymnasium.
    """
    try:
        from rig import gym
    except UsageError:
        return {}
    ranges = {"observe": {"vibrometer": (-0.5, 0.5)}, "act": {"load.force": (0.0, 60.0)}}
    more = {"reward": lambda now: -(now.measured["vibrometer"] ** 2), "duration": 60.0}
    single, four = gym.make(DRIVEN, **ranges, **more), gym.make_vec(DRIVEN, 4, **ranges, **more)  # type: ignore[arg-type]
    action, actions = np.array([20.0]), np.full((4, 1), 20.0)
    best = {"steps": 0.0, "reset": np.inf, "four": 0.0}
    for seed in range(rounds + 1):  # the first one loads kernels
        begin = time.process_time()
        single.reset(seed=seed)
        begun = time.process_time()
        for _ in range(STEPS):
            single.step(action)
        ended = time.process_time()
        four.reset(seed=seed)
        start = time.process_time()
        for _ in range(STEPS // 4):
            four.step(actions)
        taken = time.process_time() - start
        if seed:
            best["reset"] = min(best["reset"], begun - begin)
            best["steps"] = max(best["steps"], STEPS / (ended - begun))
            best["four"] = max(best["four"], STEPS // 4 * 4 / taken)
    return best
