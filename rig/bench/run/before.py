"""Findings before a run: about the rig, the edge of its plate, and delays as long as the run.

Findings about the rig are the same for every command that builds it. `meets_edge` computes whether the protocol moves a
slider beyond the edge of its plate, `DelayWarnings` names sensors and controllers whose delay is as long as the run.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import chain, repeat
from typing import Any

from rig.bench.run.journal import Journal
from rig.controllers import controller_drives
from rig.errors import SceneError
from rig.model.method import chosen
from rig.model.system import Finding, System
from rig.scenes.protocol import Follow, Hold, Load, Ramp, Repeat, Set
from rig.scenes.scene import Scene
from rig.stability.report import stability_report, step_findings

SPEED = "drive.speed"
ROUND = 1e-9
"""Tolerance for rounding when a slider stops at the edge [m]."""


def findings(scene: Scene, system: System | None = None) -> list[Finding]:
    """All findings about the rig of `scene`, the most severe first. `system`: its matrices, if already assembled."""
    clock = scene.clock
    system = scene.assemble().system() if system is None else system
    return stability_report(system, *_steps(scene, system), clock.tolerance)


def _steps(scene: Scene, system: System) -> tuple[str, float, int]:
    """The method of a scene, its sample step [s], and the number of steps of the method in it."""
    substeps = max(1, scene.step_ns // int(scene.clock.rk4_step))
    return chosen(scene.clock.method, system), scene.step_ns * 1e-9, substeps


def refuse_stiff_film(scene: Scene, system: System) -> None:
    """Raise SceneError if a film whose numbers change in a run of `scene` is too stiff for the steps of the run.

    Not if the scene lets unstable rigs run.
    """
    if system.film is None or scene.clock.unstable != "refuse":
        return
    findings = step_findings(system, *_steps(scene, system), scene.clock.tolerance, (0.0, ""))
    if faults := [f"{finding.what}: {finding.remedy}" for finding in findings if finding.level == "error"]:
        raise SceneError(scene.name, faults)


def meets_edge(scene: Scene, duration: float | None = None) -> str:
    """A warning if the slider leaves its plate in a run of `duration` s, by default that of the protocol; else "".

    Waits of the protocol count as 0 s, so the slider may reach the edge earlier. Returns "" for a protocol without an
    end, and if a controller or an operator can change the speed.
    """
    assembly = scene.assemble()
    film = assembly.film
    if (
        film is None
        or not film.travel
        or not assembly.signals[film.travel]
        or (scene.protocol and scene.duration_ns is None)
    ):
        return ""
    if SPEED in scene.driven or any(SPEED in controller_drives(section) for section in scene.controllers.values()):
        return ""
    left, rest = (math.inf, 0.0) if duration is None else (duration, duration)
    given: Any = scene.parameters
    time = 0.0
    place = float(assembly.start[film.travel])
    speed = float(given.drive.speed)
    for lasts, to in chain(_pieces(scene.protocol), [(rest, None)]):
        part = min(lasts, left - time)
        share = part / lasts if lasts else 1.0
        after = speed if to is None else speed + (to - speed) * share
        place += 0.5 * (speed + after) * part
        time += part
        speed = after
        if not -ROUND <= place <= film.longest + ROUND:
            limit = "begins at 0 mm" if place < 0.0 else f"ends at {1e3 * film.longest:.4g} mm"
            return (
                f"the protocol takes the slider beyond the plate's edge by {time:.6g} s: to {1e3 * place:.4g} mm, but "
                f"its travel {limit}\n  use a shorter protocol or --duration, a lower "
                "drive.speed or another slider.position; otherwise the run ends at the edge"
            )
        if time >= left:
            break
    return ""


def _pieces(steps: Iterable[Any]) -> Iterator[tuple[float, float | None]]:
    """(duration [s], speed at the end or None if unchanged) of each step."""
    for step in steps:
        if isinstance(step, Repeat):
            for again in repeat(step.steps, int(step.times)):
                yield from _pieces(again)
        elif isinstance(step, Ramp | Load | Hold):
            lasts = 1e-9 * (step.time if isinstance(step, Hold) else step.over)
            yield lasts, step.to if isinstance(step, Ramp) and step.target == SPEED else None
        elif isinstance(step, Follow) and step.file is None:
            yield 1e-9 * (step.time or 0), None
        elif isinstance(step, Follow) and step.file is not None:
            values = step.file.values(len(step.channels))
            speeds = values[list(step.channels).index(SPEED)].tolist() if SPEED in step.channels else []
            frame = 1e-9 * step.file.frame_ns
            yield from ((0.0 if i == 0 else frame, speed) for i, speed in enumerate(speeds))
            yield 0.0 if speeds else 1e-9 * step.duration, None
        elif isinstance(step, Set) and step.target == SPEED:
            yield 0.0, float(step.to)


class DelayWarnings:
    """Notes a warning in `journal` for each delay of `scene` that is as long as the run, once for each."""

    def __init__(self, scene: Scene, journal: Journal) -> None:
        self._scene = scene
        self._journal = journal
        self._noted: set[str] = set()

    def check(self, length_ns: int) -> None:
        """Note the warnings for a run of this length [ns]."""
        for key, text in _late(self._scene, length_ns):
            if key not in self._noted:
                self._noted.add(key)
                self._journal.note("warning", f"{key}: {text}")


def _late(scene: Scene, duration_ns: int) -> Iterator[tuple[str, str]]:
    """(key, warning) of each sensor and controller whose delay is at least `duration_ns`."""
    length = f"the run of {duration_ns * 1e-9:g} s"
    for name, sensor in scene.sensors.items():
        delay = sensor.front_end().delay_ns
        if delay >= duration_ns:
            yield (
                f"sensors.{name}",
                f"its delay of {delay * 1e-9:g} s is as long as {length}: all that it measures is the "
                "state before the start; shorten the delay or run longer",
            )
    for name, section in scene.controllers.items():
        if section.delay >= duration_ns:
            yield (
                f"controllers.{name}",
                f"its delay of {section.delay * 1e-9:g} s is as long as {length}: no command takes "
                "effect; shorten the delay or run longer",
            )
