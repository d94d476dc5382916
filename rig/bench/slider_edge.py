"""Where the protocol of a scene takes a slider that travels beyond the edge of its plate: known before the run."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import chain, repeat
from typing import Any

from rig.scenes.protocol import Hold, Load, Ramp, Repeat, Set
from rig.scenes.scene import Scene, controller_drives

SPEED = "drive.speed"
ROUND = 1e-9
"""What rounding may take a slider beyond the edge at which it stops [m]."""


def meets_edge(scene: Scene, duration: float | None = None) -> str:
    """What to tell of a run of `duration` s, or as long as its protocol; "" where the slider stays on its plate.

    Waits of the protocol count nothing: the slider may come to the edge earlier. Nothing is known of a protocol without
    an end, or where a controller or an operator drives the travel.
    """
    assembly = scene.assemble()
    film = assembly.film
    if film is None or not assembly.signals[film.travel] or (scene.protocol and scene.duration_ns is None):
        return ""
    if SPEED in scene.driven or any(SPEED in controller_drives(one) for one in scene.controllers.values()):
        return ""
    left, rest = (math.inf, 0.0) if duration is None else (duration, duration)
    given: Any = scene.parameters
    time, place, speed = 0.0, float(assembly.start[film.travel]), float(given.drive.speed)
    for lasts, to in chain(_pieces(scene.protocol), [(rest, None)]):
        part = min(lasts, left - time)
        after = speed if to is None else speed + (to - speed) * (part / lasts if lasts else 1.0)
        place, time = place + 0.5 * (speed + after) * part, time + part
        speed = after
        if not -ROUND <= place <= film.longest + ROUND:
            return (
                f"the protocol takes the slider beyond the plate's edge by {time:.6g} s: to {1e3 * place:.4g} mm, its "
                f"way is {1e3 * film.longest:.4g} mm\n  a shorter protocol or --duration, a lower drive.speed or "
                "another slider.position; else the run ends there"
            )
        if time >= left:
            break
    return ""


def _pieces(steps: Iterable[Any]) -> Iterator[tuple[float, float | None]]:
    """How long [s] each step lasts, and the speed at its end if it changes it."""
    for step in steps:
        if isinstance(step, Repeat):
            for again in repeat(step.steps, int(step.times)):
                yield from _pieces(again)
        elif isinstance(step, Ramp | Load | Hold):
            lasts = 1e-9 * (step.time if isinstance(step, Hold) else step.over)
            yield lasts, step.to if isinstance(step, Ramp) and step.target == SPEED else None
        elif isinstance(step, Set) and step.target == SPEED:
            yield 0.0, float(step.to)
