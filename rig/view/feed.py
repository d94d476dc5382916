"""Converts messages of the bus to rows for rerun, in batches of bounded size, and counts what it leaves out.

Between two batches at most `KEPT` states and, at 1 kHz, `KEPT` samples of a sensor are kept. If nobody takes them, e.g.
because the viewer hangs, the oldest are discarded and counted as dropped. Curves have at most 1 kHz. For faster sensors
they show the lowest and highest samples, so that a squeal appears as a band and not as an alias.
"""

from __future__ import annotations

import json
from collections import defaultdict, deque
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.bus import messages
from rig.bus.arrivals import Message
from rig.bus.run_setup import Setup
from rig.view.drawing import HEALTH, Drawing
from rig.view.shapes import Columns

KEPT = 4000
SHOWN_NS = 1_000_000
_FRAMES = 12
_BLOCKS = 400
_ROWS = 400


class Feed:
    """Collects messages for a drawing; `take` returns what was collected since the last call."""

    def __init__(self, drawing: Drawing, described: Setup) -> None:
        self._drawing = drawing
        self._fields = [(name, messages.field_name(name)) for name in described.outputs]
        self._states: deque[Any] = deque(maxlen=KEPT)
        self._blocks: dict[str, deque[Any]] = defaultdict(lambda: deque(maxlen=KEPT))
        self._room: dict[str, int] = {}
        self._applied: dict[str, deque[tuple[int, Sequence[float]]]] = defaultdict(lambda: deque(maxlen=KEPT))
        self._frame_ns = described.frame_ns
        self._health: deque[Any] = deque(maxlen=_BLOCKS)
        self._events: deque[dict[str, Any]] = deque(maxlen=_BLOCKS)
        self._now_ns = 0
        self.messages = 0
        self.dropped = 0
        """Messages that arrived but could not be shown because the viewer took nothing."""
        self.thinned = 0
        """Rows left out because they would not be visible."""

    def add(self, arrived: Iterable[Message]) -> None:
        """Collect messages."""
        for message in arrived:
            kind, _, name = message.topic.partition("/")
            content = message.said
            self.messages += 1
            self._now_ns = max(self._now_ns, message.t_ns)
            if kind == "state":
                self._keep(self._states, content)
            elif kind == "meas":
                self._keep_block(name, content)
            elif kind == "applied":
                self._keep_commands(name, content)
            elif kind == "health":
                self._keep(self._health, content)
            elif kind == "event":
                event = {field: getattr(content, field) for field in ("t_ns", "tick", "kind", "text")}
                self._keep(self._events, {**event, "source": name, "data": json.loads(content.data or "{}")})

    def _keep(self, room: deque[Any], message: Any) -> None:
        self.dropped += len(room) == room.maxlen
        room.append(message)

    def _keep_commands(self, controller: str, applied: Any) -> None:
        rows = messages.commands(applied)
        drives = len(rows.values) // len(rows.tick)
        for i, tick in enumerate(rows.tick):
            self._keep(self._applied[controller], (tick, rows.values[i * drives : (i + 1) * drives]))

    def _keep_block(self, sensor: str, block: Any) -> None:
        """Keep a block. The limit is the number of samples, not of messages, because blocks may be long."""
        room = self._blocks[sensor]
        room.append(block)
        size = self._room.get(sensor, 0) + len(block.v)
        while size > KEPT * max(SHOWN_NS // max(block.dt_ns, 1), 1) and len(room) > 1:
            size -= len(room.popleft().v)
            self.dropped += 1
        self._room[sensor] = size

    def take(self, lost: int = 0) -> list[Columns]:
        """Return everything collected as rows; `lost`: number of messages that did not arrive."""
        found: list[Columns] = []
        if self._states:
            found += self._take_states()
        for sensor, blocks in self._blocks.items():
            found += self._take_blocks(sensor, blocks)
        self._room.clear()
        for controller, rows in self._applied.items():
            if rows:
                shown = self._shown(list(rows))
                t_ns = self._frame_ns * np.array([tick for tick, _ in shown], np.int64)
                found += self._drawing.commands(controller, t_ns, np.array([values for _, values in shown]))
                rows.clear()
        if self._health:
            t_ns = np.array([message.t_ns for message in self._health], np.int64)
            fields = {name: [getattr(message, name) for message in self._health] for name in HEALTH}
            fields["dropped"] = [lost + self.dropped] * t_ns.size
            found += self._drawing.health(t_ns, fields)
            self._health.clear()
        found += self._drawing.events(self._events)
        self._events.clear()
        return found

    def _shown(self, rows: list[Any]) -> list[Any]:
        every = -(-len(rows) // _ROWS)
        self.thinned += len(rows) - len(rows[::every])
        return rows[::every]

    def _take_states(self) -> list[Columns]:
        states = list(self._states)
        self._states.clear()
        t_ns = np.array([state.t_ns for state in states], np.int64)
        keys = np.array([state.mode for state in states], np.int64)
        signals = {name: np.array([getattr(state, field) for state in states]) for name, field in self._fields}
        every = -(-t_ns.size // _ROWS)
        self.thinned += t_ns.size - len(t_ns[::every])
        drawing = self._drawing
        return drawing.states(t_ns, signals, keys, every, _FRAMES) + drawing.portrait(t_ns, signals, keys)

    def _take_blocks(self, sensor: str, blocks: deque[Any]) -> list[Columns]:
        if not blocks:
            return []
        t_ns = np.concatenate([messages.times(b) for b in blocks])
        v = np.concatenate([np.array(b.v, np.float64) for b in blocks])
        fine = max(SHOWN_NS // max(blocks[0].dt_ns, 1), 1) if blocks[0].dt_ns else 1
        every = max(int(fine), -(-v.size // _ROWS))
        blocks.clear()
        rows = outline(v, every)
        self.thinned += v.size - rows.size
        return self._drawing.measured(sensor, t_ns[rows], v[rows])


def outline(v: NDArray[np.float64], every: int) -> NDArray[np.int64]:
    """Indices of the samples for a line with every `every`-th row: lowest and highest of each 2 `every` samples."""
    if every < 2:
        return np.arange(v.size)
    rows: set[int] = set()
    for begin in range(0, v.size, 2 * every):
        part = v[begin : begin + 2 * every]
        low, high = np.where(np.isnan(part), np.inf, part), np.where(np.isnan(part), -np.inf, part)
        rows |= {begin + int(low.argmin()), begin + part.size - 1 - int(high[::-1].argmax())}
    return np.array(sorted(rows), np.int64)
