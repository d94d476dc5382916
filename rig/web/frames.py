"""Converts messages of the bus to frames for the page: JSON texts of bounded size, 20 per second.

A frame has the entries that there is news of:

    n         its number; a gap tells the page that it was too slow
    t         newest simulated time [s]
    now       {"v": [value of each output], "contacts": [index of the mode of each contact]}: the latest state
    rows      {"from": s, "t": [s], "low": [[value] for each output], "high": the same,
              "contacts": [[modes of the contact, as bits] for each contact]}: the extremes of all steps in spans
    meas      {sensor: {"from": s, "t": [s], "low": [value], "high": [value]}}: the same of all samples
    portrait  {"from": s, "step": s, "x": [value], "v": [value], "mode": [index]}: the latest steps, one after the other
    picture   what has moved in the picture (rig.web.picture)
    health    the latest Health message
    events    [{"t", "source", "kind", "text", "data"}]
    lost      messages of the run that did not arrive here, since the begin

Each span ends at its `t`, and begins at the `t` before it, the first one at `from`. If that is not the last `t` of the
frame before, a page has missed something. A span of which nothing is known has null as values; other values that are
null are not finite. Of frames that a page was too slow for it gets one with `missed` and one span for all of them.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rig.bus import messages, topics
from rig.bus.run_setup import Setup
from rig.bus.topics import Message
from rig.model.system import System
from rig.view.contact import Contacts, Modes
from rig.view.spans import Spans, latest, of_samples, of_steps
from rig.web.picture import MovingPicture
from rig.web.plain_json import finite

ROWS = 25
"""Most spans of outputs in a frame; where more have come, spans are joined. # chosen"""
SAMPLES = 50
"""Most spans of a sensor in a frame; where more have come, spans are joined. # chosen"""
STEPS = 500
"""Most steps of the phase portrait in a frame. # chosen"""
EVENTS = 40
"""Most events of a frame; all of them are in the list of the run. # chosen"""
OUTPUTS = ""
"""Among the spans of a frame: those of the outputs. The others have the names of sensors."""
_KEPT = 4096
"""Most messages of a kind that wait for the next frame; the oldest ones are dropped. # chosen"""
_LEAST = 1e-300
"""Least size that is rounded to seven digits: the scale of a smaller one would overflow. # chosen"""


class Frame(NamedTuple):
    """A frame as JSON, whether it has events, and its spans by name."""

    text: str
    events: bool
    spans: Mapping[str, Spans] = {}


class Frames:
    """Collects messages; `take` returns the frame of what has come since the last call."""

    def __init__(self, setup: Setup, system: System | None, picture: MovingPicture | None = None) -> None:
        self._setup = setup
        self._picture = picture
        self._modes = Modes(system)
        self._contacts = Contacts(system)
        self._fields = [messages.field_name(name) for name in setup.outputs]
        self._states: deque[Any] = deque(maxlen=_KEPT)
        self._bands: deque[Any] = deque(maxlen=_KEPT)
        self._blocks: dict[str, deque[Any]] = {}
        self._ends: dict[str, int] = {}  # time [ns] at which the last sample of each sensor was published
        self._health: dict[str, Any] = {}
        self._events: list[dict[str, Any]] = []
        self._t_ns = 0
        self._number = 0

    def add(self, arrived: Iterable[Message]) -> list[dict[str, Any]]:
        """Collect messages; returns the events among them."""
        first = len(self._events)
        for message in arrived:
            kind, _, name = message.topic.partition("/")
            said = message.said
            self._t_ns = max(self._t_ns, message.t_ns)
            if kind == "state":
                self._states.append(said)
            elif kind == "band" and len(said.low) == len(said.ends_ns) * len(self._fields):
                self._bands.append(said)
            elif kind == "meas":
                self._blocks.setdefault(name, deque(maxlen=_KEPT)).append(said)
            elif kind == "health":
                self._health = {field.name: getattr(said, field.name) for field in said.DESCRIPTOR.fields}
            elif kind == "event" and said.kind != "verdict":  # its data are the whole summary
                event = {"t": said.t_ns * 1e-9, "source": name, "kind": said.kind, "text": said.text}
                event["level"] = topics.LEVELS.get(said.kind, "")
                self._events.append({**event, "data": json.loads(said.data or "{}")})
        return self._events[first:]

    def take(self, lost: int = 0) -> Frame | None:
        """The next frame; None if there is no news."""
        if not (self._states or self._bands or self._blocks or self._health or self._events):
            return None
        self._number += 1
        frame: dict[str, Any] = {"n": self._number, "t": self._t_ns * 1e-9, "lost": lost}
        spans: dict[str, Spans] = {}
        if self._states:
            if self._picture is not None:
                self._move(frame, self._picture)
            frame["now"] = self._now()
        if self._bands:
            frame |= self._steps(spans)
        if self._blocks:
            spans |= {name: self._samples(name, blocks) for name, blocks in self._blocks.items()}
            frame["meas"] = of_sensors(spans)
            self._blocks = {}
        if self._health:
            frame["health"] = finite(self._health)
            self._health = {}
        if self._events:
            frame["events"] = finite(self._events[-EVENTS:])
            self._events = []
        return Frame(json.dumps(frame), "events" in frame, spans)

    def _move(self, frame: dict[str, Any], picture: MovingPicture) -> None:
        t_ns = np.array([state.t_ns for state in self._states], np.int64)
        modes = self._modes.indices(np.array([state.mode for state in self._states], np.int64))
        signals = {}
        for name, field in zip(self._setup.outputs, self._fields):
            values = [getattr(state, field) for state in self._states]
            signals[name] = np.array(values)
        try:
            frame["picture"] = finite(picture.frame(t_ns, signals, modes))
        except Exception as fault:  # of a drawer that came with a plant of the user: the run is followed without it
            self._picture = None
            text = f"the picture cannot be drawn: {type(fault).__name__}: {fault}"
            self._events.append({"t": t_ns[-1] * 1e-9, "source": "page", "kind": "warning", "text": text, "data": {}})

    def _now(self) -> dict[str, Any]:
        last = self._states[-1]
        self._states.clear()
        contacts = self._contacts.indices(np.array([last.mode], np.int64))
        return {"v": _plain([getattr(last, field) for field in self._fields]), "contacts": contacts[:, 0].tolist()}

    def _steps(self, spans: dict[str, Spans]) -> dict[str, Any]:
        bands = list(self._bands)
        self._bands.clear()
        spans[OUTPUTS] = of_steps(bands, len(self._fields), self._contacts.indices, ROWS)
        entries = {"rows": columns(spans[OUTPUTS])}
        if (steps := latest(bands, STEPS)) is not None:
            begin_ns = steps.end_ns - steps.x.size * steps.step_ns
            modes = self._modes.indices(steps.keys).tolist()
            portrait = {"x": _plain(steps.x), "v": _plain(steps.v), "mode": modes}
            entries["portrait"] = {"from": begin_ns * 1e-9, "step": steps.step_ns * 1e-9, **portrait}
        return entries

    def _samples(self, sensor: str, blocks: Sequence[Any]) -> Spans:
        spans = of_samples(blocks, self._setup.sensors[sensor][1], self._ends.get(sensor), SAMPLES)
        self._ends[sensor] = int(spans.ends_ns[-1])
        return spans


def missed(frames: Iterable[Mapping[str, Spans]]) -> str:
    """The text of a frame that stands for all of `frames`: extremes over the whole of their time."""
    parts: dict[str, list[Spans]] = {}
    for spans in frames:
        for name, part in spans.items():
            parts.setdefault(name, []).append(part)
    whole = {name: _joined(of_name) for name, of_name in parts.items()}
    rows = {"rows": columns(whole[OUTPUTS])} if OUTPUTS in whole else {}
    return json.dumps({"missed": True, **rows, "meas": of_sensors(whole)})


def _joined(parts: Sequence[Spans]) -> Spans:
    low = np.fmin.reduce(np.concatenate([part.low for part in parts], axis=1), axis=1, keepdims=True)
    high = np.fmax.reduce(np.concatenate([part.high for part in parts], axis=1), axis=1, keepdims=True)
    bits = np.bitwise_or.reduce(np.concatenate([part.bits for part in parts], axis=1), axis=1, keepdims=True)
    return Spans(parts[0].begin_ns, parts[-1].ends_ns[-1:], low, high, bits)


def of_sensors(spans: Mapping[str, Spans]) -> dict[str, Any]:
    """The entry `meas` of a frame."""
    meas = {name: columns(part) for name, part in spans.items() if name != OUTPUTS}
    return {
        name: {"from": rows["from"], "t": rows["t"], "low": rows["low"][0], "high": rows["high"][0]}
        for name, rows in meas.items()
    }


def columns(spans: Spans) -> dict[str, Any]:
    """Spans as columns of a frame: null where nothing is known."""
    times = {"from": spans.begin_ns * 1e-9, "t": (spans.ends_ns * 1e-9).tolist()}
    return {**times, "low": _plain(spans.low), "high": _plain(spans.high), "contacts": spans.bits.tolist()}


def _plain(values: Any) -> Any:
    """An array as lists, numbers with seven digits, which is more than a page can show; null if not finite."""
    v = np.asarray(values, np.float64)
    known = np.isfinite(v)
    size = np.log10(np.abs(v), out=np.zeros(v.shape), where=known & (np.abs(v) > _LEAST))
    scale = 10.0 ** (6.0 - np.floor(size))
    rounded = np.round(v * scale) / scale
    if not known.all():
        rounded = rounded.astype(object)
        rounded[~known] = None
    return rounded.tolist()
