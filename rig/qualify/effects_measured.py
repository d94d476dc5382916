"""Measured effects of a scene: their cost and influence, the usable methods, and which quantities are computed for
whom.

An effect of the scene is measured by alternating plants with and without it (rig.qualify.cost.effects). An effect that
the plant supports and the scene does not have is measured the other way round: it is added with the values of a shipped
scene, of the same plant if possible.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from rig.analysis.motion_measures.problem import held
from rig.analysis.motion_measures.settings import eligible
from rig.bench.frame_batches import length
from rig.controllers import controller_reads
from rig.errors import RigError
from rig.model.method import chosen
from rig.qualify.cost.effects import NO_CHANCE, ROUNDS, Paired, bare, compared, effects
from rig.record.film_points import grouped
from rig.scenes.effects import declared
from rig.scenes.scene import Scene
from rig.scenes.variants import absent, added

BLOCKS = 50.0  # sample blocks per second, from sensors faster than 1 kHz
STATES = 200.0  # most state messages per second


@dataclass(frozen=True)
class Part:
    """One effect. `why` it is on or absent; `paired`: its cost, and the change if it is dropped or added."""

    name: str
    on: bool
    why: str
    paired: Paired

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {"name": self.name, "on": self.on, "why": self.why, **self.paired.to_json()}


def parts(scene: Scene, rounds: int = ROUNDS, report: Callable[[int, int], object] | None = None) -> list[Part]:
    """Return every effect that the plant of `scene` can have; active ones first."""
    lacking, about = absent(scene), declared(scene.parameters)
    total, done = 1 + len(lacking), 0

    def say() -> None:
        nonlocal done
        done += 1
        if report is not None:
            report(done, total)

    found = [Part(one.name, True, "the scene names it", one) for one in effects(scene, rounds)]
    say()
    base, values = bare(scene), held(scene, scene.assemble())
    for name, keys in lacking.items():
        why = f"the scene has no {', '.join(keys)}"
        if about[name].random:
            found.append(Part(name, False, why, Paired(name, fault=NO_CHANCE, on=False)))
            say()
            continue
        try:
            also = [key for other in about[name].needs for key in lacking.get(other, [])]
            more, like = added(scene, [*also, *keys], of_others=True)
            [paired] = compared(bare(more), {name: base}, values, rounds)
            own = "with limits at twice the value" if name.endswith(" limits") else "as it is, for it has no numbers"
            source = f"as in {like}" if like else own
            found.append(Part(name, False, f"{why}; measured {source}", replace(paired, on=False)))
        except RigError as error:
            found.append(Part(name, False, why, Paired(name, fault=" ".join(str(error).split()), on=False)))
        say()
    return found


def methods(scene: Scene) -> dict[str, str]:
    """Return for every method "selected", "also suits the scene", or why it cannot be used for this scene."""
    system = scene.assemble().system()
    why = {method: reason or "also suits the scene" for method, reason in eligible(system).items()}
    return why | {chosen(scene.clock.method, system): "selected"}


@dataclass(frozen=True)
class Rate:
    """A quantity or a topic: how often [1/s] it is computed or sent, and for whom."""

    name: str
    rate: float
    asked: str


def signals(scene: Scene) -> Iterator[Rate]:
    """Yield the outputs of the plant. An output without sensor and limit is computed for the state message only."""
    readers: dict[str, list[str]] = {}
    for name, section in scene.sensors.items():
        readers.setdefault(section.reads, []).append(name)
    frames = 1e9 / scene.frame_ns
    groups = grouped(name for name in scene.assemble().outputs if name not in readers and name not in scene.limits)
    for name in dict.fromkeys([*readers, *scene.limits, *groups]):
        if name in readers:
            yield Rate(name, 1e9 / scene.step_ns, f"read by {', '.join(readers[name])}")
        elif name in scene.limits:
            yield Rate(name, frames, "watched by a limit")
        else:
            points = f"{name} of {len(groups[name])} points" if len(groups[name]) > 1 else name
            yield Rate(points, 0.0, "no reader: only in state messages and in the results of rig simulate")


def topics(scene: Scene) -> Iterator[Rate]:
    """Yield the topics of `rig run`."""
    frames = 1e9 / scene.frame_ns
    batches = frames / length(scene, 1.0)
    outside = {name: section for name, section in scene.controllers.items() if name not in scene.in_plant}
    readers: dict[str, list[str]] = {}
    for name, section in outside.items():
        for sensor in controller_reads(section).values():
            readers.setdefault(sensor, []).append(name)
    yield Rate("step", batches, f"controllers {', '.join(outside)}" if outside else "whoever joins")
    for name, section in scene.sensors.items():
        rate = section.rate
        used = f", and read by {', '.join(readers[name])} in the step" if name in readers else ""
        yield Rate(f"meas/{name}", min(rate, BLOCKS), f"the recorder{used}")
    yield Rate("state", min(frames, STATES), "recorder and viewer")
    for name, section in scene.controllers.items():
        if name in outside:
            yield Rate(f"act/{name}", 1e9 / section.period, "the plant")
        yield Rate(f"applied/{name}", min(1e9 / section.period, batches), "the recorder")
