"""The viewer process: receives the messages of a run from the bus and sends them to rerun about 12 times per second.

No publisher ever waits for it. A thread gives each batch to rerun; while rerun is slow or hangs, messages are
collected, then dropped and counted. The process ends when the plant ends, when the window is closed, or on a signal,
within two seconds whatever rerun does. `rig.view.viewer` describes what happens to the window then.

Messages become rows for rerun in batches of bounded size; what is left out is counted. Curves show the lowest and
highest values of all steps and samples in spans of 1 ms or more (`Spans`), so that a squeal is a band and not an alias,
and gaps where messages were lost. The page of rig.web shows the same spans.

Between two batches at most `KEPT` states and, at 1 kHz, `KEPT` samples of a sensor are kept. If nobody takes them, e.g.
because the viewer hangs, the oldest are discarded and counted as dropped.
"""

from __future__ import annotations

import json
import math
import queue
import threading
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig import bus
from rig.bus import messages, run_setup
from rig.bus.port import Receiver, Session, Watch
from rig.bus.run_setup import Setup
from rig.bus.topics import Message
from rig.errors import BusError
from rig.machine.process import stopping
from rig.machine.scheduling import stand_back
from rig.parts import trust_scene
from rig.printable import counted
from rig.structure import model_store
from rig.view import viewer
from rig.view.base import Columns
from rig.view.drawing import HEALTH, Drawing, send
from rig.view.drawing import POINTS as PORTRAIT

if TYPE_CHECKING:
    import rerun as rr


KEPT = 4000
SHOWN_NS = 1_000_000
_FRAMES = 12
_BLOCKS = 400
_ROWS = 400
Reals = NDArray[np.float64]
Integers = NDArray[np.int64]


class Spans(NamedTuple):
    """Extremes in spans of time, each of which begins where the one before ends, the first one at `begin_ns`.

    A span of which nothing is known has NaN as values, and no bits.
    """

    begin_ns: int
    ends_ns: Integers
    low: Reals
    """[name, span]"""
    high: Reals
    bits: Integers
    """Modes of a contact [contact, span], a bit for each."""

    def line(self, row: int) -> tuple[Integers, Reals]:
        """Times [ns] and values of a line that fills the band between the extremes of a name; NaN in gaps."""
        low, high = self.low[row], self.high[row]
        if not (low < high).any():
            return self.ends_ns, low
        begins = np.concatenate(([self.begin_ns], self.ends_ns[:-1]))
        falls = np.diff(low + high, prepend=low[0] + high[0]) < 0.0
        first, second = np.where(falls, high, low), np.where(falls, low, high)
        times = np.stack(((begins + self.ends_ns) // 2, self.ends_ns), axis=1)
        return times.ravel(), np.stack((first, second), axis=1).ravel()


def joined(begin_ns: Integers, end_ns: Integers, low: Reals, high: Reals, bits: Integers, most: int) -> Spans:
    """Spans [name, span] joined to about `most`, but not over a gap, which becomes a span of its own."""
    count = end_ns.size
    begins_run = np.flatnonzero(begin_ns[1:] > end_ns[:-1]) + 1
    run = np.zeros(count, np.int64)
    run[begins_run] = begins_run
    first = np.flatnonzero((np.arange(count) - np.maximum.accumulate(run)) % -(-count // most) == 0)
    gaps = np.flatnonzero(np.isin(first, begins_run))
    ends = np.insert(end_ns[np.append(first[1:], count) - 1], gaps, begin_ns[first[gaps]])
    low, high = np.fmin.reduceat(low, first, axis=1), np.fmax.reduceat(high, first, axis=1)
    low, high = (np.insert(column, gaps, math.nan, axis=1) for column in (low, high))
    bits = np.insert(np.bitwise_or.reduceat(bits, first, axis=1), gaps, 0, axis=1)
    return Spans(int(begin_ns[0]), ends, low, high, bits)


def of_steps(bands: Sequence[Any], outputs: int, modes: Callable[[Integers], Integers], most: int) -> Spans:
    """The extremes in messages `band`; `modes(keys)`: index of the mode [contact, key] in mode sets."""
    begin_ns = np.concatenate([[band.t0_ns, *band.ends_ns[:-1]] for band in bands])
    end_ns = np.concatenate([band.ends_ns for band in bands])
    low, high = (
        np.concatenate([np.reshape(column, (-1, outputs)) for column in columns]).T
        for columns in ([band.low for band in bands], [band.high for band in bands])
    )
    met = modes(np.concatenate([band.modes for band in bands]).astype(np.int64))
    counts = np.concatenate([band.counts for band in bands])
    bits = np.bitwise_or.reduceat(1 << met, np.cumsum(counts) - counts, axis=1)
    return joined(begin_ns, end_ns, low, high, bits, most)


def of_samples(blocks: Sequence[Any], period_ns: int, before_ns: int | None, most: int) -> Spans:
    """The extremes of the samples in blocks; `before_ns`: time of the sample before them, if it has arrived."""
    t_ns = np.concatenate([messages.times(block) for block in blocks])
    v = np.concatenate([np.array(block.v, np.float64) for block in blocks])[None, :]
    begin_ns = np.concatenate([[int(t_ns[0]) - period_ns if before_ns is None else before_ns], t_ns[:-1]])
    lost = t_ns - begin_ns > 1.5 * period_ns
    begin_ns[lost] = t_ns[lost] - period_ns
    return joined(begin_ns, t_ns, v, v, np.zeros(v.shape, np.int64), most)


class Steps(NamedTuple):
    """The latest steps of a plant for its phase portrait, none left out, the last one at `end_ns`."""

    end_ns: int
    step_ns: int
    x: Reals
    v: Reals
    keys: Integers
    """Number of the mode set."""


def latest(bands: Sequence[Any], most: int) -> Steps | None:
    """The last steps among messages `band` that follow one another; None if the rig has no phase portrait."""
    taken: list[Any] = []
    begin_ns, count = bands[-1].ends_ns[-1], 0
    for band in reversed(bands):
        if count < most and band.ends_ns[-1] == begin_ns:
            taken.insert(0, band)
            count += len(band.pair_modes)
            begin_ns -= len(band.pair_modes) * band.step_ns
    if not count:
        return None
    x, v = np.concatenate([np.reshape(band.pair, (-1, 2)) for band in taken])[-most:].T
    keys = np.concatenate([band.pair_modes for band in taken]).astype(np.int64)[-most:]
    return Steps(int(bands[-1].ends_ns[-1]), int(bands[-1].step_ns), x, v, keys)


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
                shown = self._shown(list(rows))
                t_ns = self._frame_ns * np.array([tick for tick, _ in shown], np.int64)
                columns += self._drawing.commands(controller, t_ns, np.array([values for _, values in shown]))
                rows.clear()
        if self._health:
            t_ns = np.array([message.t_ns for message in self._health], np.int64)
            fields = {name: [getattr(message, name) for message in self._health] for name in HEALTH}
            fields["dropped"] = [lost + self.dropped] * t_ns.size
            columns += self._drawing.health(t_ns, fields)
            self._health.clear()
        columns += self._drawing.events(self._events)
        self._events.clear()
        return columns

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
        return self._drawing.picture_of(t_ns, signals, keys, _FRAMES)

    def _take_bands(self) -> list[Columns]:
        bands = list(self._bands)
        self._bands.clear()
        drawing, names = self._drawing, [name for name, _ in self._fields]
        spans = of_steps(bands, len(names), lambda keys: drawing.modes(keys)[None, :], _ROWS)
        self.thinned += sum(len(band.ends_ns) for band in bands) - spans.ends_ns.size
        columns = [drawing.curve(name, *self._after("", spans).line(names.index(name))) for name in drawing.curves]
        self._ends[""] = int(spans.ends_ns[-1])
        begins = np.concatenate(([spans.begin_ns], spans.ends_ns[:-1]))
        columns += drawing.contacts(begins[spans.bits[0] > 0], spans.bits[0][spans.bits[0] > 0])
        if (steps := latest(bands, PORTRAIT)) is not None:
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


PAUSE_S = 0.08
TOPICS = ("state", "band", "meas/*", "applied/*", "health", "event/*", "total/plant")
DEPTH = 1024
"""Messages that wait for the viewer; those that find no room are lost, counted by topic."""
_NICE = 5
_LAST_WORDS_S = 0.3
_LEAVING_S = 0.5


@dataclass(frozen=True)
class Viewing:
    """The result of viewing a run: why it ended, and counts of messages."""

    run: str
    ended: str
    messages: int
    """Number of messages received."""
    lost: dict[str, int] = field(default_factory=dict)
    """Topic -> number of messages missing between the first and the last one received."""
    dropped: int = 0
    """Messages received, but not shown because rerun took nothing."""
    refused: int = 0
    """Messages that were refused."""
    thinned: int = 0
    """Rows left out because they would not be visible."""

    def __str__(self) -> str:
        missing = sum(self.lost.values()) + self.dropped
        refused = f", {self.refused} refused" if self.refused else ""
        return f"{self.ended}; {counted(self.messages, 'message')} shown, {missing or 'none'} dropped{refused}"


def view(
    run: str | None = None,
    *,
    web: bool = False,
    save: Path | str | None = None,
    wait: float = 10.0,
    trust: bool = False,
    name: str = "viewer",
    say: Callable[[str], object] = print,
) -> Viewing:
    """Show a live run, by default the only one, until it ends; wait at most `wait` seconds for it to start.

    It is shown in a window, or with `web` on a browser page whose address is printed, with `save` in a file (.rrd).
    `trust` allows to run the code of parts from files that the run contains. Raises rig.errors.Untrusted for such parts
    without it, BusError without a run, UsageError without a display, OutputError for a file that cannot be written.
    """
    stand_back(_NICE)
    with bus.join(run, role="viewer", name=name, wait=wait) as session:
        bridge = Bridge(session, wait, trust)
        with viewer.sink(session.run, bridge.drawing, until=None, save=save, web=web) as (rec, shown):
            if shown is not None and shown.page:
                say(f"live at {shown.page}\n{viewer.OPEN_TO}")
            session.announce()
            with stopping() as stop:
                viewing = bridge.run(rec, stop, lambda: shown is None or shown.alive)
    say(str(viewing))
    return viewing


def fetched(session: Session, wait: float, trust: bool) -> Setup:
    """The description of a run, whose models are then at hand; `trust`: and whose parts from files may be run."""
    described = run_setup.fetch(session, wait)
    for model in described.models:
        model_store.offer(model)
    if trust:
        trust_scene(described.scene)
    return described


class Bridge:
    """Transfers messages from a session of the bus to a recording stream of rerun."""

    def __init__(self, session: Session, wait: float = 10.0, trust: bool = False) -> None:
        self._session = session
        self.heard: Receiver = session.subscribe(*TOPICS, depth=DEPTH, polled=True)
        self._plant: Watch = session.watch("plant/*")
        described = fetched(session, wait, trust)
        if not self._plant.wait_for("plant", "plant", wait):
            raise BusError(f"run {session.run} has no plant; it has ended")
        sensors = {name: unit for name, (unit, _) in described.sensors.items()}
        self.drawing = Drawing(described.scene, described.outputs, sensors)
        self.feed = Feed(self.drawing, described)

    def run(
        self, rec: rr.RecordingStream, stop: threading.Event, watched: Callable[[], bool] = lambda: True
    ) -> Viewing:
        """Send to `rec` until the plant leaves, `stop` is set, or `watched()` is false."""
        self.drawing.static(rec)
        sender = Sender(rec)
        # a plant that hangs may come back while the session goes on
        while not stop.is_set() and (self._plant.present or not self._session.ended) and watched() and not sender.fault:
            self.listen()
            if sender.free:
                sender.offer(self.feed.take(self.heard.lost))
            stop.wait(PAUSE_S)
            self._plant.poll()
        stopped = stop.is_set()
        quiet = time.monotonic() + (0.0 if stopped or not watched() else _LAST_WORDS_S)
        while time.monotonic() < quiet:  # presence changes arrive before data: the last messages are on their way
            time.sleep(0.05)
            self.listen()
        sender.finish(self.feed.take(self.heard.lost))
        ended = "told to stop" if stopped else "the window was closed" if not watched() else "the plant left"
        counts = self.heard.counts
        return Viewing(
            run=self._session.run,
            ended=sender.fault or ended,
            messages=sum(count.received for count in counts.values()),
            lost={topic: count.lost for topic, count in counts.items() if count.lost},
            dropped=self.feed.dropped,
            refused=self._session.inbound.total,
            thinned=self.feed.thinned,
        )

    def listen(self) -> None:
        """Collect the messages that have arrived."""
        arrived = self.heard.drain()
        for message in arrived:
            if message.topic == "total/plant":  # the plant collects the totals of all processes
                self._session.publisher(f"total/{self._session.name}").put(self._session.totals(), message.t_ns)
        self.feed.add(message for message in arrived if not message.topic.startswith("total/"))


class Sender:
    """A thread that gives batches to rerun, since rerun may block for as long as its viewer hangs."""

    def __init__(self, rec: rr.RecordingStream) -> None:
        self._rec = rec
        self._batches: queue.Queue[list[Columns] | None] = queue.Queue(maxsize=1)
        self._idle = threading.Event()
        self._idle.set()
        self.fault = ""
        """Why nothing can be sent any more; "" if it can."""
        self._thread = threading.Thread(target=self._work, name="rerun", daemon=True)
        self._thread.start()

    @property
    def free(self) -> bool:
        """Whether the last batch has been sent."""
        return self._idle.is_set()

    def offer(self, batch: list[Columns]) -> None:
        """Send a batch; only while `free`."""
        self._idle.clear()
        self._batches.put(batch)

    def finish(self, batch: list[Columns]) -> None:
        """Send a last batch and wait at most 0.5 s until everything is sent."""
        deadline = time.monotonic() + _LEAVING_S
        if self._idle.wait(_LEAVING_S):
            self.offer(batch)
            self._batches.put(None)
        self._thread.join(max(deadline - time.monotonic(), 0.0))

    def _work(self) -> None:
        while (batch := self._batches.get()) is not None:
            try:
                send(self._rec, batch)
            except Exception as fault:  # any exception of rerun: the run does not depend on it
                self.fault = f"rerun failed: {fault}"
            self._idle.set()
        with suppress(Exception):
            self._rec.flush(timeout_sec=_LEAVING_S)
