"""Messages of a run become rows for rerun, in batches of bounded size; what is left out is counted.

Between two batches at most `KEPT` states and, at 1 kHz, `KEPT` samples of a sensor are kept. If nobody takes them, e.g.
because the viewer hangs, the oldest are discarded and counted as dropped.
"""

from __future__ import annotations

import json
import math
from collections import defaultdict, deque
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from rig.bus import messages
from rig.bus.run_setup import Setup
from rig.bus.topics import Message
from rig.view.base import Columns
from rig.view.drawing import HEALTH, Drawing
from rig.view.portrait import POINTS
from rig.view.spans import Spans, latest, of_samples, of_steps

KEPT = 4000
SHOWN_NS = 1_000_000  # shortest span of time that a curve shows
_FRAMES = 12  # most frames of the picture in a batch
_BLOCKS = 400  # most messages of a kind that wait
_ROWS = 400  # most rows of a curve in a batch


class Feed:
    """Collects messages for a drawing; `take` returns what was collected since the last call."""

    def __init__(self, drawing: Drawing, described: Setup) -> None:
        self._drawing = drawing
        self._fields = [(name, messages.field_name(name)) for name in described.outputs]
        self._states: deque[Any] = deque(maxlen=KEPT)
        self._bands: deque[Any] = deque(maxlen=_BLOCKS)
        self._blocks: dict[str, deque[Any]] = defaultdict(lambda: deque(maxlen=KEPT))
        self._ends: dict[str, int] = {}
        """Time [ns] of the last sample of each sensor, and of the last span under the name ""."""
        self._periods = {name: period_ns for name, (_, period_ns) in described.sensors.items()}
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
            elif kind == "band" and len(content.low) == len(content.ends_ns) * len(self._fields):
                self._keep(self._bands, content)
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
        columns: list[Columns] = []
        if self._states:
            columns += self._take_states()
        if self._bands:
            columns += self._take_bands()
        for sensor, blocks in self._blocks.items():
            columns += self._take_blocks(sensor, blocks)
        self._room.clear()
        for controller, rows in self._applied.items():
            if rows:
                columns += self._take_commands(controller, rows)
        if self._health:
            columns += self._take_health(lost)
        columns += self._drawing.events(self._events)
        self._events.clear()
        return columns

    def _take_commands(self, controller: str, applied: deque[tuple[int, Sequence[float]]]) -> list[Columns]:
        rows = self._shown(list(applied))
        applied.clear()
        ticks = np.array([tick for tick, _ in rows], np.int64)
        values = np.array([values for _, values in rows])
        return self._drawing.commands(controller, self._frame_ns * ticks, values)

    def _take_health(self, lost: int) -> list[Columns]:
        t_ns = np.array([message.t_ns for message in self._health], np.int64)
        fields = {}
        for name in HEALTH:
            fields[name] = [getattr(message, name) for message in self._health]
        fields["dropped"] = [lost + self.dropped] * t_ns.size
        self._health.clear()
        return self._drawing.health(t_ns, fields)

    def _shown(self, rows: list[Any]) -> list[Any]:
        every = -(-len(rows) // _ROWS)
        self.thinned += len(rows) - len(rows[::every])
        return rows[::every]

    def _take_states(self) -> list[Columns]:
        states = list(self._states)
        self._states.clear()
        t_ns = np.array([state.t_ns for state in states], np.int64)
        keys = np.array([state.mode for state in states], np.int64)
        signals = {}
        for name, field in self._fields:
            signals[name] = np.array([getattr(state, field) for state in states])
        return self._drawing.picture_of(t_ns, signals, keys, _FRAMES)

    def _take_bands(self) -> list[Columns]:
        bands = list(self._bands)
        self._bands.clear()
        drawing = self._drawing
        names = [name for name, _ in self._fields]
        spans = of_steps(bands, len(names), lambda keys: drawing.modes(keys)[None, :], _ROWS)
        self.thinned += sum(len(band.ends_ns) for band in bands) - spans.ends_ns.size
        joined = self._after("", spans)
        columns = []
        for name in drawing.curves:
            t_ns, v = joined.line(names.index(name))
            columns.append(drawing.curve(name, t_ns, v))
        self._ends[""] = int(spans.ends_ns[-1])
        begins = np.concatenate(([spans.begin_ns], spans.ends_ns[:-1]))
        bits = spans.bits[0]
        columns += drawing.contacts(begins[bits > 0], bits[bits > 0])
        steps = latest(bands, POINTS)
        if steps is not None:
            t_ns = steps.end_ns - steps.step_ns * np.arange(steps.x.size - 1, -1, -1)
            columns += drawing.portrait(t_ns, steps.x, steps.v, steps.keys, steps.step_ns)
        return columns

    def _take_blocks(self, sensor: str, blocks: deque[Any]) -> list[Columns]:
        if not blocks:
            return []
        spans = of_samples(blocks, self._periods[sensor], self._ends.get(sensor), self._most(blocks))
        self.thinned += sum(len(block.v) for block in blocks) - spans.ends_ns.size
        spans = self._after(sensor, spans)
        self._ends[sensor] = int(spans.ends_ns[-1])
        blocks.clear()
        return self._drawing.measured(sensor, *spans.line(0))

    def _most(self, blocks: Iterable[Any]) -> int:
        """Number of spans for blocks: at most one in `SHOWN_NS`, and at most `_ROWS`."""
        samples = sum(len(block.v) for block in blocks)
        every: int = max(SHOWN_NS // max(next(iter(blocks)).dt_ns, 1), 1)
        return min(-(-samples // every), _ROWS)

    def _after(self, name: str, spans: Spans) -> Spans:
        """The spans, with one of which nothing is known before them if they do not follow the last ones."""
        if not 0 <= self._ends.get(name, spans.begin_ns) < spans.begin_ns:
            return spans
        nothing = np.full((spans.low.shape[0], 1), math.nan)
        return spans._replace(
            begin_ns=self._ends[name],
            ends_ns=np.insert(spans.ends_ns, 0, spans.begin_ns),
            low=np.hstack((nothing, spans.low)),
            high=np.hstack((nothing, spans.high)),
            bits=np.insert(spans.bits, 0, 0, axis=1),
        )
