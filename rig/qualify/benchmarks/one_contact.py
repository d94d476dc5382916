"""Rigs of one contact that were made for one question each, in stick-slip or growing: kernel, without energy ledger."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, NamedTuple

from rig.model.method import chosen
from rig.motion.motion import Motion
from rig.scenes.loader import load


class Case(NamedTuple):
    """A scene with `changes`, carried on by `seconds` at a time with the method that it takes by itself."""

    told: str
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
    """Times real time of each case, processor time, the cases in turns, best of `rounds`."""
    motions = {name: _motion(case) for name, case in CASES.items()}
    best = dict.fromkeys(CASES, float("inf"))
    for _ in range(rounds):
        for name, (motion, ticks) in motions.items():
            begin = time.process_time()
            motion.advance(ticks)
            best[name] = min(best[name], time.process_time() - begin)
    return {name: case.seconds / best[name] for name, case in CASES.items()}


def _motion(case: Case) -> tuple[Motion, int]:
    """What has begun to move, its mode sets and compiled code at hand, and the ticks of a round."""
    scene = load(case.scene, dict(case.changes))
    system, ticks = scene.assemble().system(), round(case.seconds * 1e9 / scene.step_ns)
    method = chosen(scene.clock.method, system)
    motion = Motion(
        system, scene.step_ns, method, tolerance=scene.clock.tolerance, cap=100_000, with_energy=False, longest=ticks
    )
    motion.advance(ticks)
    return motion, ticks
