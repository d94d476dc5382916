"""Decodes many messages of one type at once: columns of numbers instead of a protobuf object for each message.

Messages of the same length usually differ in their numbers only. Their tags and lengths are then compared once, as
bytes, and the numbers are read in place (the wire format is explained in `rig.bus.encode`). All other messages are
decoded by protobuf, so that both ways give the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import Message
from numpy.typing import NDArray

Columns = dict[str, NDArray[Any]]
"""Fields of several messages: name -> int64 or float64 [messages], and [messages, entries] of a repeated field."""
_NUMBERS = {FieldDescriptor.TYPE_SFIXED64: np.dtype("<i8"), FieldDescriptor.TYPE_DOUBLE: np.dtype("<f8")}
_FIXED = 1
_PACKED = 2


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
