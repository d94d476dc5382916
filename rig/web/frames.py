"""Converts messages of the bus to frames for the page: JSON texts of bounded size, 20 per second.

A frame has the entries that there is news of:

    n         its number; a gap tells the page that it was too slow
    t         newest simulated time [s]
    rows      {"t": [s], "v": [[value] for each output], "mode": [index of the contact state],
              "contacts": [[index of its mode] for each contact]}
    meas      {sensor: {"t": [s], "v": [value]}}
    picture   what has moved in the picture (rig.web.picture)
    commands  {controller: [value of each drive]}: the latest in force
    health    the latest Health message
    events    [{"t", "source", "kind", "text", "data"}]
    lost      messages of the run that did not arrive here, since the begin

Values that are not finite are null.
"""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.bus import messages, topics
from rig.bus.arrivals import Message
from rig.bus.run_setup import Setup
from rig.model.system import System
from rig.view.contact import Contacts, Modes
from rig.view.feed import outline
from rig.web.picture import MovingPicture

ROWS, SAMPLES, EVENTS = 25, 50, 40
"""Most rows of outputs, samples of a sensor and events of one frame; events beyond are in the list of the run."""
_KEPT = 4096


class Frames:
    """Collects messages; `take` returns the frame of what has come since the last call."""

    def __init__(self, setup: Setup, system: System | None, picture: MovingPicture | None = None) -> None:
        self._setup, self._picture = setup, picture
        self._modes, self._contacts = Modes(system), Contacts(system)
        self._fields = [messages.field_name(name) for name in setup.outputs]
        self._states: deque[Any] = deque(maxlen=_KEPT)
        self._blocks: dict[str, deque[Any]] = {}
        self._commands: dict[str, list[float]] = {}
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
            elif kind == "meas":
                self._blocks.setdefault(name, deque(maxlen=_KEPT)).append(said)
            elif kind == "applied":
                rows = messages.commands(said)
                drives = len(rows.values) // len(rows.tick)
                self._commands[name] = list(rows.values[len(rows.values) - drives :])
            elif kind == "health":
                self._health = {field.name: getattr(said, field.name) for field in said.DESCRIPTOR.fields}
            elif kind == "event" and said.kind != "verdict":  # its data are the whole summary
                event = {"t": said.t_ns * 1e-9, "source": name, "kind": said.kind, "text": said.text}
                event["level"] = topics.LEVELS.get(said.kind, "")
                self._events.append({**event, "data": json.loads(said.data or "{}")})
        return self._events[first:]

    def take(self, lost: int = 0) -> tuple[int, str] | None:
        """Number and text of the next frame; None if there is no news."""
        if not (self._states or self._blocks or self._health or self._events or self._commands):
            return None
        self._number += 1
        found: dict[str, Any] = {"n": self._number, "t": self._t_ns * 1e-9, "lost": lost}
        if self._states:
            if self._picture is not None:
                self._move(found, self._picture)
            found["rows"] = self._rows()
        if self._blocks:
            found["meas"] = {name: self._samples(blocks) for name, blocks in self._blocks.items()}
            self._blocks = {}
        if self._commands:
            found["commands"] = {name: _plain(values) for name, values in self._commands.items()}
            self._commands = {}
        if self._health:
            found["health"] = self._health
            self._health = {}
        if self._events:
            found["events"] = self._events[-EVENTS:]
            self._events = []
        return self._number, json.dumps(_finite(found))

    def _move(self, found: dict[str, Any], picture: MovingPicture) -> None:
        t_ns = np.array([state.t_ns for state in self._states], np.int64)
        modes = self._modes.indices(np.array([state.mode for state in self._states], np.int64))
        signals = {
            name: np.array([getattr(state, field) for state in self._states])
            for name, field in zip(self._setup.outputs, self._fields)
        }
        try:
            found["picture"] = picture.frame(t_ns, signals, modes)
        except Exception as fault:  # of a drawer that came with a plant of the user: the run is followed without it
            self._picture = None
            text = f"the picture cannot be drawn: {type(fault).__name__}: {fault}"
            self._events.append({"t": t_ns[-1] * 1e-9, "source": "page", "kind": "warning", "text": text, "data": {}})

    def _rows(self) -> dict[str, Any]:
        states = list(self._states)
        self._states.clear()
        states = states[:: -(-len(states) // ROWS)]
        keys = np.array([state.mode for state in states], np.int64)
        return {
            "t": [state.t_ns * 1e-9 for state in states],
            "v": [_plain([getattr(state, field) for state in states]) for field in self._fields],
            "mode": self._modes.indices(keys).tolist(),
            "contacts": self._contacts.indices(keys).tolist(),
        }

    def _samples(self, blocks: Sequence[Any]) -> dict[str, Any]:
        t = np.concatenate([messages.times(block) for block in blocks]) * 1e-9
        v = np.concatenate([np.array(block.v, np.float64) for block in blocks])
        rows: NDArray[np.int64] = outline(v, -(-v.size // SAMPLES))
        return {"t": t[rows].tolist(), "v": _plain(v[rows].tolist())}


def _plain(values: Iterable[float]) -> list[float | None]:
    """Values with seven digits, which is more than a page can show."""
    return [float(f"{value:.7g}") if math.isfinite(value) else None for value in values]


def _finite(found: Any) -> Any:
    """The same without numbers that JSON does not have."""
    if isinstance(found, dict):
        return {key: _finite(value) for key, value in found.items()}
    if isinstance(found, list):
        return [_finite(value) for value in found]
    return None if isinstance(found, float) and not math.isfinite(found) else found
