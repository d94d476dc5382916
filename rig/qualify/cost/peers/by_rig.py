"""The solver of this project in the same comparison: the plant of the scene with one state every millisecond."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from rig.analysis.motion_measures import Setting, eligible, fastest, ladder
from rig.motion.motion import Motion
from rig.scenes.scene import Scene

NAME = "friction-rig"
STEP_NS = 1_000_000


def settings(scene: Scene) -> Iterator[Setting]:
    """Yield every setting of every method."""
    system = scene.assemble().system()
    rate = fastest(system)
    for method, why in eligible(system).items():
        if not why:
            yield from ladder(method, scene, rate)


def prepare(scene: Scene, setting: Setting, seconds: float) -> Callable[[], list[float]]:
    """Return a function that runs once."""
    system = scene.assemble().system()
    ticks = round(seconds * 1e9 / STEP_NS)
    clock = setting.applied(scene).clock
    motion = Motion(
        replace(system),
        STEP_NS,
        setting.method,
        tolerance=clock.tolerance,
        substeps=clock.substeps(STEP_NS),
        with_energy=False,
        longest=ticks,
    )

    def run() -> list[float]:
        motion.x[:] = system.start
        first = motion.tick
        motion.advance(ticks)
        from_tick, events, places = motion.met()
        return ((events[:, 0] + (from_tick - first) + places) * (STEP_NS * 1e-9)).tolist()  # type: ignore[no-any-return]

    return run
