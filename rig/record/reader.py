"""Reads recordings, whole or cut off: everything up to the break counts.

The file is read from front to back, never through its index: a truncated file has none.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.exceptions import InvalidMagic
from mcap.records import Attachment, Channel, Chunk, DataEnd, Message, Metadata, Schema, Statistics
from mcap.stream_reader import StreamReader, breakup_chunk

from rig.bus import messages
from rig.bus.setup import Setup
from rig.errors import LogError
from rig.record.run import Commands, Integers, Reals, Run, Samples


class Record(NamedTuple):
    """One message of a recording."""

    topic: str
    payload: bytes
    t_ns: int
    seq: int
    log_ns: int


class Scan:
    """Walks through a recording each time that it is iterated over.

    `attachments`, `metadata`, `schemas` and `channels` grow on the way. `whole` tells afterwards whether the end was
    reached, `fault` why not.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.attachments: dict[str, Attachment] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.whole = False
        self.fault = ""
        self.last_ns = 0
        self.count = 0

    def __iter__(self) -> Iterator[Record]:
        for message in self.messages():
            topic = self.channels[message.channel_id].topic
            yield Record(topic, message.data, message.publish_time, message.sequence, message.log_time)

    def messages(self) -> Iterator[Message]:
        """The messages as they stand in the file."""
        try:
            source = self.path.open("rb")
        except OSError as fault:
            raise LogError(f"{self.path} cannot be read: {fault.strerror}") from None
        self.whole, self.fault, self.count = False, "", 0
        with source:
            chunks = iter(StreamReader(source, emit_chunks=True).records)
            while True:
                try:
                    record = next(chunks)
                    inside = breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else [record]
                except StopIteration:
                    return
                except Exception as fault:  # whatever a broken byte makes the parser raise: here the recording ends
                    self._break(fault)
                    return
                for one in inside:
                    if isinstance(one, Message):
                        if one.channel_id not in self.channels:  # described in a chunk that is damaged
                            continue
                        self.last_ns = max(self.last_ns, one.publish_time)
                        self.count += 1
                        yield one
                    else:
                        self._note(one)

    def _note(self, record: Any) -> None:
        if isinstance(record, Attachment):
            self.attachments[record.name] = record
        elif isinstance(record, Metadata):
            self.metadata[record.name] = dict(record.metadata)
        elif isinstance(record, Channel):
            self.channels[record.id] = record
        elif isinstance(record, Schema):
            self.schemas[record.id] = record
        elif isinstance(record, DataEnd):
            self.whole = True
        elif isinstance(record, Statistics) and record.message_count != self.count:
            self.whole = False
            self.fault = f"{record.message_count - self.count} of its {record.message_count} messages are missing"

    def _break(self, fault: Exception) -> None:
        if self.fault:
            return
        if self.whole:  # all data are there; only the index behind them is damaged
            self.whole = False
            self.fault = "the index at its end is damaged"
        elif isinstance(fault, InvalidMagic) or not (self.attachments or self.metadata):
            raise LogError(f"{self.path} is not a recording of a run") from None
        else:
            self.fault = f"it breaks off after t = {self.last_ns * 1e-9:.3f} s"

    def setup(self) -> Setup:
        """What the recording says of its stand; known as soon as the first message has been met."""
        try:
            found = json.loads(self.attachments["setup.json"].data)
            return Setup.from_json({**found, "scene": self.attachments["scene.json"].data.decode()})
        except (KeyError, TypeError, ValueError) as fault:
            raise LogError(f"{self.path} does not describe its run: {fault!r} is missing or unreadable") from None


def head(path: Path) -> Scan:
    """A scan of what stands before the first message: setup and provenance."""
    scan = Scan(path)
    for _ in scan:
        break
    return scan


def open(path: Path | str) -> Run:
    """The run of a recording; `Run.fault` is set when the file is cut off."""
    scan = Scan(Path(path))
    gathered: dict[str, list[bytes]] = defaultdict(list)
    for record in scan:
        if not record.topic.startswith(("step", "act/", "plot", "health", "total/")):
            gathered[record.topic].append(record.payload)
    setup = scan.setup()
    time_ns, signals, mode = _truth(gathered, setup)
    events = sorted(
        (e for topic in gathered if topic.startswith("event/") for e in _events(gathered[topic])), key=_when
    )
    summary = {key: json.loads(text) for key, text in scan.metadata.get("summary", {}).items()}
    if not summary:  # the recorder was killed, or the run had none: the plant's last word may still be there
        summary = next((dict(event["data"]) for event in reversed(events) if event["kind"] == "verdict"), {})
    stopped = summary.pop("fault", "")
    return Run(
        scene=setup.scene,
        step_ns=setup.step_ns,
        frame_ns=setup.frame_ns,
        time=np.multiply(time_ns, 1e-9, dtype=np.float64),
        signals=signals,
        units={**setup.outputs, **{f"meas/{name}": unit for name, (unit, _) in setup.sensors.items()}},
        measurements={name: _samples(gathered.get(f"meas/{name}", [])) for name in setup.sensors},
        commands={topic[8:]: _commands(gathered[topic]) for topic in gathered if topic.startswith("applied/")},
        events=events,
        energy=summary.pop("energy", {}),
        summary=summary,
        mode=mode,
        provenance=setup.provenance,
        fault=stopped or scan.fault,
    )


def _when(event: dict[str, Any]) -> int:
    return int(event["t_ns"])


def _samples(blocks: list[bytes]) -> Samples:
    read = messages.TYPES["Block"].FromString
    times, values = [np.empty(0, np.int64)], [np.empty(0)]
    for payload in blocks:
        block: Any = read(payload)
        v = np.array(block.v, dtype=np.float64)
        values.append(v)
        times.append(block.t0_ns + block.dt_ns * np.arange(v.size, dtype=np.int64))
    return Samples(np.concatenate(times), np.concatenate(values))


def _truth(gathered: dict[str, list[bytes]], setup: Setup) -> tuple[Integers, dict[str, Reals], Integers]:
    """Plant outputs at the rate of the steps where they were recorded so, else as often as State was sent."""
    found = {topic[6:]: _samples(blocks) for topic, blocks in gathered.items() if topic.startswith("truth/")}
    if found:
        time_ns = np.unique(np.concatenate([samples.t_ns for samples in found.values()]))
        signals = {name: np.full(time_ns.size, np.nan) for name in found}  # NaN where a block was lost
        for name, (t_ns, v) in found.items():
            signals[name][np.searchsorted(time_ns, t_ns)] = v
        mode = signals.pop("mode", np.empty(0))
        return time_ns, signals, np.nan_to_num(mode).astype(np.int64)
    kind = messages.state_type(list(setup.outputs))
    states: list[Any] = [kind.FromString(payload) for payload in gathered.get("state", [])]
    fields = [messages.field_name(name) for name in setup.outputs]
    table = np.array([[getattr(state, f) for f in fields] for state in states], float).reshape(len(states), len(fields))
    time_ns = np.array([state.t_ns for state in states], np.int64)
    mode = np.array([state.mode for state in states], np.int64)
    return time_ns, {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(setup.outputs)}, mode


def _commands(payloads: list[bytes]) -> Commands:
    read = messages.TYPES["Applied"].FromString
    found: list[Any] = [read(payload) for payload in payloads]
    tick, answered, status = (
        np.array([getattr(a, n) for a in found], np.int64) for n in ("tick", "answered", "status")
    )
    return Commands(tick, answered, status, np.array([list(a.values) for a in found], float))


def _events(payloads: list[bytes]) -> Iterator[dict[str, Any]]:
    for payload in payloads:
        event: Any = messages.TYPES["Event"].FromString(payload)
        told = {name: getattr(event, name) for name in ("t_ns", "tick", "source", "kind", "text")}
        yield {**told, "data": json.loads(event.data) if event.data else {}}
