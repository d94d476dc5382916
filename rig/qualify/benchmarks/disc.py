"""The slider on a flexible disc with its seven modes: how fast it runs at a stated error of its growth rate.

Sliding is pushed along its least stable motion; what of that motion is there after a second, by its left eigenvector,
tells the growth rate of the simulation, which the eigenvalue knows.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

SCENE = "disc_slider"
SECONDS = 1.0
PUSH = 1e-4
"""Swing of the slip speed at the start, over the speed of the surface; growth changes with its square."""
ROUNDS = 5


def growth(tolerances: tuple[float, ...] = (1e-6, 1e-7, 1e-8, 1e-9, 1e-10)) -> list[dict[str, Any]]:
    """Of each tolerance of dopri5: relative error of the growth rate, and times real time (best of rounds)."""
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
