"""The protobuf message types of the bus: those of `rig.proto`, and the type `State` of a scene.

`rig_pb2.py` and `viewing_pb2.py` are generated from `rig.proto` and `viewing.proto` by `make proto`. The length of a
message does not depend on its values, so `rig.bus.encode` packs it in a microsecond. Readers of a recording need
neither: each channel contains its schema, `file_descriptor_set(kind)`.

Decodes many messages of one type at once: columns of numbers instead of a protobuf object for each message.

Messages of the same length usually differ in their numbers only. Their tags and lengths are then compared once, as
bytes, and the numbers are read in place (the wire format is explained in `rig.bus.encode`). All other messages are
decoded by protobuf, so that both ways give the same bits.

Batches: messages of the plant that wait a few milliseconds and are sent together, for readers without deadline.

A separate put costs the plant 20 to 40 us, because it wakes a thread of the bus, and it wakes each reader (measured).
Adding a message to a batch costs 1 us: it is encoded when the batch is. Each message keeps its own number and time, so
that readers still detect lost messages. Batches also contain copies of steps and commands: the originals travel
directly between plant and controllers, and all other processes read the copies.
"""

from __future__ import annotations

import hashlib
import json
import re
import time
from collections.abc import Callable, Iterator, MutableSequence, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.descriptor_pb2 import FieldDescriptorProto
from google.protobuf.message import DecodeError, Message
from numpy.typing import NDArray

from rig.bus import rig_pb2, topics, viewing_pb2
from rig.bus.topics import HEADER
from rig.errors import BusError

TYPES: dict[str, type[Message]] = {
    name: message_factory.GetMessageClass(described)
    for file in (rig_pb2, viewing_pb2)
    for name, described in file.DESCRIPTOR.message_types_by_name.items()
}
"""Name -> message type, for all types of `rig.proto` and `viewing.proto`."""

_FRAMING = b"number and time before the payload"
FINGERPRINT = hashlib.sha256(
    _FRAMING + rig_pb2.DESCRIPTOR.serialized_pb + viewing_pb2.DESCRIPTOR.serialized_pb
).hexdigest()[:8]
"""Hash of both files and the framing. It is part of every message's encoding: other versions are detected by it."""

Columns = dict[str, NDArray[Any]]
"""Fields of several messages: name -> int64 or float64 [messages], and [messages, entries] of a repeated field."""
_NUMBERS = {FieldDescriptor.TYPE_SFIXED64: np.dtype("<i8"), FieldDescriptor.TYPE_DOUBLE: np.dtype("<f8")}
_FIXED = 1
_PACKED = 2

WAITS_NS = 25_000_000
"""Age [ns] of a batch at which it is sent. A plant flushes 50 times a second: sooner."""
EVERY = 16
"""Messages of a batch between two checks of its age."""
LONGEST = 1 << 15
"""Size [bytes] at which encoded messages are sent, and of the pieces of a batch: half of what Zenoh sends in one."""
_KEEPING = 7000  # bytes that Zenoh needs to keep a batch, in addition to its payload (measured)
WAITING = (160 << 20) // (LONGEST + _KEEPING)
"""Most batches that wait in the memory of a recorder: 160 MB."""

Row = tuple[str, str, bytes | tuple[int, int], Callable[..., bytes], tuple[Any, ...]]
"""User, topic, header (packed, or number and time), and the function that encodes the message, with its arguments."""


def field_name(name: str) -> str:
    """The protobuf field name for `name`: "drive.speed" becomes "drive_speed"."""
    return re.sub(r"\W", "_", name)


@cache
def _state_type(names: tuple[str, ...]) -> type[Message]:
    whole = ("t_ns", "tick", "mode")
    fields = [*whole, *map(field_name, names)]
    if twice := sorted({field for field in fields if fields.count(field) > 1}):
        raise BusError(
            f"the names {', '.join(names)} cannot all be fields of one message: {', '.join(twice)} occurs twice"
        )
    proto = descriptor_pb2.FileDescriptorProto(name="state.proto", package="rig", syntax="proto3")
    declared = proto.message_type.add(name="State")
    for number, field in enumerate(fields, start=1):
        kind = FieldDescriptorProto.TYPE_SFIXED64 if field in whole else FieldDescriptorProto.TYPE_DOUBLE
        declared.field.add(name=field, number=number, type=kind, label=FieldDescriptorProto.LABEL_OPTIONAL)
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(proto.SerializeToString())
    made: type[Message] = message_factory.GetMessageClass(pool.FindMessageTypeByName("rig.State"))
    return made


def state_type(outputs: Sequence[str]) -> type[Message]:
    """The type `State` of a scene: t_ns, tick, mode and one field for each output.

    `mode` is the number of the mode set; with one contact -1, 0, 1 are slip-, stick, slip+. Raises BusError for outputs
    that cannot be fields of one message.
    """
    return _state_type(tuple(outputs))


def encoding(topic: str) -> str:
    """The Zenoh encoding of the messages of a topic: message type and `FINGERPRINT`."""
    return f"application/protobuf;rig.{topics.of(topic).message}@{FINGERPRINT}"


def decode(topic: str, payload: bytes) -> Any:
    """Decode a message of any topic except `state`, whose type depends on the scene. Raises BusError."""
    kind = topics.of(topic).message
    try:
        return TYPES[kind].FromString(payload)
    except (KeyError, DecodeError) as fault:
        raise BusError(f"{len(payload)} bytes on {topic} are not a {kind}: {fault}") from None


def decoder(outputs: Sequence[str]) -> Callable[[str, bytes], Any]:
    """A function like `decode` that also decodes `state` of a scene with these outputs."""
    state = state_type(outputs)
    return lambda topic, payload: state.FromString(payload) if topic == "state" else decode(topic, payload)


def kind(topic: str, outputs: Sequence[str]) -> type[Message]:
    """The type of the messages of a topic, in a scene with these outputs."""
    return state_type(outputs) if topic == "state" else TYPES[topics.of(topic).message]


def times(block: Any) -> NDArray[np.int64]:
    """Times [ns] at which the samples of a Block were published: int64 [samples]."""
    if block.t_ns:
        return np.array(block.t_ns, dtype=np.int64)
    return np.asarray(block.t0_ns + block.dt_ns * np.arange(len(block.v), dtype=np.int64))


class Rows(NamedTuple):
    """Commands of one controller as columns, one entry for each command; `values` is concatenated."""

    tick: MutableSequence[int]
    answered: MutableSequence[int]
    status: MutableSequence[int]
    values: MutableSequence[float]


def commands(applied: Any) -> Rows:
    """The commands in an Applied. Raises BusError if its columns differ in length."""
    if not applied.ticks:
        return Rows([applied.tick], [applied.answered], [applied.status], applied.values)
    columns = (applied.ticks, applied.answers, applied.statuses)
    count = len(applied.ticks)
    if any(len(column) != count for column in columns) or len(applied.values) % count:
        raise BusError("an Applied whose columns differ in length")
    return Rows(*columns, applied.values)


def event(t_ns: int, tick: int, source: str, kind: str, text: str, data: dict[str, Any] | None = None) -> bytes:
    """Encode an Event; `source` is the process that publishes it on `event/<source>`."""
    packed = json.dumps(data or {})
    message = TYPES["Event"](t_ns=t_ns, tick=tick, source=source, kind=kind, text=text, data=packed)
    return bytes(message.SerializeToString())


def checkpoint(frame_ns: int, tick: int, state: bytes) -> bytes:
    """Encode a Checkpoint at the begin of a frame."""
    return bytes(TYPES["Checkpoint"](t_ns=tick * frame_ns, tick=tick, state=state).SerializeToString())


def file_descriptor_set(kind: type[Message]) -> bytes:
    """The serialised FileDescriptorSet of a type: the schema that a recording contains."""
    files = descriptor_pb2.FileDescriptorSet()
    kind.DESCRIPTOR.file.CopyToProto(files.file.add())
    return bytes(files.SerializeToString())


def alike(kind: type[Message], payloads: Sequence[bytes]) -> Columns | None:
    """Decode messages of the same length (at least one); None if their layouts differ or have no such columns."""
    places = _places(kind, payloads[0])
    if places is None:
        return None
    rows = np.frombuffer(b"".join(payloads), np.uint8).reshape(len(payloads), -1)
    frame = np.ones(rows.shape[1], np.bool_)
    for begin, end in places.values():
        frame[begin:end] = False
    if (rows[:, frame] != rows[0, frame]).any():
        return None
    columns = _blank(kind, len(rows))
    for name, (begin, end) in places.items():
        numbers = np.ascontiguousarray(rows[:, begin:end]).view(columns[name].dtype)
        columns[name] = numbers if columns[name].ndim == 2 else numbers[:, 0]
    return columns


def single(message: Message) -> Columns:
    """The columns of one message of numbers only."""
    columns = _blank(type(message), 1)
    for name, column in columns.items():
        columns[name] = np.array([getattr(message, name)], column.dtype)
    return columns


def _blank(kind: type[Message], count: int) -> Columns:
    """The columns of `count` messages without content. Fields that are no numbers are left out."""
    empty = kind()
    return {
        field.name: np.zeros(count if isinstance(getattr(empty, field.name), int | float) else (count, 0), number)
        for field in kind.DESCRIPTOR.fields
        if (number := _NUMBERS.get(field.type)) is not None
    }


def _places(kind: type[Message], payload: bytes) -> dict[str, tuple[int, int]] | None:
    """First and last byte of the numbers of each field in `payload`; None if there is anything but numbers."""
    blank = _blank(kind, 1)
    places = dict[str, tuple[int, int]]()
    at = 0
    while at < len(payload):
        tag, begin = _varint(payload, at)
        field = kind.DESCRIPTOR.fields_by_number.get(tag >> 3)
        if field is None or field.name in places or field.name not in blank:
            return None
        size = 8
        many = blank[field.name].ndim == 2
        if tag & 7 != (_PACKED if many else _FIXED):
            return None
        if many:
            size, begin = _varint(payload, begin)
        at = begin + size
        if size % 8 or at > len(payload):
            return None
        places[field.name] = begin, at
    return places


def _varint(payload: bytes, at: int) -> tuple[int, int]:
    """The number of variable length at byte `at`, and the byte after it; (0, at) if it is cut off."""
    value = shift = 0
    for end in range(at, min(at + 5, len(payload))):
        value |= (payload[end] & 0x7F) << shift
        shift += 7
        if payload[end] < 0x80:
            return value, end + 1
    return 0, at


class Batch:
    """Collects messages and gives them to `send`. Not thread-safe."""

    def __init__(self, send: Callable[[list[Row]], None]) -> None:
        self.gather: Callable[[], object] = lambda: None
        """Called before a batch is sent; it may add more messages."""
        self.rows: list[Row] = []
        """The collected messages. A plant appends to it, which costs it less than a call; then `flush_if_due`."""
        self._send = send
        self._size = 0
        self._due = 0

    def add(self, user: str, topic: str, header: bytes, payload: bytes) -> None:
        """Add an encoded message of `user` on `topic`; `header` contains its number and time, packed."""
        self._size += len(payload)
        self.rows.append((user, topic, header, bytes, (payload,)))
        if not len(self.rows) % EVERY:
            self.flush_if_due()
        if self._size >= LONGEST:
            self.flush()

    def flush_if_due(self) -> None:
        """Send the messages if they have waited long enough; to be called after every `EVERY` messages."""
        if time.monotonic_ns() >= self._due:
            self.flush()

    def flush(self) -> None:
        """Send the collected messages as one batch."""
        self._size = 0
        self._due = time.monotonic_ns() + WAITS_NS  # messages that `gather` adds must not flush again
        self.gather()
        if self.rows:
            rows = self.rows
            self.rows = []
            self._size = 0
            self._send(rows)


def encoded_batches(rows: list[Row]) -> Iterator[bytes]:
    """Encode messages as Batches of about `LONGEST` bytes."""
    places: dict[tuple[str, str], int] = {}
    columns: list[tuple[int, bytes, bytes]] = []
    size = 0
    for user, topic, header, encode, given in rows:
        content = encode(*given)
        packed = header if isinstance(header, bytes) else HEADER.pack(*header)
        columns.append((places.setdefault((user, topic), len(places)), packed, content))
        size += len(content)
        if size >= LONGEST:
            yield _encoded(places, columns)
            places = {}
            columns = []
            size = 0
    if columns:
        yield _encoded(places, columns)


def _encoded(places: dict[tuple[str, str], int], columns: list[tuple[int, bytes, bytes]]) -> bytes:
    users, names = zip(*places)
    place, headers, contents = zip(*columns)
    batch = TYPES["Batch"](user=users, topic=names, place=place, header=headers, said=contents)
    return bytes(batch.SerializeToString())
