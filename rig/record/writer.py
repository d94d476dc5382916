"""A writer of one run to an MCAP file that stays readable if the writer is killed.

Scene and provenance are written at the front and again at the end, so that no single damage destroys both. Chunks are
closed every 250 ms, which is the most that can be lost. Messages are stored as received. `log_time` is the time of
reception, `publish_time` is simulated time.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace as changed
from pathlib import Path
from typing import Any, BinaryIO

from google.protobuf.message import DecodeError
from mcap.well_known import MessageEncoding, SchemaEncoding

from rig import file_locks
from rig.bus import messages, topics
from rig.bus.run_setup import Setup
from rig.errors import BusError, LogError
from rig.record import model_attachments
from rig.record.mcap_file import FORMAT
from rig.record.mcap_file import Writer as Mcap
from rig.user_files import WRITTEN, takes

CHUNK = 256 * 1024
_OWN = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)  # not inherited by children, no newline translation
FLUSH_NS = 250_000_000
PLOT_NS = 20_000_000


def claim(path: Path, replace: bool) -> BinaryIO:
    """Open a file for writing, empty and exclusively for this process; an existing file with content only with
    `replace`.

    Raises OSError if that fails, with the reason in `strerror`.
    """
    takes(path)
    file = os.open(path, os.O_WRONLY | os.O_CREAT | _OWN, 0o666)
    try:
        if not file_locks.free(file):
            raise OSError(errno.EBUSY, WRITTEN)
        if os.fstat(file).st_size:
            if not replace:
                raise OSError(errno.EEXIST, "it exists; name another file, or add --force to replace it")
            os.ftruncate(file, 0)
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
    """An open recording. `made` states its origin: "recorded" from the bus, or "saved" from a Run.

    An existing file is overwritten only with `replace`. Raises LogError if the file cannot be written.
    """

    def __init__(self, path: Path, setup: Setup, made: str, replace: bool = True) -> None:
        self.path, self.setup, self._made = path, setup, made
        self.messages = 0
        self.last_ns = 0
        """Simulated time of the latest message."""
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._state = messages.state_type(list(setup.outputs))
        self.plot_names = [*setup.outputs, *(f"measured_{name}" for name in setup.sensors)]
        self._plot = messages.plot_type(self.plot_names)
        self._step: bytes | None = None
        self._plot_due = self._points = 0
        self._log_ns = 0
        self._flush_due = time.monotonic_ns() + FLUSH_NS
        with self._guarded():
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = claim(path, replace)
        self._mcap = Mcap(self._file, CHUNK)
        try:
            with self._guarded():
                self._describe()
                self._file.flush()
        except LogError:
            self.abandon()
            raise

    def _describe(self) -> None:
        setup, now = self.setup, time.time_ns()
        for name, text in (("scene.json", setup.scene), ("setup.json", changed(setup, scene="", models=()).to_text())):
            self._mcap.attach(name, "application/json", text.encode(), now)
        for model in setup.models:
            self._mcap.attach(
                model_attachments.name(model), model_attachments.MEDIA_TYPE, model_attachments.packed(model), now
            )
        self._mcap.note("provenance", setup.provenance)
        self._mcap.note("log", {"made": self._made, "run": setup.run, "format": str(FORMAT)})

    @contextlib.contextmanager
    def _guarded(self) -> Iterator[None]:
        try:
            yield
        except OSError as fault:
            kept_ns = self._kept_ns()
            kept = f"; recorded up to t = {kept_ns * 1e-9:.3f} s: rig recover saves this part" if kept_ns else ""
            raise LogError(f"{self.path} cannot be written: {fault.strerror}{kept}") from None

    def _kept_ns(self) -> int:
        """Simulated time of the latest message in the file: waiting messages and those of a cut chunk are lost."""
        if not self.messages:
            return 0
        try:
            return self._mcap.reached(os.fstat(self._file.fileno()).st_size)
        except (OSError, ValueError):  # already closed: closing reported the fault
            return 0

    def _channel(self, topic: str) -> int:
        kind, units = self._kind(topic)
        schema = kind.DESCRIPTOR.name
        if schema not in self._schemas:
            described = messages.file_descriptor_set(kind)
            self._schemas[schema] = self._mcap.schema(f"rig.{schema}", SchemaEncoding.Protobuf, described)
        return self._mcap.channel(topic, MessageEncoding.Protobuf, self._schemas[schema], units)

    def _kind(self, topic: str) -> tuple[Any, dict[str, str]]:
        setup = self.setup
        first, _, name = topic.partition("/")
        if first == "plot":
            units = [*setup.outputs.values(), *(unit for unit, _ in setup.sensors.values())]
            return self._plot, {messages.field_name(n): unit for n, unit in zip(self.plot_names, units)}
        if first == "state":
            return self._state, {messages.field_name(n): unit for n, unit in setup.outputs.items()}
        unit = setup.outputs.get(name, "") if first == "truth" else setup.sensors.get(name, ("", 0))[0]
        return messages.TYPES[topics.of(topic).message], {"v": unit} if unit else {}

    def write(self, topic: str, payload: bytes, t_ns: int, seq: int, log_ns: int) -> None:
        """Add a message unchanged; `seq`: its number on the topic, `log_ns`: time of reception."""
        with self._guarded():
            self._add(topic, payload, t_ns, seq, log_ns)
            if topic == "step":
                self._step = payload
            elif topic == "state" and t_ns >= self._plot_due:
                self._plot_due = t_ns + PLOT_NS
                self._derive(payload, t_ns, log_ns)

    def _add(self, topic: str, payload: bytes, t_ns: int, seq: int, log_ns: int) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channels[topic] = self._channel(topic)
        self._log_ns = max(self._log_ns, log_ns)  # readers need it monotone, but clocks are sometimes set back
        self._mcap.add(channel, self._log_ns, payload, t_ns, seq & 0xFFFFFFFF)
        self.messages += 1
        self.last_ns = max(self.last_ns, t_ns)

    def _derive(self, state: bytes, t_ns: int, log_ns: int) -> None:
        """Add one point of the channel for plotting programs, which cannot use the blocks at full rate."""
        try:
            found = self._state.FromString(state)
            measured = list(messages.decode("step", self._step).values) if self._step is not None else []
        except (DecodeError, BusError):  # not a valid message of the plant: recorded as received, nothing derived
            return
        values = [getattr(found, messages.field_name(name)) for name in self.setup.outputs]
        self._add("plot", self.point(t_ns, values + measured), t_ns, self._points, log_ns)
        self._points += 1

    def point(self, t_ns: int, values: list[float]) -> bytes:
        """Return a message of the derived `plot` channel: outputs, then the latest measurements."""
        fields = {messages.field_name(name): value for name, value in zip(self.plot_names, values)}
        return bytes(self._plot(t_ns=t_ns, **fields).SerializeToString())

    def flush_if_due(self) -> None:
        """Close the chunk and pass it to the system if 250 ms have passed since the last time."""
        if (now := time.monotonic_ns()) >= self._flush_due:
            self._flush_due = now + FLUSH_NS
            with self._guarded():
                self._mcap.flush()

    def close(self, recording: Mapping[str, Any], summary: Mapping[str, Any]) -> None:
        """Finish the file with an account of the recording and the summary of the run, and sync it to the disk."""
        with self._guarded():
            self._describe()
            for name, found in (("recording", recording), ("summary", summary)):
                self._mcap.note(name, {key: json.dumps(value) for key, value in found.items()})
            self._mcap.finish()
            synced(self._file)
            self._file.close()

    def abandon(self) -> None:
        """Close the file, finished or not; flushed parts stay readable."""
        self._mcap.discard()
        with contextlib.suppress(OSError):
            self._file.close()
