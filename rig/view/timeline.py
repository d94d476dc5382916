"""The course of a run as time spans: phases of the protocol, marks, and when each controller worked."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from rig.model.system import System
from rig.record.run import Run


class Span(NamedTuple):
    """A time span from `begin` to `end` [s], with its text."""

    begin: float
    end: float
    text: str


class Mark(NamedTuple):
    """A mark at `time` [s], with its text."""

    time: float
    text: str


def begin_of(run: Run) -> float:
    """Time of the first sample of the run [s]: above 0 for a window of a longer run."""
    return float(run.time[0]) if run.time.size else 0.0


def end_of(run: Run) -> float:
    """Time of the last sample of the run [s]."""
    return float(run.time[-1]) if run.time.size else 0.0


def phases(run: Run) -> list[Span]:
    """The steps of the protocol that have a duration."""
    steps = [(e["t_ns"] * 1e-9, _short(e["text"])) for e in run.plant_events if e["kind"] == "step"]
    ends = [t for t, _ in steps[1:]] + [end_of(run)]
    return [Span(begin, end, text) for (begin, text), end in zip(steps, ends) if end > begin]


def _short(text: str) -> str:
    """A short form: "ramp drive.speed to 0.3 rad/s within 2 s" becomes "drive.speed to 0.3 rad/s"."""
    text = text.partition(" within ")[0]
    text = text.replace("load load.force", "load").removeprefix("ramp ")
    return "hold" if text.startswith("hold") else text


def marks(run: Run) -> list[Mark]:
    """Marks of the protocol, an operator or a limit, and changes of parameters that controllers reported."""
    kinds = ("mark", "knock", "fault", "limit", "emergency", "diverged", "parameter", "safe")
    own = [e for e in run.events if e["kind"] == "parameter" and e["source"] in run.commands]
    events = sorted([*(e for e in run.plant_events if e["kind"] in kinds), *own], key=lambda e: int(e["t_ns"]))
    found: dict[int, list[str]] = {}
    for e in events:
        found.setdefault(e["t_ns"], []).append(_marked(e))
    return [Mark(t_ns * 1e-9, ", ".join(texts)) for t_ns, texts in found.items()]


def _marked(event: Mapping[str, Any]) -> str:
    """The text of a mark: of a fault its name, else the first line of the event."""
    if event["kind"] == "fault" and (name := event["data"].get("fault")):
        return str(name) if event["data"].get("begins") else f"{name} over"
    return str(event["text"]).partition("\n")[0]


def controlled(run: Run) -> list[Span]:
    """Spans in which each controller worked (was connected and enabled), in order of time."""
    found: list[Span] = []
    for name in sorted(run.commands):
        found += _controlled(
            run.plant_events, name, _enabled_at(run.scene, name), end_of(run), bool(run.commands[name].tick.size)
        )
    return sorted(found)


def _controlled(
    events: Iterable[Mapping[str, Any]], name: str, enabled: float, end: float, commands: bool
) -> list[Span]:
    switches = [
        (e["t_ns"] * 1e-9, e["kind"] == "connected")
        for e in events
        if e["kind"] in ("connected", "disconnected") and e["data"].get("controller") == name
    ]
    if not switches or not switches[0][1]:  # connected from the start
        switches.insert(0, (0.0, commands))
    spans = []
    for (begin, on), (stop, _) in zip(switches, [*switches[1:], (end, False)]):
        begin = max(begin, enabled)
        if on and begin < stop:
            spans.append(Span(begin, stop, name))
    return spans


def _enabled_at(scene: str, name: str) -> float:
    try:
        return float(json.loads(scene)["controllers"][name].get("enable_at", 0.0))
    except (KeyError, ValueError, TypeError, AttributeError):
        return 0.0


def sections(run: Run) -> list[Span]:
    """The run, divided where a controller begins or stops working: "free", or the names of working controllers."""
    spans, end = controlled(run), end_of(run)
    cuts = sorted({0.0, end, *(t for span in spans for t in (span.begin, span.end))})
    found = []
    for begin, stop in pairwise(cuts):
        at_work = [span.text for span in spans if span.begin <= begin and stop <= span.end]
        found.append(Span(begin, stop, " + ".join(dict.fromkeys(at_work)) or "free"))
    return found


def circuits(run: Run, system: System | None) -> list[Span]:
    """Spans in which a switch of the electrical network was closed, and its position."""
    if system is None or not system.switches or not run.mode.size:
        return []
    known, inverse = np.unique(run.mode, return_inverse=True)
    closed = [_closed(system, int(key)) if key >= 0 else "" for key in known]  # -1: lost in the recording
    names = list(dict.fromkeys(closed))
    which = np.array([names.index(text) for text in closed])[inverse.ravel()]
    cuts = [0, *(np.flatnonzero(np.diff(which)) + 1).tolist(), which.size]
    times = [float(run.time[cut]) for cut in cuts[:-1]] + [end_of(run)]
    spans = zip(times, times[1:], (names[which[cut]] for cut in cuts[:-1]))
    return [Span(begin, end, text) for begin, end, text in spans if text]


def _closed(system: System, key: int) -> str:
    """Names and positions of the switches that are closed in mode set `key`; the first position means open."""
    positions = zip(system.switches, system.modes(key)[4])
    return ", ".join(f"{switch.name} {switch.positions[where].name}" for switch, where in positions if where)
