"""Measured effects of a scene: their cost and influence, the usable methods, and which quantities are computed for
whom.

An effect of the scene is measured by alternating plants with and without it (rig.qualify.cost.effects). An effect that
the plant supports and the scene does not have is measured the other way round: it is added with the values of a shipped
scene, of the same plant if possible.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rig.analysis.cycles.motion_measures import eligible, held
from rig.analysis.pool import Progress
from rig.bench.live.pace import length
from rig.controllers import controller_reads
from rig.errors import RigError, UsageError
from rig.laws import LAWS
from rig.model.method import chosen
from rig.qualify.cost.effects import NO_CHANCE, ROUNDS, Paired, bare, compared, effects
from rig.qualify.cost.report import sheet, tick_labels
from rig.record.film_points import grouped
from rig.scenes.scene import Scene
from rig.scenes.variants import absent, added, declared
from rig.stability.linearisation import sliding_key, steady
from rig.view.palette import BLUE, put

BLOCKS = 50.0  # sample blocks per second, from sensors faster than 1 kHz
MEMORY = "memory of friction"
ON = BLUE  # colours of effects in the figure
ABSENT = "#9aa5b1"
_SAME = 1e-3  # of the largest coefficient: curves of contacts under different loads that count as one
_SPEEDS = np.geomspace(1e-6, 10.0, 141).tolist()  # m/s, at which a law with memory is looked up in steady slip
STATES = 200.0  # most state messages per second


def parts(scene: Scene, rounds: int = ROUNDS, report: Progress | None = None) -> list[Paired]:
    """Return every effect that the plant of `scene` can have; active ones first."""
    lacking = absent(scene)
    about = declared(scene.parameters)
    all_parts = effects(scene, rounds)
    base = bare(scene)
    values = held(scene, scene.assemble())
    if base.assemble().system().remembers:
        try:
            all_parts += compared(base, {MEMORY: _without_memory(base)}, values, rounds)
        except RigError as error:
            all_parts.append(Paired(MEMORY, on=True, why="the law has memory", fault=" ".join(str(error).split())))
    for done, (name, keys) in enumerate(lacking.items(), 1):
        if report is not None:
            report(done, 1 + len(lacking))
        why = f"the scene has no {', '.join(keys)}"
        fault = Paired(name, on=False, why=why, fault=NO_CHANCE)
        if not about[name].random:
            try:
                also = [key for other in about[name].needs for key in lacking.get(other, [])]
                more, like = added(scene, [*also, *keys], of_others=True)
                [paired] = compared(bare(more), {name: base}, values, rounds)
                if like:
                    source = f"as in {like}"
                elif name.endswith(" limits"):
                    source = "with limits at twice the value"
                else:
                    source = "as it is, for it has no numbers"
                all_parts.append(replace(paired, on=False, why=f"{why}; measured {source}"))
                continue
            except RigError as error:
                fault = replace(fault, fault=" ".join(str(error).split()))
        all_parts.append(fault)
    if report is not None:
        report(1 + len(lacking), 1 + len(lacking))
    return all_parts


def _without_memory(scene: Scene) -> Scene:
    """The scene with the coefficient of steady slip in place of a law with memory.

    Raises UsageError if it is not one curve: contacts under different loads differ by more than `_SAME`.
    """
    law = scene.parameters.friction.friction()  # type: ignore[attr-defined]
    system = scene.assemble().system()
    loads = steady(system, sliding_key(system)).load
    remembering = [load for load, patch in zip(loads.tolist(), system.patches) if patch.memory]
    values, others = (law.over(np.array(_SPEEDS), load) for load in (min(remembering), max(remembering)))
    if np.abs(values - others).max() > _SAME * values.max():
        raise UsageError("steady slip of the law depends on the load, and the contacts have different loads")
    static = max(law.at_rest(min(remembering)), values[0]) if law.sticks else values[0]
    table = {"law": "table", "speeds": (0.0, *_SPEEDS), "values": (values[0], *values), "mu_static": static}
    memoryless = LAWS["table"].model_validate(table)
    return replace(scene, parameters=scene.parameters.model_copy(update={"friction": memoryless}))


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


def drawn(parts: Sequence[Paired]) -> list[Paired]:
    """Return what a figure shows of effects: those with a cost, closed if they were measured so."""
    return [replace(shown, on=paired.on) for paired in parts if (shown := paired.closed or paired).timed]


def draw(parts: Sequence[Paired], title: str, machine: dict[str, str], path: Path) -> None:
    """Draw bars: ns per step on the left, changes by measure on the right; absent effects are grey."""
    shown = drawn(parts)[::-1]
    if not shown:
        raise UsageError("--figure: nothing to draw, none of its effects can be left out or added alone")
    with sheet(title, machine) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        left.set_axisbelow(True)
        for place, paired in enumerate(shown):
            colour = ON if paired.on else ABSENT
            tick = paired.shown_cost
            left.barh(place, tick.value, color=colour)
            spread = [[max(tick.value - tick.low, 0.0)], [max(tick.high - tick.value, 0.0)]]
            left.errorbar(tick.value, place, xerr=spread, color="black", lw=0.8, capsize=2)
            sizes = [change.size for change in paired.changes if change.significant]
            right.plot(sizes, [place] * len(sizes), "o", ms=5, color=colour)
            worst = paired.worst
            if worst is not None:
                text = worst.measure.replace("_", " ")
                at = (worst.size, place)
                right.annotate(text, at, (0, 8), textcoords="offset points", ha="right", fontsize=8.5)
            else:
                axes_then_data = ("axes fraction", "data")
                right.annotate("no change", (0.02, place), xycoords=axes_then_data, va="center", fontsize=8.5)
        handles = [left.barh(0, 0, color=colour) for colour in (ON, ABSENT)]
        figure.legend(handles, ["on: if it is dropped", "absent: if it is added"], loc="outside lower left", ncols=2)
        labels = [f"{paired.name.replace('_', ' ')}\n{'on' if paired.on else 'absent'}" for paired in shown]
        left.set_yticks(range(len(shown)), labels)
        whole = max((paired.whole for paired in shown if paired.on), default=max(paired.whole for paired in shown))
        noise = max(paired.noise for paired in shown)
        left.set(xlabel=f"compute that it adds to a step of {whole:.0f} ns [ns]; noise up to {noise:.0f} ns")
        right.set(xscale="log", xlabel="change if left out or added: share of the larger value")
        tick_labels(right)
        figure.supxlabel("\n", fontsize=8.5)  # room for the machine
    put(figure, path)
