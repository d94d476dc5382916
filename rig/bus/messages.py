"""The protobuf message types of the bus: those of `rig.proto`, and the type `State` of a scene.

`rig_pb2.py` and `viewing_pb2.py` are generated from `rig.proto` and `viewing.proto` by `make proto`. The length of a
message does not depend on its values, so `rig.bus.encode` packs it in a microsecond. Readers of a recording need
neither: each channel contains its schema, `file_descriptor_set(kind)`.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, MutableSequence, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import FieldDescriptorProto
from google.protobuf.message import DecodeError, Message
from numpy.typing import NDArray

from rig.bus import rig_pb2, topics, viewing_pb2
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
