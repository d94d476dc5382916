"""Controllers and sensors of a run: their settings, and how they did."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from rig.analysis.report.html import Html, element, facts, joined, number, table
from rig.analysis.report.outcome import plain
from rig.analysis.report.sketch import sketch
from rig.record.even_times import period
from rig.record.run import Commands, Run
from rig.scenes.scene import Scene
from rig.scenes.sections import values_of
from rig.view import timeline
from rig.view.caption import scene_of

_CLAMPED, _SAFE = 1, 2
"""Status of a command (`rig.record.run.Commands`)."""


def value(content: object, unit: str = "") -> str:
    """A value of a scene with its unit, in words."""
    if isinstance(content, list | tuple):
        return ", ".join(value(one, unit) for one in content)
    if isinstance(content, bool):
        return "yes" if content else "no"
    words = number(content) if isinstance(content, int | float) else str(content)
    return f"{words} {unit}".strip() if unit != "1" else words


def settings(section: Any, recorded: object) -> Iterator[tuple[str, str]]:
    """Yield the settings of an instrument or a controller with units; without its section, as they were recorded."""
    if section is not None:
        yield from ((key, value(found, unit)) for key, (found, unit) in values_of(section))
    else:
        yield from ((str(key), value(found)) for key, found in plain(recorded).items() if found is not None)


def controllers(run: Run, scene: Scene | None) -> Html:
    """Return each controller with its settings, its numbers from the design, and what happened to its commands."""
    recorded = plain(scene_of(run).get("controllers"))
    counted = plain(run.summary.get("loop", run.summary.get("exchange")))
    found = []
    for name in dict.fromkeys((*run.commands, *run.controllers, *recorded)):
        section = scene.controllers.get(name) if scene else None
        own = plain(run.controllers.get(name))
        numbers = plain(own.get("numbers"))
        rows = [*settings(section, recorded.get(name) or own.get("section"))]
        rows += [(f"{key} (design)", value(one)) for key, one in numbers.items()]
        rows += _loop(run, name, plain(counted.get(name)))
        found.append(joined((element("h3", name), facts(rows))))
    return joined(found) or element("p", "No controller took part.")


def _loop(run: Run, name: str, counts: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if (commands := run.commands.get(name)) is not None:
        yield "commands", str(commands.tick.size)
        if commands.tick.size:
            yield from _delays(commands, run.frame_ns)
    for key, count in counts.items():
        if key != "taken" and isinstance(count, int) and count:
            yield str(key).replace("_", " "), str(count)
    trip = plain(run.summary.get("round_trip"))
    if trip.get("max"):
        times = (f"{float(trip[one]) / 1e3:.2f}" for one in ("p50", "p99", "max") if one in trip)
        yield "latency", f"{' / '.join(times)} ms from step to command (p50, p99, worst; all controllers)"
    for topic, count in plain(run.summary.get("lost")).items():
        if str(topic).endswith(f" to {name}"):
            yield "lost", f"{count} of {topic}"


def _delays(commands: Commands, frame_ns: int) -> Iterator[tuple[str, str]]:
    """What the recorded commands themselves say."""
    answers = commands.status != _SAFE
    if answers.any():
        age = (commands.tick - commands.answered)[answers]
        ages = f"{age.mean():.3g} frames of {frame_ns * 1e-6:g} ms on average, {age.max()} at most"
        yield "age of a command", f"{ages}, from its measurement to its effect"
    yield "clamped or completed", str(np.count_nonzero(commands.status == _CLAMPED))
    yield "safe values", f"{np.count_nonzero(~answers)} commands"
    ends = [f"{number(float(v.min()))} to {number(float(v.max()))}" for v in commands.values.T]
    yield "range of the commands", "; ".join(ends)


def sensors(run: Run, scene: Scene | None, marks: list[float]) -> Html:
    """Return a table of all sensors, and each with its curve and its settings. `marks`: begins of stages [s]."""
    if not run.measurements:
        return element("p", "No sensor was recorded.")
    recorded, counted = plain(scene_of(run).get("sensors")), plain(run.summary.get("sensors"))
    end = max([timeline.end_of(run), *(float(t_ns[-1]) * 1e-9 for t_ns, _ in run.measurements.values() if t_ns.size)])
    begin = run.begin_ns * 1e-9
    rows, cards = [], []
    for name, (t_ns, v) in run.measurements.items():
        section = scene.sensors.get(name) if scene else None
        raw, counts, unit = plain(recorded.get(name)), plain(counted.get(name)), run.units.get(f"meas/{name}", "")
        known = v[np.isfinite(v)]
        ends = (float(known.min()), float(known.max())) if known.size else (float("nan"),) * 2
        rate = 1e9 / step if (step := period(t_ns)) else float("nan")
        rows.append((name, str(raw.get("kind", "")), str(raw.get("reads", "")), unit, rate, v.size, *ends,
                     counts.get("clipped", ""), counts.get("dropped_out", "")))  # fmt: skip
        words = f"{number(ends[0])} to {value(ends[1], unit)}" if known.size else "no sample"
        curve = sketch(t_ns, v, (begin, end), marks, f"{name} from {begin:g} to {end:g} s: {words}")
        caption = element("figcaption", element("strong", name), f" {words}")
        fields = element("details", element("summary", "settings"), facts(settings(section, raw)))
        cards.append(element("figure", caption, curve, fields))
    columns = ("sensor", "kind", "reads", "unit", "rate [Hz]", "samples", "lowest", "highest", "clipped", "dropped out")
    return joined((table("What each sensor delivered", columns, rows), element("div", *cards, class_="cards")))
