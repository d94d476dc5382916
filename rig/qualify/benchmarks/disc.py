"""Benchmark of the slider on a flexible disc with seven modes: speed over the error of the simulated growth rate.

Sliding is displaced along its least stable mode. The part of that mode after one second, from its left eigenvector,
gives the growth rate of the simulation, and the eigenvalue gives the exact one.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

SCENE = "disc_slider"
SECONDS = 1.0
PUSH = 1e-4
"""Amplitude of the slip speed at the start, over the speed of the surface; the growth rate changes with its square."""
ROUNDS = 5


def growth(tolerances: tuple[float, ...] = (1e-6, 1e-7, 1e-8, 1e-9, 1e-10)) -> list[dict[str, Any]]:
    """Return for each tolerance of dopri5 the relative error of the growth rate, and the real-time factor (best of
    rounds).
    """
    from rig import load
    from rig.motion.motion import Motion
    from rig.stability.linearisation import sliding_key, steady

    scene = load(SCENE)
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
            found = math.log(part(motion.x) / before) / SECONDS
        error = abs(found / float(rates[first].real) - 1.0)
        rows.append({"tolerance": tolerance, "error": error, "rtf": SECONDS / best})
    return rows
