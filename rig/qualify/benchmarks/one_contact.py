"""Benchmark of rigs with one contact, in stick-slip or growing: the kernel without energy balance."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, NamedTuple

from rig.model.method import chosen
from rig.motion.motion import Motion
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
