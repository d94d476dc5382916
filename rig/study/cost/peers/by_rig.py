"""Ourselves, in the same race: the plant of the scene at one state every millisecond."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from rig.scenes.scene import Scene
from rig.solve.motion import Motion
from rig.study.cost.settings import Setting, eligible, fastest, ladder

NAME = "friction-rig"
STEP_NS = 1_000_000


def settings(scene: Scene) -> Iterator[Setting]:
    """Every setting of every method."""
    system = scene.assemble().system()
    rate = fastest(system)
    for method, why in eligible(system, STEP_NS).items():
        if not why:
            yield from ladder(method, scene, rate)


def prepare(scene: Scene, setting: Setting, seconds: float) -> Callable[[], list[float]]:
    """One run."""
    system = scene.assemble().system()
    ticks = round(seconds * 1e9 / STEP_NS)
    clock = setting.applied(scene).clock
    motion = Motion(
        replace(system),
        STEP_NS,
        setting.method,
        tolerance=clock.tolerance,
        substeps=max(1, STEP_NS // clock.rk4_step),
        booking=False,
        longest=ticks,
    )
    x0 = system.start.tolist()

    def run() -> list[float]:
        for i, value in enumerate(x0):
            motion.write(i, value)
        first = motion.tick
        motion.advance(ticks)
        return [(e.tick - first + e.place) * STEP_NS * 1e-9 for e in motion.events()]

    return run
