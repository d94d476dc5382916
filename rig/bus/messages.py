"""The protobuf message types of the bus, built at run time from the table `DECLARED`.

Integers are sfixed64 and reals are double. Therefore the length of a message does not depend on its values, and
`rig.bus.encode` packs it in a microsecond. Times `t_ns` and `t0_ns` are nanoseconds of simulated time; `tick` counts
frames. Readers of a recording do not need this table: each channel contains its schema, `file_descriptor_set(kind)`.
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

from rig.bus import topics
from rig.errors import BusError

DECLARED = {
    "Step": "tick:int t_ns:int values:real* fresh:int* heard:int* samples:real*",
    "Act": "tick:int t_ns:int values:real*",
    "Applied": "tick:int t_ns:int answered:int status:int values:real* ticks:int* answers:int* statuses:int*",
    "Block": "tick:int t0_ns:int dt_ns:int v:real* t_ns:int*",
    "Checkpoint": "t_ns:int tick:int state:data",
    "Event": "t_ns:int tick:int source:text kind:text text:text data:text",
    "Health": "t_ns:int tick:int phase:text rate:real lateness_us:real worst_us:real late:int overruns:int drops:int "
    "held:int energy_error:real stick_share:real eta_s:real refused:int",
    "Batch": "user:text* topic:text* place:int* header:data* said:data*",
    "Totals": "process:text sent_topic:text* sent:int* heard_topic:text* received:int* lost:int*",
}
"""Message type -> its fields, `name:kind`, in order; `*` marks a repeated one."""

ABOUT = {
    "Step": "One frame. `values`: latest sample of every sensor in the order of the scene, NaN before the first. "
    "`fresh`: number of new samples in this frame. `samples`: all new samples of the sensors with the indices "
    "`heard`, for controllers that want all.",
    "Act": "Commands that answer the step of `tick`. `values` are in the order of the controller's drives.",
    "Applied": "Commands in force from `tick` on. `values`: as they took effect, an answer to the step of `answered`. "
    "`status`: 0 as sent, 1 clamped or completed, 2 safe values because no answer came. With several commands "
    "in one message, `ticks`, `answers` and `statuses` have one entry for each, `values` is concatenated, and "
    "`tick`, `answered` and `status` are those of the first.",
    "Block": "Samples. `v[i]` was published at `t0_ns` + i `dt_ns` or, if the spacing is not a whole number of ns, at "
    "`t_ns[i]`. `tick`: the frame in which the block was completed.",
    "Checkpoint": "State of plant and instruments, from which a run can be continued.",
    "Event": "What happened. `data` is a JSON object; its fields depend on the `kind` of event.",
    "Health": "How the run goes. `rate`: real-time factor since the last message. `lateness_us`, `worst_us`: 99th "
    "percentile and largest value of the lateness [us]. `energy_error`: residual of the energy balance. "
    "`eta_s`: remaining wall time [s], -1 for a run without an end. The integers count since the start of the "
    "run.",
    "Batch": "Several messages. Payload `said[i]`, number and time `header[i]`, is from `user[place[i]]` on "
    "`topic[place[i]]`.",
    "Totals": "Number of messages that one process sent, received and lost (gaps in the numbers), for each topic.",
}
"""Message type -> what it is and what its fields hold."""

_KINDS = {
    "int": FieldDescriptorProto.TYPE_SFIXED64,
    "real": FieldDescriptorProto.TYPE_DOUBLE,
    "text": FieldDescriptorProto.TYPE_STRING,
    "data": FieldDescriptorProto.TYPE_BYTES,
}

_FRAMING = "number and time before the payload"
FINGERPRINT = hashlib.sha256(repr((_FRAMING, sorted(DECLARED.items()))).encode()).hexdigest()[:8]
"""Hash of `DECLARED` and the framing. It is part of every message's encoding: other versions are detected by it."""


def _built(kinds: dict[str, str], file: str) -> dict[str, type[Message]]:
    proto = descriptor_pb2.FileDescriptorProto(name=file, package="rig", syntax="proto3")
    for kind, fields in kinds.items():
        declared = proto.message_type.add(name=kind)
        for number, field in enumerate(fields.split(), start=1):
            name, _, what = field.partition(":")
            many = what.endswith("*")
            label = FieldDescriptorProto.LABEL_REPEATED if many else FieldDescriptorProto.LABEL_OPTIONAL
            declared.field.add(name=name, number=number, type=_KINDS[what.rstrip("*")], label=label)
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(proto.SerializeToString())
    return {kind: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"rig.{kind}")) for kind in kinds}


TYPES: dict[str, type[Message]] = _built(DECLARED, "rig.proto")


def field_name(name: str) -> str:
    """The protobuf field name for `name`: "drive.speed" becomes "drive_speed"."""
    return re.sub(r"\W", "_", name)


@cache
def _sampled(kind: str, head: str, names: tuple[str, ...]) -> type[Message]:
    taken = [part.partition(":")[0] for part in head.split()]
    fields = [field_name(name) for name in names]
    twice = sorted({f for f in fields if (fields + taken).count(f) > 1})
    if twice:
        raise BusError(
            f"the names {', '.join(names)} cannot all be fields of one message: {', '.join(twice)} occurs twice"
        )
    return _built({kind: " ".join([head, *(f"{field}:real" for field in fields)])}, f"{kind.lower()}.proto")[kind]


def state_type(outputs: Sequence[str]) -> type[Message]:
    """The type `State` of a scene: t_ns, tick, mode and one field for each output.

    `mode` is the number of the mode set; with one contact -1, 0, 1 are slip-, stick, slip+.
    """
    return _sampled("State", "t_ns:int tick:int mode:int", tuple(outputs))


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
    found = descriptor_pb2.FileDescriptorSet()
    kind.DESCRIPTOR.file.CopyToProto(found.file.add())
    return bytes(found.SerializeToString())
