"""The recorder: a separate process that receives every message and can never slow the plant.

Messages wait in a deep ring buffer outside of Python, so that a slow disk first uses memory and only then loses
messages, which are counted. The threads of the bus, which fill it, have priority over other programs; the writing
thread has a lower one. Nothing else grows with the length of the recording: the process needs 300 MB at most. A
plant without a pace waits before the ring overflows (rig.bench.live.housekeeping): the recorder reports its progress.
The file is finished when the plant leaves, or on a signal to stop.
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
from rig.bus import messages, port, run_setup, topics
from rig.bus.batch import WAITING
from rig.errors import BusError, OutputError
from rig.machine import process, scheduling
from rig.machine.files import RUNS
from rig.printable import counted
from rig.record.sender_lives import SenderLives
from rig.record.windows import Trigger, Windows, path_of
from rig.record.writer import Writer

TURN = 1 << 12  # messages taken between two checks for the plant
_PAUSE_S = 0.005  # between two looks at messages: 200 a second. chosen
TELL_S = 0.25  # between two messages of how far the recorder is. chosen
_LAST_WORDS_S = 0.3  # for messages on the way when the plant has left. chosen
_LEFT = "the plant left"
_TOLD = "the recorder was told to stop"
_NICE = 5  # of the thread that writes: behind those that control. chosen


@dataclass
class Recording:
    """An account of what was recorded."""

    path: str
    run: str
    ended: str
    """Why the recording ended."""
    messages: int = 0
    seconds: float = 0.0
    """Simulated time of the plant's last message."""
    received: dict[str, int] = field(default_factory=dict)
    gaps: dict[str, int] = field(default_factory=dict)
    """Messages missing between received ones, by topic; only topics with missing messages. What a sender claims that
    the run neither expects nor has admitted counts nowhere."""
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
    windows: str = ""
    """The recordings of a trigger in words; empty for a recording of everything."""

    @property
    def lost(self) -> int:
        """Known number of messages that were sent while the recorder listened and are not in the file."""
        return sum(self.gaps.values()) + sum(self.tail.values())

    @property
    def complete(self) -> bool:
        """Whether no message is known to be missing, and the end is known. A recording stopped by the user ends
        there.
        """
        return not (self.lost or self.untold) and (self.totals or self.ended == _TOLD)

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
        made = f"{self.windows}, " if self.windows else f"{self.path}: "
        return f"{made}{counted(self.messages, 'message')}, {lost}{untold}{late}, {self.seconds:.3f} s ({self.ended})"


def default_path(run: str, windows: bool = False) -> Path:
    """Return the default path of a run's recording or of its `windows`; files of an earlier run are kept."""
    paths = [RUNS / f"{run}.mcap", *(RUNS / f"{run}-{number}.mcap" for number in range(2, 1000))]
    return next((path for path in paths if not (path_of(path, 1) if windows else path).exists()), paths[0])


def record(
    run: str | None = None,
    path: Path | None = None,
    report: Callable[[Recording], None] = lambda recording: None,
    name: str = "recorder",
    wait: float = 10.0,
    replace: bool = False,
    trigger: Trigger | None = None,
    ticket: Path | None = None,
    say: Callable[[str], object] = lambda text: None,
) -> Recording:
    """Record a live run, the only one by default, until it ends; `report` gets the account at the end.

    With a `trigger` only windows around its firings are recorded (rig.record.windows), and `say` gets a line for each.
    `ticket`: of a run on another host. Waits at most `wait` seconds for the run. A file that cannot be written, or that
    exists and may not be `replace`d, raises OutputError; the run continues without a recording.
    """
    scheduling.stand_back(0)
    with bus.join(run, role="recorder", name=name, wait=wait, ticket=ticket) as session:
        scheduling.receive_first()
        scheduling.stand_back(_NICE)  # this thread only: it writes, which may wait
        described = run_setup.fetch(session, wait)
        heard = session.subscribe(
            *topics.RECORDED, depth=WAITING, polled=True
        )  # every message from here on is received
        plant = session.watch("plant/*")
        if not plant.wait_for("plant", "plant", wait):
            raise BusError(f"run {session.run} has no plant; it has ended")
        base = path or default_path(session.run, trigger is not None)
        writer: Writer | Windows
        if trigger is None:
            writer = Writer(base, described, "recorded", replace)
        else:
            writer = Windows(base, described, trigger, replace, say)
        process.tell("file", str(base))
        try:
            session.announce()
            with process.stopping() as stop:
                recording = RunRecorder(session, described, heard, plant, writer).run(stop)
        except OutputError as fault:  # the run's summary will name the reason
            event = messages.event(writer.last_ns, 0, session.name, "fault", str(fault))
            session.publisher(f"event/{session.name}").put(event, writer.last_ns)
            raise
        finally:
            writer.abandon()
    files = [str(file) for file in (writer.paths if isinstance(writer, Windows) else [base])]
    process.tell(
        "recording", {**asdict(recording), "complete": recording.complete, "text": recording.text(), "files": files}
    )
    report(recording)
    return recording


class RunRecorder:
    """Records what `heard` receives of one run until its end."""

    def __init__(
        self,
        session: port.Session,
        described: run_setup.Setup,
        heard: port.Receiver,
        plant: port.Watch,
        writer: Writer | Windows,
    ) -> None:
        self._session = session
        self._heard = heard
        self._plant = plant
        self._writer = writer
        self._lives = SenderLives()
        self._admitted = {"plant", *session.inbound.reserved}
        """Senders whose losses count."""
        self._totals = False
        self._paced = described.paced
        self._told_s = time.monotonic()
        self._reached_ns = 0
        self._news = False
        """Whether something was recorded since it told its totals."""
        self._summary: dict[str, Any] = {}

    def run(self, stop: threading.Event) -> Recording:
        """Record until the plant has left or `stop` is set; returns the account of the recording.

        Raises BusError if nothing was sent.
        """
        while not stop.is_set() and self._session.goes_on(self._plant):
            if not self._take():
                stop.wait(_PAUSE_S)
        quiet = time.monotonic() + _LAST_WORDS_S  # presence arrives before data: the last messages are still on the way
        while not stop.is_set() and time.monotonic() < quiet:
            if not self._take():
                time.sleep(_PAUSE_S)
        while self._take():
            pass
        ended = _TOLD if stop.is_set() else self._session.gone or _LEFT
        if not self._heard.counts:
            raise BusError(f"run {self._session.run} had not begun when {ended}: nothing is recorded")
        recording = self._account(ended)
        self._writer.close(asdict(recording), self._summary)
        return recording

    def _take(self) -> bool:
        """Record waiting messages, at most a turn's worth; return whether that was all there was time for."""
        taken = 0
        while taken < TURN:
            message = self._heard.get()
            if message is None:
                break
            taken += 1
            self._lives.follow(message)
            self._writer.write(message.topic, message.payload, message.t_ns, message.seq, time.time_ns())
            if message.topic.startswith("total/"):
                self._compare(message)
            elif message.topic.startswith("event/"):
                self._look(message)
            if topics.of_plant(message.topic):
                self._reached_ns = message.t_ns
                self._news = True
        self._writer.flush_if_due()
        if (taken == TURN or (self._news and not self._paced)) and time.monotonic() > self._told_s + TELL_S:
            self._tell(self._reached_ns)
        return taken == TURN

    def _tell(self, t_ns: int) -> None:
        """Publish the own totals. A plant that waits for them sees how far the recorder is."""
        self._told_s = time.monotonic()
        self._news = False
        self._session.publisher(f"total/{self._session.name}").put(self._session.totals(), t_ns)

    def _compare(self, message: topics.Message) -> None:
        self._lives.compare(message)
        if message.topic == "total/plant":  # answer at once: the plant waits for the account before its timing verdict
            self._totals = True
            self._tell(message.t_ns)

    def _look(self, message: topics.Message) -> None:
        event = message.said
        if message.topic != "event/plant":
            return
        if event.kind == "admitted":
            self._admitted.add(json.loads(event.data).get("controller", ""))
        elif event.kind == "verdict":
            self._summary = {"verdict": event.text, **json.loads(event.data or "{}")}

    def _account(self, ended: str) -> Recording:
        counts = self._heard.counts
        self._admitted |= {topic[8:] for topic in counts if topic.startswith("applied/")}  # before it began to listen

        def of_admitted(numbers: dict[str, int]) -> dict[str, int]:
            return {topic: n for topic, n in numbers.items() if n and topics.owner(topic) in self._admitted}

        return Recording(
            path=str(self._writer.path),
            run=self._session.run,
            ended=ended,
            messages=self._writer.messages,
            seconds=self._writer.last_ns * 1e-9,
            received={topic: count.received for topic, count in counts.items()},
            gaps=of_admitted({topic: count.lost for topic, count in counts.items()}),
            tail=of_admitted(self._lives.tails()),
            untold=sorted(self._lives.untold & self._admitted),
            late=of_admitted({topic: count.first for topic, count in counts.items()}),
            refused=self._session.inbound.refusals(),
            totals=self._totals,
            windows=self._writer.text() if isinstance(self._writer, Windows) else "",
        )
