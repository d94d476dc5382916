"""A writer of one run to an MCAP file that stays readable if the writer is killed.

Scene and provenance are written at the front, and copies under other names at the end, so that no single damage
destroys both. The payloads of messages are stored as received. `log_time` is simulated time since the begin of the run,
`publish_time` is the wall clock when the message was received. Curves and log for other programs are derived
(rig.record.curves).

The messages in the file are in order of simulated time, although they arrive in another one: an event overtakes the
samples before it, and a point of a curve is known when its window ends. They wait until `FLUSH_NS` later nothing that
belongs before them can arrive. A writer that is killed loses the messages of two such times, and one window of a curve.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import stat
import time
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace as changed
from itertools import chain
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from google.protobuf.message import DecodeError
from mcap.well_known import MessageEncoding, SchemaEncoding

from rig.bus import messages, run_setup, topics
from rig.errors import BusError, OutputError
from rig.machine import files
from rig.record import curves, mcap_writer, recorded_setup
from rig.record.mcap_file import COPY, FORMAT

CHUNK = 256 * 1024  # bytes
_Waiting = tuple[int, str, bytes, int, int]
"""A message that is not in the file yet: simulated time, topic, payload, number, wall clock."""
_OWN = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)  # not inherited by children, no newline translation
FLUSH_NS = 125_000_000
"""Wall time between two flushes; longer than a message is under way on the bus."""


def opened_new(path: Path, replace: bool) -> BinaryIO:
    """Open a file for appending, exclusively for this process; an existing file with content only with `replace`.

    It keeps its content for now. Raises OSError if that fails, with the reason in `strerror`.
    """
    files.takes(path)
    file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | _OWN, 0o666)  # what is cut leaves no hole
    try:
        if not files.free(file):
            raise OSError(errno.EBUSY, files.WRITTEN)
        if os.fstat(file).st_size and not replace:
            raise OSError(errno.EEXIST, "it exists; name another file, or add --force to replace it")
    except OSError:
        os.close(file)
        raise
    return os.fdopen(file, "wb")


def synced(file: BinaryIO) -> None:
    """Make the system write a file to the disk: some systems report a full disk only then."""
    file.flush()
    try:
        os.fsync(file.fileno())
    except OSError as fault:
        if fault.errno not in (errno.EINVAL, errno.ENOTSUP):  # not a file on a disk, such as /dev/null
            raise


class Writer:
    """An open recording. `made` states its origin: "recorded" from the bus, "saved" from a Run, or
    "measured".

    `trigger`: for a window of a run, why it was recorded and where it begins (rig.record.windows).
    An existing file is overwritten only with `replace`, and by the first message: a run that ends before it leaves
    everything as it was. Raises OutputError if the file cannot be written.
    """

    _mcap: mcap_writer.Writer
    """The file as MCAP, from the first message on."""

    def __init__(
        self,
        path: Path,
        setup: run_setup.Setup,
        made: str,
        replace: bool = True,
        trigger: Mapping[str, str] | None = None,
    ) -> None:
        self.path = path
        self.setup = setup
        self._made = made
        self._trigger = trigger
        self.messages = 0
        self.last_ns = 0
        """Simulated time of the plant's latest message: others may state any time."""
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._state = messages.state_type(list(setup.outputs))
        self._curves = curves.Curves(setup.outputs, {name: unit for name, (unit, _) in setup.sensors.items()})
        self._states: list[tuple[int, bytes]] = []
        """Simulated times and payloads of the states that are in no curve yet."""
        self._fields = attrgetter("tick", "mode", *map(messages.field_name, setup.outputs))
        self._derived: dict[str, int] = {}
        """Number of messages of each derived topic."""
        self._waiting: list[_Waiting] = []
        self._older = 0
        """Number of the waiting messages that waited at the last flush."""
        self._settled_ns = round(float(trigger["begin"]) * 1e9) if trigger is not None else 0
        """Simulated time before which every message is in the file."""
        self._reached_ns = 0
        """Simulated time that the plant had reached at the last flush."""
        self._lag_ns = max(topics.BLOCK_NS, setup.frame_ns)
        """Longest simulated time from a sample to the message that contains it."""
        self.began_ns: int | None = None
        """The wall clock at simulated time 0, by the first message of the plant [ns since 1970, UTC]."""
        self._wall_ns = 0
        """The wall clock at the latest message."""
        self._flush_due = time.monotonic_ns() + FLUSH_NS
        with self._guarded():
            path.parent.mkdir(parents=True, exist_ok=True)
            self._new = not path.exists()
            self._begun = False
            self._file = opened_new(path, replace)

    def _begin(self) -> None:
        """Empty the file, and write what stands before the messages."""
        with self._guarded():
            if os.fstat(self._file.fileno()).st_size:
                self._file.truncate(0)
            self._mcap = mcap_writer.Writer(self._file, CHUNK, self.path.parent)
            self._begun = True
            self._describe()
            self._file.flush()

    def _describe(self, copy: str = "") -> None:
        setup = self.setup
        now = time.time_ns()
        for name, text in (("scene.json", setup.scene), ("setup.json", changed(setup, scene="", models=()).to_text())):
            self._mcap.attach(copy + name, "application/json", text.encode(), now)
        for model in setup.models:
            name = recorded_setup.name(model)
            packed = recorded_setup.packed(model)
            self._mcap.attach(copy + name, recorded_setup.MEDIA_TYPE, packed, now)
        self._mcap.note(copy + "provenance", setup.provenance)
        self._mcap.note(copy + "log", {"made": self._made, "run": setup.run, "format": str(FORMAT)})
        if self._trigger is not None:
            self._mcap.note(copy + "trigger", self._trigger)

    @contextlib.contextmanager
    def _guarded(self) -> Iterator[None]:
        try:
            yield
        except OSError as fault:
            kept_ns = self._kept_ns()
            kept = f"; recorded up to t = {kept_ns * 1e-9:.3f} s: rig recover saves this part" if kept_ns else ""
            raise OutputError(f"{self.path} cannot be written: {fault.strerror}{kept}") from None

    def _check(self) -> None:
        """Raise OutputError if the file, all of which is written, is not the one at its path, or was cut."""
        opened = os.fstat(self._file.fileno())
        try:
            same = os.path.samestat(opened, self.path.stat())
        except OSError:
            same = False
        if not same or (stat.S_ISREG(opened.st_mode) and opened.st_size != self._mcap.size):
            what = "cut" if same else "removed or replaced"
            raise OutputError(f"{self.path} was {what} while it was written: the recording is lost")

    def _kept_ns(self) -> int:
        """Simulated time of the latest message in the file: waiting messages and those of a cut chunk are lost."""
        if not self.messages:
            return 0
        try:
            return self._mcap.reached(os.fstat(self._file.fileno()).st_size)
        except (OSError, ValueError):  # already closed: closing reported the fault
            return 0

    def _channel(self, topic: str) -> int:
        if curves.derived(topic):
            name, encoding, described, message = curves.schema(topic)
            units = {"unit": unit} if (unit := self._curves.units.get(topic, "")) else {}
        else:
            kind, units = self._kind(topic)
            name = f"rig.{kind.DESCRIPTOR.name}"
            encoding = SchemaEncoding.Protobuf
            message = MessageEncoding.Protobuf
            described = messages.file_descriptor_set(kind)
        if name not in self._schemas:
            self._schemas[name] = self._mcap.schema(name, encoding, described)
        return self._mcap.channel(topic, message, self._schemas[name], units)

    def _kind(self, topic: str) -> tuple[Any, dict[str, str]]:
        setup = self.setup
        first, _, name = topic.partition("/")
        if first == "state":
            return self._state, {messages.field_name(n): unit for n, unit in setup.outputs.items()}
        unit = setup.outputs.get(name, "") if first == "truth" else setup.sensors.get(name, ("", 0))[0]
        return messages.TYPES[topics.of(topic).message], {"v": unit} if unit else {}

    def write(self, topic: str, payload: bytes, t_ns: int, seq: int, wall_ns: int) -> None:
        """Add a message; `t_ns`: simulated time that it states, `seq`: its number on the topic, `wall_ns`: the wall
        clock when it was received. Times of other senders that cannot be are replaced by those of the plant.
        """
        if not self._begun:
            self._begin()
        self._wall_ns = wall_ns
        if topics.of_plant(topic):
            self.last_ns = max(self.last_ns, t_ns)
            if self.began_ns is None:
                self.began_ns = wall_ns - t_ns
        else:
            t_ns = max(t_ns, self._settled_ns)
        self._wait(topic, payload, t_ns, seq, wall_ns)
        try:
            if topic.startswith("event/"):
                self._log(topic[6:], payload, t_ns)
            else:
                self._draw(self._points(topic, payload, t_ns))
        except (DecodeError, BusError, ValueError):  # no valid message: recorded as received, nothing derived
            pass

    def _wait(self, topic: str, payload: bytes, t_ns: int, seq: int, wall_ns: int) -> None:
        if topic not in self._channels:
            self._channels[topic] = self._channel(topic)
        self._waiting.append((t_ns, topic, payload, seq & 0xFFFFFFFF, wall_ns))
        self.messages += 1

    def settle(self, until_ns: int) -> None:
        """Write the waiting messages from before the simulated time `until_ns`, rounded to whole windows of curves."""
        self._settled_ns = max(self._settled_ns, until_ns // curves.WINDOW_NS * curves.WINDOW_NS)
        self._draw(self._curves.complete(self._settled_ns))
        with self._guarded():
            self._put(self._settled_ns, self._older)
        self._older = len(self._waiting)

    def _put(self, until_ns: int | None, certain: int) -> None:
        """Write the messages from before `until_ns`; None: all. The first `certain` are from no later than the plant:
        they have waited long enough for the plant's message of their time.
        """
        waiting = self._waiting
        last_ns = self.last_ns
        for i in [i for i, message in enumerate(waiting[:certain]) if message[0] > last_ns]:
            waiting[i] = (last_ns, *waiting[i][1:])
        waiting.sort(key=itemgetter(0))
        count = len(waiting) if until_ns is None else bisect_left(waiting, until_ns, key=itemgetter(0))
        self._waiting = waiting[count:]
        for t_ns, topic, payload, seq, wall_ns in waiting[:count]:
            if t_ns > self._mcap.reached_ns and topics.of_plant(topic):
                self._mcap.reached_ns = t_ns
            self._mcap.add(self._channels[topic], t_ns, payload, wall_ns, seq)

    def _points(self, topic: str, payload: bytes, t_ns: int) -> Iterator[curves.Point]:
        """Points of curves that a message completes. A run on the bus sends outputs as states, a saved one as truth."""
        if topic == "state" and self._made == "recorded":
            if self._states and t_ns // curves.WINDOW_NS != self._states[0][0] // curves.WINDOW_NS:
                yield from self._outputs()
            self._states.append((t_ns, payload))
        elif topic.startswith("meas/") or (topic.startswith("truth/") and self._made == "saved"):
            block = messages.decode(topic, payload)
            yield from self._curves.add(topic, messages.times(block), np.array(block.v, np.float64))

    def _outputs(self) -> Iterator[curves.Point]:
        """Points of the states that wait: a window at a time costs a tenth of one state at a time."""
        waiting = self._states
        self._states = []
        rows = list[tuple[float, ...]]()
        read = self._state.FromString
        for t_ns, payload in waiting:
            with contextlib.suppress(DecodeError):  # no valid message: recorded as received, in no curve
                rows.append((t_ns, *self._fields(read(payload))))
        times, _, _, *values = zip(*rows) if rows else [(), (), ()]
        for name, v in zip(self.setup.outputs, values):
            yield from self._curves.add(f"truth/{name}", np.array(times, np.int64), np.array(v, np.float64))

    def _draw(self, points: Iterable[curves.Point]) -> None:
        for t_ns, topic, payload in points:
            self._derive(topic, payload, t_ns)

    def _log(self, source: str, payload: bytes, t_ns: int) -> None:
        content = curves.log(messages.decode(f"event/{source}", payload), source, t_ns)
        if content is not None:
            self._derive(f"log/{source}", content, t_ns)

    def _derive(self, topic: str, payload: bytes, t_ns: int) -> None:
        number = self._derived[topic] = self._derived.get(topic, -1) + 1
        began_ns = self.began_ns if self._made == "saved" else None
        self._wait(topic, payload, t_ns, number, self._wall_ns if began_ns is None else began_ns + t_ns)

    def flush_if_due(self) -> None:
        """Write what has waited, close the chunk and pass it to the system if `FLUSH_NS` have passed since the last
        time.
        """
        if self._begun and (now := time.monotonic_ns()) >= self._flush_due:
            self._flush_due = now + FLUSH_NS
            self.settle(self._reached_ns - self._lag_ns)
            self._reached_ns = self.last_ns
            with self._guarded():
                self._mcap.flush()
                self._check()

    def close(self, recording: Mapping[str, Any], summary: Mapping[str, Any]) -> None:
        """Finish the file with an account of the recording and the summary of the run, and sync it to the disk."""
        if not self._begun:
            self._begin()
        self._draw(chain(self._outputs(), self._curves.complete()))
        with self._guarded():
            self._put(None, len(self._waiting))
            self._describe(COPY)
            for name, content in (("recording", {**recording, "began": self.began_ns}), ("summary", summary)):
                self._mcap.note(name, {key: json.dumps(value) for key, value in content.items()})
            self._mcap.finish()
            synced(self._file)
            self._check()
            self._file.close()

    def abandon(self) -> None:
        """Close the file, finished or not; flushed parts stay readable. A new file without content is removed."""
        if self._begun:
            self._mcap.discard()
        with contextlib.suppress(OSError):
            self._file.close()
            if self._new and not self._begun:
                self.path.unlink(missing_ok=True)
