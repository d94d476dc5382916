"""The protobuf types of the bus, built at run time from one declaration.

Integers are sfixed64 and numbers double, so that a message has the same length whatever it says and can be packed by
hand in a microsecond (`rig.bus.encode`). Times `t_ns` and `t0_ns` are nanoseconds of simulated time; `tick` counts
frames. Readers need no declaration of ours: a recording carries `file_descriptor_set(kind)` with every channel.
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
    # values: latest sample of every sensor in the scene's order, NaN before the first; fresh: samples new in this
    # frame; samples: all of these of the sensors at the places `heard`, for controllers that want every one
    "Step": "tick:int t_ns:int values:real* fresh:int* heard:int* samples:real*",
    # answers the step of `tick`; values in the order of the controller's drives
    "Act": "tick:int t_ns:int values:real*",
    # in force from `tick` on: values as they took effect, an answer to the step of `answered`; status: 0 as sent,
    # 1 clamped or completed, 2 safe values because no answer came. Several commands in one message: one entry for each
    # in ticks, answers and statuses, its values one after the other in values; what stands before is of the first
    "Applied": "tick:int t_ns:int answered:int status:int values:real* ticks:int* answers:int* statuses:int*",
    # v[i] was published at t0_ns + i dt_ns, or, where the spacing is no whole number of ns, at t_ns[i] (see `times`);
    # tick: the frame in which the block was completed
    "Block": "tick:int t0_ns:int dt_ns:int v:real* t_ns:int*",
    # data: JSON object that belongs to the kind of event
    "Event": "t_ns:int tick:int source:text kind:text text:text data:text",
    "Health": "t_ns:int tick:int phase:text rate:real lateness_us:real worst_us:real late:int overruns:int drops:int "
    "held:int energy_error:real stick_share:real eta_s:real refused:int",
    # several messages: said[i], with its number and time in header[i], is of user[place[i]] on topic[place[i]]
    "Batch": "user:text* topic:text* place:int* header:data* said:data*",
    # what one process sent, and what it received and lost (gaps seen in the sequence numbers), topic by topic
    "Totals": "process:text sent_topic:text* sent:int* heard_topic:text* received:int* lost:int*",
}

_KINDS = {
    "int": FieldDescriptorProto.TYPE_SFIXED64,
    "real": FieldDescriptorProto.TYPE_DOUBLE,
    "text": FieldDescriptorProto.TYPE_STRING,
    "data": FieldDescriptorProto.TYPE_BYTES,
}

_FRAMING = "number and time before the payload"
FINGERPRINT = hashlib.sha256(repr((_FRAMING, sorted(DECLARED.items()))).encode()).hexdigest()[:8]
"""Changes with any edit of the declaration; goes with every message, so that strangers are told apart."""


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
    """`name` as a protobuf field: "drive.speed" becomes "drive_speed"."""
    return re.sub(r"\W", "_", name)


@cache
def _sampled(kind: str, head: str, names: tuple[str, ...]) -> type[Message]:
    taken = [part.partition(":")[0] for part in head.split()]
    fields = [field_name(name) for name in names]
    twice = sorted({f for f in fields if (fields + taken).count(f) > 1})
    if twice:
        raise BusError(f"the names {', '.join(names)} cannot all be fields of one message: {', '.join(twice)} is taken")
    return _built({kind: " ".join([head, *(f"{field}:real" for field in fields)])}, f"{kind.lower()}.proto")[kind]


def state_type(outputs: Sequence[str]) -> type[Message]:
    """`State` of a scene: t_ns, tick, mode (a number per contact mode: -1, 0, 1 = slip, stick, slip), its outputs."""
    return _sampled("State", "t_ns:int tick:int mode:int", tuple(outputs))


def plot_type(names: Sequence[str]) -> type[Message]:
    """`Plot`: t_ns and one named field for each output and sensor, thinned out; what a plotting program shows first."""
    return _sampled("Plot", "t_ns:int", tuple(names))


def encoding(topic: str) -> str:
    """Name under which messages of a topic travel: type and fingerprint of the declaration."""
    return f"application/protobuf;rig.{topics.of(topic).message}@{FINGERPRINT}"


def decode(topic: str, payload: bytes) -> Any:
    """The message of a topic (any but `state`, whose type belongs to the scene); raises BusError if it is none."""
    kind = topics.of(topic).message
    try:
        return TYPES[kind].FromString(payload)
    except (KeyError, DecodeError) as fault:
        raise BusError(f"{len(payload)} bytes on {topic} are not a {kind}: {fault}") from None


def decoder(outputs: Sequence[str]) -> Callable[[str, bytes], Any]:
    """`decode` for all topics of a scene with these outputs, `state` among them."""
    state = state_type(outputs)
    return lambda topic, payload: state.FromString(payload) if topic == "state" else decode(topic, payload)


def times(block: Any) -> NDArray[np.int64]:
    """When the samples of a Block were published [ns]."""
    if block.t_ns:
        return np.array(block.t_ns, dtype=np.int64)
    return np.asarray(block.t0_ns + block.dt_ns * np.arange(len(block.v), dtype=np.int64))


class Rows(NamedTuple):
    """Commands of one controller: an entry for each, and the values of one after those of the other."""

    tick: MutableSequence[int]
    answered: MutableSequence[int]
    status: MutableSequence[int]
    values: MutableSequence[float]


def commands(applied: Any) -> Rows:
    """The commands in an Applied. Raises BusError where its columns differ in length."""
    if not applied.ticks:
        return Rows([applied.tick], [applied.answered], [applied.status], applied.values)
    columns = (applied.ticks, applied.answers, applied.statuses)
    count = len(applied.ticks)
    if any(len(column) != count for column in columns) or len(applied.values) % count:
        raise BusError("an Applied whose columns differ in length")
    return Rows(*columns, applied.values)


def event(t_ns: int, tick: int, source: str, kind: str, text: str, data: dict[str, Any] | None = None) -> bytes:
    """An Event, packed; `source` is the process that says it on `event/<source>`."""
    packed = json.dumps(data or {})
    told = TYPES["Event"](t_ns=t_ns, tick=tick, source=source, kind=kind, text=text, data=packed)
    return bytes(told.SerializeToString())


def file_descriptor_set(kind: type[Message]) -> bytes:
    """The serialised FileDescriptorSet of a type: the schema that a recording carries."""
    found = descriptor_pb2.FileDescriptorSet()
    kind.DESCRIPTOR.file.CopyToProto(found.file.add())
    return bytes(found.SerializeToString())
