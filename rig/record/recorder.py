"""The recorder: a separate process that receives every message and can never slow the plant.

Messages wait in a deep ring buffer outside of Python, so that a slow disk first uses memory and only then loses
messages, which are counted. The depth of the ring follows from its share of 300 MB; nothing else grows with the length
of the recording. The file is finished when the plant leaves, or on a signal to stop.
"""

from __future__ import annotations

import json
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rig import bus
from rig.bus import messages, run_setup, topics
from rig.bus.arrivals import Count, Message
from rig.bus.batch import LONGEST
from rig.bus.port import Receiver, Session, Watch
from rig.errors import BusError, LogError
from rig.process import stopping
from rig.record.writer import Writer
from rig.scheduling import stand_back

_KEEPING = 7000  # bytes that Zenoh needs to keep a batch, in addition to its payload (measured)
_DEPTH = (160 << 20) // (LONGEST + _KEEPING)  # batches in the ring; the rest of the process needs 70 MB
_TURN = 1 << 12  # messages taken between two checks for the plant
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
    """Messages missing between received ones, by topic; only topics with missing messages."""
    tail: dict[str, int] = field(default_factory=dict)
    """Messages missing after the last one received, according to the totals that the senders state."""
    untold: list[str] = field(default_factory=list)
    """Senders that restarted before they stated their totals: the losses before the restart are unknown."""
    late: dict[str, int] = field(default_factory=dict)
    """Messages sent before the recorder began to listen."""
    refused: dict[str, int] = field(default_factory=dict)
    """Messages that were refused, by sender and kind."""
    totals: bool = False
    """Whether the plant stated its totals; without them the number of messages lost at the end is unknown."""

    @property
    def lost(self) -> int:
        """Known number of messages that were sent while the recorder listened and are not in the file."""
        return sum(self.gaps.values()) + sum(self.tail.values())

    @property
    def complete(self) -> bool:
        """Whether no message is known to be missing, and the end is known. A recording stopped by the user ends
        there.
        """
        return not (self.lost or self.untold) and (self.totals or self.ended != _LEFT)

    def text(self) -> str:
        """Return the account as one line of text that begins with the path."""
        lost = f"{self.lost} lost" if self.lost else "none lost"
        if not self.totals:  # no sender stated its totals
            lost = (
                f"{self.lost} lost and an unknown number at the end"
                if self.lost
                else "unknown how many lost at the end"
            )
        untold = f", unknown how many of {', '.join(self.untold)} from before a restart" if self.untold else ""
        late = f", {sum(self.late.values())} sent before it began to listen" if self.late else ""
        return f"{self.path}: {self.messages} messages, {lost}{untold}{late}, {self.seconds:.3f} s ({self.ended})"


def default_path(run: str) -> Path:
    """Return the default path of a run's recording; the file of an earlier run of that name is kept."""
    folder = Path("recordings/runs")
    names = (f"{run}.mcap", *(f"{run}-{number}.mcap" for number in range(2, 1000)))
    return next((folder / name for name in names if not (folder / name).exists()), folder / names[0])


def record(
    run: str | None = None,
    path: Path | None = None,
    tell: Callable[[Recording], None] = lambda recording: None,
    name: str = "recorder",
    wait: float = 10.0,
    replace: bool = False,
) -> Recording:
    """Record a live run, the newest by default, until it ends; `tell` gets the account at the end.

    Waits at most `wait` seconds for the run. A file that cannot be written, or that exists and may not be `replace`d,
    raises LogError; the run continues without a recording.
    """
    stand_back(_NICE)
    with bus.join(run, role="recorder", name=name, wait=wait) as session:
        described = run_setup.fetch(session, wait)
        heard = session.subscribe("**", depth=_DEPTH, polled=True)  # every message from here on is received
        plant = session.watch("plant/*")
        if not plant.wait_for("plant", "plant", wait):
            raise BusError(f"run {session.run} has no plant; it has ended")
        writer = Writer(path or default_path(session.run), described, "recorded", replace)
        try:
            session.announce()
            with stopping() as stop:
                recording = _Recorder(session, heard, plant, writer).run(stop)
        except LogError as fault:  # the run's summary will name the reason
            told = messages.event(writer.last_ns, 0, session.name, "fault", str(fault))
            session.publisher(f"event/{session.name}").put(told, writer.last_ns)
            raise
        finally:
            writer.abandon()
    tell(recording)
    return recording


@dataclass
class _Life:
    """The messages of one process until it left and a successor of its name began to count anew."""

    last: dict[str, int] = field(default_factory=dict)
    """Topic -> number of the last received message."""
    told: dict[str, int] = field(default_factory=dict)
    """Topic -> number of messages that it states to have sent."""

    def tail(self) -> dict[str, int]:
        """Return topic -> messages missing after the last one received."""
        return {topic: Count(last=self.last.get(topic, -1)).tail(sent) for topic, sent in self.told.items()}


class _Recorder:
    def __init__(self, session: Session, heard: Receiver, plant: Watch, writer: Writer) -> None:
        self._session, self._heard, self._plant, self._writer = session, heard, plant, writer
        self._lives: dict[str, _Life] = {}
        """Sender -> its present life."""
        self._tails: Counter[str] = Counter()
        """Messages missing at the end of finished lives, by topic."""
        self._untold: set[str] = set()
        """Senders with a life that ended before they stated their totals."""
        self._totals = False
        self._summary: dict[str, Any] = {}

    def run(self, stop: threading.Event) -> Recording:
        while not stop.is_set() and (("plant", "plant") in self._plant.present or not self._session.ended):
            if not self._take():
                stop.wait(_PAUSE_S)
            self._plant.poll()
        quiet = time.monotonic() + _LAST_WORDS_S  # presence arrives before data: the last messages are still on the way
        while not stop.is_set() and time.monotonic() < quiet:
            if not self._take():
                time.sleep(_PAUSE_S)
        while self._take():
            pass
        recording = self._account(_LEFT if not stop.is_set() else "the recorder was told to stop")
        self._writer.close(asdict(recording), self._summary)
        return recording

    def _take(self) -> bool:
        """Record waiting messages, at most a turn's worth; return whether that was all there was time for."""
        taken = 0
        while taken < _TURN and (message := self._heard.get()) is not None:
            taken += 1
            self._follow(message)
            self._writer.write(message.topic, message.payload, message.t_ns, message.seq, time.time_ns())
            if message.topic.startswith("total/"):
                self._compare(message)
            elif message.topic.startswith("event/"):
                self._look(message)
        self._writer.flush_if_due()
        return taken == _TURN

    def _follow(self, message: Message) -> None:
        """Note the number of a message; a number not above the last one on its topic belongs to a new life."""
        owner = topics.owner(message.topic)
        life = self._lives.get(owner)
        if life is None or message.seq <= life.last.get(message.topic, -1):
            life = self._anew(owner, {})
        life.last[message.topic] = message.seq

    def _anew(self, owner: str, last: dict[str, int]) -> _Life:
        """Begin a new life of a sender, of which the messages up to `last` have been received."""
        before, life = self._lives.get(owner), _Life(last)
        if before is not None:
            self._tails.update(before.tail())
            if not before.told:
                self._untold.add(owner)
        self._lives[owner] = life
        return life

    def _compare(self, message: Message) -> None:
        owner = topics.owner(message.topic)
        life, told = self._lives[owner], dict(zip(message.said.sent_topic, message.said.sent))
        past = {topic for topic, sent in told.items() if topic != message.topic and life.last.get(topic, -1) >= sent}
        if past and owner != "plant":  # the plant continues to send, and may overtake its total
            # More was received than this sender sent: it came from a predecessor, and nothing of this sender arrived.
            life = self._anew(owner, {topic: last for topic, last in life.last.items() if topic not in past})
        life.told = told
        if owner == "plant":  # answer at once: the plant waits for the account before it decides the timing verdict
            self._totals = True
            own = f"total/{self._session.name}"
            self._session.publisher(own).put(self._session.totals(), message.t_ns)

    def _look(self, message: Message) -> None:
        event = message.said
        if event.kind == "verdict" and message.topic == "event/plant":
            self._summary = {"verdict": event.text, **json.loads(event.data or "{}")}

    def _account(self, ended: str) -> Recording:
        counts = self._heard.counts
        tails = self._tails.copy()
        for life in self._lives.values():
            tails.update(life.tail())
        return Recording(
            path=str(self._writer.path),
            run=self._session.run,
            ended=ended,
            messages=self._writer.messages,
            seconds=self._writer.last_ns * 1e-9,
            received={topic: count.received for topic, count in counts.items()},
            gaps={topic: count.lost for topic, count in counts.items() if count.lost},
            tail={topic: tail for topic, tail in tails.items() if tail},
            untold=sorted(self._untold),
            late={topic: count.first for topic, count in counts.items() if count.first},
            refused=self._session.door.told(),
            totals=self._totals,
        )
