"""The recorder: a process of its own that listens to everything and can never slow the plant.

Messages wait in a deep ring outside of Python, so that a slow disk costs memory first and counted messages last. The
ring is as deep as its share of 300 MB allows; nothing else grows with the length of the recording. The file is finished
when the plant leaves, or on a signal to stop.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rig import bus
from rig.bus import messages, setup
from rig.bus.arrivals import Count, Message
from rig.bus.port import Receiver, Session, Watch
from rig.bus.setup import Setup
from rig.errors import BusError, LogError
from rig.process import stopping
from rig.record.writer import Writer
from rig.scheduling import stand_back

_WAITING = 160 << 20  # bytes of messages that may wait; the rest of the process takes 70 MB
_KEEPING = 2200  # bytes that Zenoh takes to keep a message beside its payload (measured)
_TURN = 1 << 12  # messages taken before the plant is looked for again
_PAUSE_S = 0.005
_LAST_WORDS_S = 0.3
_LEFT = "the plant left"
_NICE = 5


@dataclass
class Recording:
    """An account of what was recorded."""

    path: str
    run: str
    ended: str
    """Why the recording ended."""
    messages: int = 0
    seconds: float = 0.0
    """Simulated time of the last message."""
    received: dict[str, int] = field(default_factory=dict)
    gaps: dict[str, int] = field(default_factory=dict)
    """Messages missing between messages received, topic by topic; only topics that miss some."""
    tail: dict[str, int] = field(default_factory=dict)
    """Messages missing after the last one received, known from what the senders say that they sent."""
    late: dict[str, int] = field(default_factory=dict)
    """Messages sent before the recorder listened."""
    refused: dict[str, int] = field(default_factory=dict)
    """Messages that were not let in, by sender and kind."""
    totals: bool = False
    """Whether the plant told what it had sent; without it the tail is unknown."""

    @property
    def lost(self) -> int:
        """Messages that were sent while the recorder listened and are not in the file, as far as is known."""
        return sum(self.gaps.values()) + sum(self.tail.values())

    @property
    def complete(self) -> bool:
        """Whether nothing is known to miss, nor is it unknown what was sent last: who stops a recording, ends it."""
        return not self.lost and (self.totals or self.ended != _LEFT)

    def text(self) -> str:
        """For a reader, in a line; begins with the path."""
        lost = f"{self.lost} lost" if self.lost else "none lost"
        if not self.totals:  # nobody told what was sent last
            lost = (
                f"{self.lost} lost and an unknown number at the end"
                if self.lost
                else "unknown how many lost at the end"
            )
        late = f", {sum(self.late.values())} sent before it listened" if self.late else ""
        return f"{self.path}: {self.messages} messages, {lost}{late}, {self.seconds:.3f} s ({self.ended})"


def default_path(run: str) -> Path:
    """Where a run is recorded unless the user says otherwise; a file of an earlier run of that name stays."""
    folder = Path("recordings/runs")
    names = (f"{run}.mcap", *(f"{run}-{number}.mcap" for number in range(2, 1000)))
    return next((folder / name for name in names if not (folder / name).exists()), folder / names[0])


def depth(described: Setup) -> int:
    """How many messages of a run may wait, in bytes of their mean size: a frame's step, a state, blocks of 20 ms."""
    frames = max(20_000_000 // described.frame_ns, 1)
    blocks = [8 * max(20_000_000 // max(period_ns, 1), 1) for _, period_ns in described.sensors.values()]
    size = frames * (24 * len(blocks) + 60) + frames * (9 * len(described.outputs) + 27) + sum(blocks)
    return int(_WAITING / (_KEEPING + size / (2 * frames + len(blocks))))


def record(
    run: str | None = None,
    path: Path | None = None,
    tell: Callable[[Recording], None] = lambda recording: None,
    name: str = "recorder",
    wait: float = 10.0,
    replace: bool = False,
) -> Recording:
    """Record a live run, the newest by default, until it ends; `tell` gets the account at the end.

    Waits at most `wait` seconds for the run. A file that cannot be written, or that exists unless it is to be
    `replace`d, raises LogError; the run goes on without.
    """
    stand_back(_NICE)
    with bus.join(run, role="recorder", name=name, wait=wait) as session:
        described = setup.fetch(session, wait)
        heard = session.subscribe("**", depth(described), polled=True)  # from here on nothing is missed
        plant = session.watch("plant/*")
        if not plant.wait_for("plant", "plant", wait):
            raise BusError(f"run {session.run} has no plant; it has ended")
        writer = Writer(path or default_path(session.run), described, "recorded", replace)
        try:
            session.announce()
            with stopping() as stop:
                recording = _Recorder(session, heard, plant, writer).run(stop)
        except LogError as fault:  # let the run's verdict name the reason
            told = messages.event(writer.last_ns, 0, session.name, "fault", str(fault))
            session.publisher(f"event/{session.name}").put(told, writer.last_ns)
            raise
        finally:
            writer.abandon()
    tell(recording)
    return recording


class _Recorder:
    def __init__(self, session: Session, heard: Receiver, plant: Watch, writer: Writer) -> None:
        self._session, self._heard, self._plant, self._writer = session, heard, plant, writer
        self._told: dict[str, tuple[int, int]] = {}
        """Messages that a sender told it had sent, and the number of the last one received, by topic."""
        self._tails: dict[str, int] = {}
        """Messages missing at the end of what a sender sent before it left and another one began to count anew."""
        self._totals = False
        self._summary: dict[str, Any] = {}

    def run(self, stop: threading.Event) -> Recording:
        while not stop.is_set() and (("plant", "plant") in self._plant.present or not self._session.ended):
            if not self._take():
                stop.wait(_PAUSE_S)
            self._plant.poll()
        quiet = time.monotonic() + _LAST_WORDS_S  # presence is told faster than data: the last words are on their way
        while not stop.is_set() and time.monotonic() < quiet:
            if not self._take():
                time.sleep(_PAUSE_S)
        while self._take():
            pass
        recording = self._account(_LEFT if not stop.is_set() else "the recorder was told to stop")
        self._writer.close(asdict(recording), self._summary)
        return recording

    def _take(self) -> bool:
        """Record what waits, a turn's worth of it; whether that was all there was time for."""
        taken = 0
        while taken < _TURN and (message := self._heard.get()) is not None:
            taken += 1
            if message.topic in self._told:
                self._follow(message)
            self._writer.write(message.topic, message.payload, message.t_ns, message.seq, time.time_ns())
            if message.topic.startswith("total/"):
                self._compare(message)
            elif message.topic.startswith("event/"):
                self._look(message)
        self._writer.flush_if_due()
        return taken == _TURN

    def _compare(self, message: Message) -> None:
        counts = self._heard.counts
        for topic, sent in zip(message.said.sent_topic, message.said.sent):
            self._told[topic] = (sent, counts.get(topic, Count()).last)
        if message.topic == "total/plant":  # answer at once: the plant waits for it to pass its verdict
            self._totals = True
            own = f"total/{self._session.name}"
            self._session.publisher(own).put(self._session.totals(), message.t_ns)

    def _follow(self, message: Message) -> None:
        """A message of a topic whose total is told; a number not above the last one is that of a new sender."""
        topic, (sent, last) = message.topic, self._told[message.topic]
        if message.seq > last:
            self._told[topic] = (sent, message.seq)
        else:  # the total is of the sender before, and says nothing of this one
            self._tails[topic] = self._tails.get(topic, 0) + Count(last=last).tail(sent)
            del self._told[topic]

    def _look(self, message: Message) -> None:
        event = message.said
        if event.kind == "verdict" and message.topic == "event/plant":
            self._summary = {"verdict": event.text, **json.loads(event.data or "{}")}

    def _account(self, ended: str) -> Recording:
        counts = self._heard.counts
        tails = dict(self._tails)
        for topic, (sent, last) in self._told.items():
            tails[topic] = tails.get(topic, 0) + Count(last=last).tail(sent)
        return Recording(
            path=str(self._writer.path),
            run=self._session.run,
            ended=ended,
            messages=self._writer.messages,
            seconds=self._writer.last_ns * 1e-9,
            received={topic: count.received for topic, count in counts.items()},
            gaps={topic: count.lost for topic, count in counts.items() if count.lost},
            tail={topic: tail for topic, tail in tails.items() if tail},
            late={topic: count.first for topic, count in counts.items() if count.first},
            refused=self._session.door.told(),
            totals=self._totals,
        )
