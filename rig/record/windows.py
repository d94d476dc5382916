"""Windows of a run around the firings of a trigger: each one is a recording of its own, NAME-001.mcap and so on.

The latest messages wait in memory. The first sample that meets the condition opens a window: the waiting messages are
written, then everything up to `after` the firing. A window has a fixed length. Samples that meet the condition in it
change nothing; the first one after it opens the next window, which begins where this one ended if `before` reaches
that far. So the recordings of a long vibration follow each other without gap and without overlap, and the size of each
is bounded. The condition of a trigger is one sensor or plant output beyond a level, such as "vibrometer > 0.1 m/s".
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from rig.bus import messages, run_setup, topics
from rig.errors import BusError, UsageError
from rig.quantities import Condition
from rig.record.run_data import MEASURED, TRUE, listing, unknown
from rig.record.writer import Writer

_SLACK_NS = 100_000_000
"""Simulated time kept beyond both ends of a window: the samples of a sensor come in blocks of 20 ms."""
_FLOWING = ("state", "applied", "meas", "truth")
"""Topics of the plant that go on for the whole run: a window is complete when those in it have reached its end."""
_PATIENCE_NS = 1_000_000_000
"""Longest wait for the others of them, after one has reached the end of a window [ns of wall time]."""
_OVERHEAD = 250
"""Memory of a waiting message in addition to its payload [bytes]. # measured: 224"""
_DIGITS = 3  # at least, of the number of a window in the name of its file
MEMORY = 64 << 20
"""Memory for the messages before a firing [bytes]."""


@dataclass(frozen=True)
class Trigger:
    """What is kept around each firing of a condition: `before` and `after` it [s], in at most `most` recordings."""

    condition: Condition
    before: float
    after: float
    most: int
    memory: int = MEMORY
    """Memory for the messages before a firing [bytes]; with less than `before` in it, the recording says so."""

    def options(self) -> list[str]:
        """The options of `rig live record` for this trigger."""
        times = {"--before": repr(self.before), "--after": repr(self.after), "--most": str(self.most)}
        return [f"--trigger={self.condition}", *(f"{option}={value}" for option, value in times.items())]


def condition(text: str) -> Condition:
    """Read "NAME > VALUE UNIT", "NAME < VALUE UNIT" or "|NAME| > VALUE UNIT". Raises UsageError."""
    expected = (
        'NAME > VALUE or NAME < VALUE with a unit, such as "vibrometer > 0.1 m/s"; |NAME| compares the absolute value'
    )
    return Condition.read(text, "--trigger", "<>|", expected)


@dataclass(frozen=True)
class Bound:
    """A condition on messages of `topic`, whose samples `read` returns: times [ns] and values in `unit`."""

    condition: Condition
    unit: str
    level: float
    topic: str
    read: Callable[[bytes], tuple[NDArray[np.int64], NDArray[np.float64]]]

    def beyond(self, v: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return by how much each value is beyond the level; positive where the condition holds."""
        size = np.abs(v) if self.condition.size else v
        return np.asarray(size - self.level if self.condition.sense == ">" else self.level - size)


def bound(given: Condition, outputs: Mapping[str, str], sensors: Mapping[str, str]) -> Bound:
    """Return the condition on a channel of a run with these outputs and sensors (name -> unit).

    Raises UsageError for a name that the run does not have, and for a level whose unit does not fit.
    """
    known = listing(sensors, outputs)
    if given.name not in known:
        raise unknown(given.name, known, "run")
    unit = known[given.name]
    level = given.level_in(unit, plain=False)
    if given.size and (level < 0.0 or (level == 0.0 and given.sense == "<")):
        raise UsageError(f"--trigger {given}: an absolute value is never below 0; take a level above 0 {unit}")
    if given.name in sensors:
        return Bound(given, unit, level, MEASURED + given.name, _block)
    field = messages.field_name(given.name.removeprefix(TRUE))
    state = messages.state_type(list(outputs))

    def read(payload: bytes) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        content: Any = state.FromString(payload)
        return np.array([content.t_ns], np.int64), np.array([getattr(content, field)])

    return Bound(given, unit, level, "state", read)


def _block(payload: bytes) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    block: Any = messages.TYPES["Block"].FromString(payload)
    return messages.times(block), np.array(block.v, np.float64)


class _Waiting(NamedTuple):
    topic: str
    payload: bytes
    t_ns: int
    seq: int
    wall_ns: int


def path_of(base: Path, number: int) -> Path:
    """Return the path of recording `number`, counted from 1: NAME-001.mcap for NAME.mcap."""
    return base.with_name(f"{base.stem}-{number:0{_DIGITS}}{base.suffix or '.mcap'}")


def refuse_existing(base: Path, replace: bool) -> None:
    """Raise UsageError if the first window of this name exists and may not be `replace`d."""
    if not replace and path_of(base, 1).exists():
        raise UsageError(f"{path_of(base, 1)} exists; name another file, or add --force to replace it")


class Windows:
    """Takes the messages of a run in place of a `Writer`, and writes a recording around each firing.

    `say` gets a line for each firing. Raises UsageError for a condition that does not fit the run, and for windows of
    an earlier watch that may not be `replace`d.
    """

    def __init__(
        self,
        base: Path,
        setup: run_setup.Setup,
        trigger: Trigger,
        replace: bool = False,
        say: Callable[[str], object] = str,
    ) -> None:
        self.path = base
        self.setup = setup
        self.trigger = trigger
        self.messages = 0
        """Number of messages written, in all recordings."""
        self.last_ns = 0
        """Simulated time of the latest message of the plant."""
        self.paths: list[Path] = []
        """The recordings that were begun."""
        sensors = {name: unit for name, (unit, _) in setup.sensors.items()}
        self._bound = bound(trigger.condition, setup.outputs, sensors)
        self._replace = replace
        self._say = say
        self._before_ns = round(trigger.before * 1e9)
        self._after_ns = round(trigger.after * 1e9)
        self._waiting: deque[_Waiting] = deque()
        self._size = 0
        self._dropped_ns = -1
        """Simulated time of the latest message that did not fit into the memory."""
        self._armed_ns = -1
        """Samples up to here open no window."""
        self._ends_ns = 0
        self._writer: Writer | None = None
        self._beyond: list[_Waiting] = []
        """Messages beyond the end of the open window, from the first one of the plant on."""
        self._behind: set[str] = set()
        """Topics whose messages up to that end are still to come: a batch has one topic after the other."""
        self._last: dict[str, int] = {}
        self._lost: Counter[str] = Counter()
        self._closest = (-np.inf, 0.0, 0)
        """The sample that came closest to the level: distance, value, time [ns]."""
        refuse_existing(base, replace)

    def write(self, topic: str, payload: bytes, t_ns: int, seq: int, wall_ns: int) -> None:
        """Take a message: write it if a window is open, else keep it for the next one."""
        if topics.of_plant(topic):  # nobody else moves a window
            self.last_ns = max(self.last_ns, t_ns)
        message = _Waiting(topic, payload, t_ns, seq, wall_ns)
        if self._writer is not None and self._follows(message):
            self._hold(message)
            return
        self._wait(message)
        if topic == self._bound.topic:
            self._look(payload)

    def _follows(self, message: _Waiting) -> bool:
        """Whether a message is of what follows the open window; one of many commands is where its first one is."""
        limit_ns = self._ends_ns + _SLACK_NS
        if min(self.last_ns, message.t_ns) <= limit_ns:
            return False
        if message.topic.startswith("applied/"):
            with suppress(DecodeError, BusError):
                applied: Any = messages.TYPES["Applied"].FromString(message.payload)
                return min(messages.commands(applied).tick) * self.setup.frame_ns > limit_ns
        return True

    def _hold(self, message: _Waiting) -> None:
        """Keep a message for what follows the open window; end the window when it is complete."""
        if not self._beyond:
            self._behind = {topic for topic in self._last if topic.partition("/")[0] in _FLOWING}
        self._beyond.append(message)
        self._behind.discard(message.topic)
        if not self._behind or message.wall_ns > self._beyond[0].wall_ns + _PATIENCE_NS:
            self._end()

    def _end(self) -> None:
        """End the window at its time, and take what was held."""
        self._close("the window of the trigger ended", {})
        held = self._beyond
        self._beyond = []
        for message in held:
            self.write(*message)

    def _wait(self, message: _Waiting) -> None:
        if self._writer is not None:
            self._put(message)
            return
        if len(self.paths) >= self.trigger.most:
            return
        self._waiting.append(message)
        self._size += len(message.payload) + _OVERHEAD
        oldest = self.last_ns - self._before_ns - _SLACK_NS
        while self._waiting and (self._waiting[0].t_ns < oldest or self._size > self.trigger.memory):
            gone = self._waiting.popleft()
            self._size -= len(gone.payload) + _OVERHEAD
            if gone.t_ns >= oldest:
                self._dropped_ns = max(self._dropped_ns, gone.t_ns)

    def _look(self, payload: bytes) -> None:
        """Open a window at the first sample that meets the condition and is in no window before."""
        with suppress(DecodeError):  # no valid message: recorded as received
            t_ns, v = self._bound.read(payload)
            beyond = np.where(t_ns > self._armed_ns, self._bound.beyond(v), np.nan)
            if np.isnan(beyond).all():
                return
            best = int(np.nanargmax(beyond))
            if beyond[best] > self._closest[0]:
                self._closest = (float(beyond[best]), float(v[best]), int(t_ns[best]))
            fired = np.flatnonzero(beyond > 0.0)
            if fired.size and self._writer is None and len(self.paths) < self.trigger.most:
                self._open(int(t_ns[fired[0]]), float(v[fired[0]]))

    def _open(self, fired_ns: int, value: float) -> None:
        path = path_of(self.path, len(self.paths) + 1)
        wanted_ns = max(fired_ns - self._before_ns, self._armed_ns + 1, 0)
        begin_ns = min((message.t_ns for message in self._waiting if topics.of_plant(message.topic)), default=fired_ns)
        if self._dropped_ns >= wanted_ns:
            begin_ns = max(begin_ns, self._dropped_ns)
        self._ends_ns = self._armed_ns = fired_ns + self._after_ns
        unit = "" if self._bound.unit == "1" else f" {self._bound.unit}"
        short = (
            f"; {(fired_ns - begin_ns) * 1e-9:.3g} s before it are kept, {self.trigger.before:g} s do not fit into "
            f"{self.trigger.memory >> 20} MiB of memory"
            if self._dropped_ns >= wanted_ns
            else ""
        )
        said = f"{self.trigger.condition} held at t = {fired_ns * 1e-9:.6f} s with {value:.6g}{unit}{short}"
        about = {
            "condition": str(self.trigger.condition),
            "fired": repr(fired_ns * 1e-9),
            "value": repr(value),
            "unit": self._bound.unit,
            "before": repr(self.trigger.before),
            "after": repr(self.trigger.after),
            "begin": repr(begin_ns * 1e-9),
            "number": str(len(self.paths) + 1),
            "text": said,
        }
        self._writer = Writer(path, self.setup, "recorded", self._replace, about)
        self.paths.append(path)
        self._last = {}
        self._lost = Counter()
        self._dropped_ns = -1
        self._say(f"{said}: {path}")
        while self._waiting:
            self._put(self._waiting.popleft())
        self._size = 0

    def _put(self, message: _Waiting) -> None:
        assert self._writer is not None
        self._writer.write(*message)
        self.messages += 1
        last = self._last.get(message.topic)
        if last is not None and message.seq > last + 1:
            self._lost[message.topic] += message.seq - last - 1
        self._last[message.topic] = message.seq

    def _close(self, ended: str, summary: Mapping[str, Any]) -> None:
        if self._writer is None:
            return
        writer = self._writer
        self._writer = None
        account = {
            "path": str(writer.path),
            "run": self.setup.run,
            "ended": ended,
            "messages": writer.messages,
            "seconds": writer.last_ns * 1e-9,
            "gaps": dict(self._lost),
        }
        try:
            writer.close(account, summary)
        finally:
            writer.abandon()

    def flush_if_due(self) -> None:
        """Pass what is written to the system if it is time (`Writer.flush_if_due`)."""
        if self._writer is not None:
            self._writer.flush_if_due()

    def close(self, recording: Mapping[str, Any], summary: Mapping[str, Any]) -> None:
        """Finish the open recording, if there is one; the run has ended, or the recorder was asked to stop."""
        while self._beyond:
            self._end()
        self._close(str(recording["ended"]), summary)

    def abandon(self) -> None:
        """Close the open file as it is; flushed parts stay readable."""
        if self._writer is not None:
            self._writer.abandon()

    def text(self) -> str:
        """What was recorded, as the begin of a line."""
        condition = self.trigger.condition
        most = self.trigger.most
        if not self.paths:
            distance, value, t_ns = self._closest
            unit = "" if self._bound.unit == "1" else f" {self._bound.unit}"
            closest = f"; closest: {value:.6g}{unit} at t = {t_ns * 1e-9:.3f} s"
            if distance == -np.inf:
                closest = "; no sample of it arrived"
            return f"nothing recorded: {condition} never held{closest}"
        names = str(self.paths[0]) + (f" to {self.paths[-1].name}" if len(self.paths) > 1 else "")
        limit = " (--most: the trigger was off from then on)" if len(self.paths) >= most else ""
        count = f"{len(self.paths)} recordings" if len(self.paths) > 1 else "1 recording"
        return f"{names}: {count} of {condition}{limit}"
