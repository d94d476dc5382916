"""Measured effects of a scene: their cost and influence, the usable methods, and which quantities are computed for
whom.

An effect of the scene is measured by alternating plants with and without it (rig.qualify.cost.effects). An effect that
the plant supports and the scene does not have is measured the other way round: it is added with the values of a shipped
scene, of the same plant if possible.

Effects of a scene as a picture: the cost of each per step, and the change if it is dropped or added.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rig.analysis.motion_measures import eligible, held
from rig.bench.live.pace import length
from rig.controllers import controller_reads
from rig.errors import RigError, UsageError
from rig.model.method import chosen
from rig.qualify.cost.effects import NO_CHANCE, ROUNDS, Paired, bare, compared, effects
from rig.qualify.cost.report import sheet, tick_labels
from rig.record.film_points import grouped
from rig.record.provenance import provenance
from rig.scenes.scene import Scene
from rig.scenes.variants import absent, added, declared
from rig.view.palette import BLUE, put

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

    all_parts = [Part(effect.name, True, "the scene names it", effect) for effect in effects(scene, rounds)]
    say()
    base, values = bare(scene), held(scene, scene.assemble())
    for name, keys in lacking.items():
        why = f"the scene has no {', '.join(keys)}"
        if about[name].random:
            all_parts.append(Part(name, False, why, Paired(name, fault=NO_CHANCE, on=False)))
            say()
            continue
        try:
            also = [key for other in about[name].needs for key in lacking.get(other, [])]
            more, like = added(scene, [*also, *keys], of_others=True)
            [paired] = compared(bare(more), {name: base}, values, rounds)
            own = "with limits at twice the value" if name.endswith(" limits") else "as it is, for it has no numbers"
            source = f"as in {like}" if like else own
            all_parts.append(Part(name, False, f"{why}; measured {source}", replace(paired, on=False)))
        except RigError as error:
            all_parts.append(Part(name, False, why, Paired(name, fault=" ".join(str(error).split()), on=False)))
        say()
    return all_parts


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


ON, ABSENT = BLUE, "#9aa5b1"


def draw(parts: Sequence[Part], scene: Scene, path: Path) -> None:
    """Draw bars: ns per step on the left, changes by measure on the right; absent effects are grey."""
    measured = [(part, part.paired.closed or part.paired) for part in reversed(parts)]
    shown = [(part, paired) for part, paired in measured if not math.isnan(paired.tick.value)]
    if not shown:
        raise UsageError("--figure: nothing to draw, none of its effects can be left out or added alone")
    with sheet(f"{scene.name}: its effects, on or absent", provenance(scene.seed)) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        left.set_axisbelow(True)
        for place, (part, paired) in enumerate(shown):
            colour, tick = (ON if part.on else ABSENT), paired.shown_cost
            left.barh(place, tick.value, color=colour)
            spread = [[max(tick.value - tick.low, 0.0)], [max(tick.high - tick.value, 0.0)]]
            left.errorbar(tick.value, place, xerr=spread, color="black", lw=0.8, capsize=2)
            for change in paired.changes:
                if change.significant:
                    right.plot(change.size, place, "o", ms=5, color=colour)
            worst = paired.worst
            if worst is not None:
                at = (worst.size, place)
                right.annotate(
                    worst.measure.replace("_", " "), at, (0, 8), textcoords="offset points", ha="right", fontsize=8.5
                )
            else:
                right.annotate(
                    "no change", (0.02, place), xycoords=("axes fraction", "data"), va="center", fontsize=8.5
                )
        handles = [left.barh(0, 0, color=colour) for colour in (ON, ABSENT)]
        figure.legend(handles, ["on: if it is dropped", "absent: if it is added"], loc="outside lower left", ncols=2)
        labels = [f"{part.name.replace('_', ' ')}\n{'on' if part.on else 'absent'}" for part, _ in shown]
        left.set_yticks(range(len(shown)), labels)
        whole = max((p.whole for part, p in shown if part.on), default=max(p.whole for _, p in shown))
        noise = max(p.noise for _, p in shown)
        left.set(xlabel=f"compute that it adds to a step of {whole:.0f} ns [ns]; noise up to {noise:.0f} ns")
        right.set(xscale="log", xlabel="change if left out or added: share of the larger value")
        tick_labels(right)
        figure.supxlabel("\n", fontsize=8.5)  # room for the machine
    put(figure, path)
