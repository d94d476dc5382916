"""Fast encoders for frequent messages: 1 us instead of protobuf's 50 us for a block of 200 samples.

Wire format: an sfixed64 is a tag and 8 bytes; a packed field is a tag, its length as a varint and raw little-endian
numbers (https://protobuf.dev/programming-guides/encoding/). The tests compare these bytes with protobuf's own parser.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Callable, Mapping, Sequence
from functools import cache

import numpy as np

_ONE = struct.Struct("<Bq")
_TWO = struct.Struct("<BqBqB")
_THREE = struct.Struct("<BqBqBqB")
_FOUR = struct.Struct("<BqBqBqBqB")
_FIXED = 1
_PACKED = 2


def _tag(number: int, wire: int) -> bytes:
    return _varint(number << 3 | wire)


def _varint(value: int) -> bytes:
    if value < 0x80:
        return value.to_bytes()
    parts = bytearray()
    while value >= 0x80:
        parts.append(value & 0x7F | 0x80)
        value >>= 7
    parts.append(value)
    return bytes(parts)


@cache
def _length(size: int) -> bytes:
    return _varint(size)


@cache
def _numbers(count: int) -> Callable[..., bytes]:
    return struct.Struct(f"<{count}d").pack


def _raw(values: np.ndarray | Sequence[float] | bytes) -> bytes:
    if isinstance(values, bytes):
        return values
    if isinstance(values, array):
        return values.tobytes()
    if isinstance(values, np.ndarray):
        return values.tobytes() if values.dtype.char == "d" else values.astype(np.float64).tobytes()
    return _numbers(len(values))(*values)


def step(
    tick: int,
    t_ns: int,
    values: np.ndarray | Sequence[float],
    fresh: np.ndarray,
    heard: Mapping[int, np.ndarray] | None = None,
) -> bytes:
    """Encode a Step.

    `values` float64 [sensors]: latest sample of each sensor; `fresh` int64 [sensors]: number of its new samples;
    `heard`: index of a sensor -> its new samples.
    """
    raw = _raw(values)
    new = fresh.tobytes()
    parts = [_TWO.pack(9, tick, 17, t_ns, 26), _length(len(raw)), raw, b"\x22", _length(len(new)), new]
    if heard:
        places = np.array(list(heard)).tobytes()
        samples = b"".join(map(_raw, heard.values()))
        parts += [b"\x2a", _length(len(places)), places, b"\x32", _length(len(samples)), samples]
    return b"".join(parts)


def act(tick: int, t_ns: int, values: np.ndarray | Sequence[float]) -> bytes:
    """Encode an Act: the commands that answer the step of `tick`."""
    raw = _raw(values)
    return _TWO.pack(9, tick, 17, t_ns, 26) + _length(len(raw)) + raw


def applied(tick: int, t_ns: int, answered: int, status: int, values: np.ndarray | Sequence[float]) -> bytes:
    """Encode an Applied: the commands in force from `tick` on."""
    raw = _raw(values)
    return _FOUR.pack(9, tick, 17, t_ns, 25, answered, 33, status, 42) + _length(len(raw)) + raw


def each_applied(
    frame_ns: int, ticks: array[int], answers: array[int], statuses: array[int], values: array[float]
) -> list[bytes]:
    """Encode an Applied for each of `ticks` (at least one), in a tenth of the time that calls of `applied` take.

    `values` are concatenated.
    """
    first = applied(ticks[0], ticks[0] * frame_ns, answers[0], statuses[0], values[: len(values) // len(ticks)])
    size = len(first)
    count = len(ticks)
    rows = np.frombuffer(bytearray(first * count), np.uint8).reshape(count, size)
    times = array("q", [tick * frame_ns for tick in ticks])
    columns = [field.tobytes() for field in (ticks, times, answers, statuses)]
    for at, column in zip((1, 10, 19, 28, size - 8 * (len(values) // count)), (*columns, values.tobytes())):
        numbers = np.frombuffer(column, np.uint8).reshape(count, -1)
        rows[:, at : at + numbers.shape[1]] = numbers
    raw = rows.tobytes()
    return [raw[i : i + size] for i in range(0, len(raw), size)]


def commands(
    frame_ns: int, ticks: array[int], answers: array[int], statuses: array[int], values: array[float]
) -> bytes:
    """Encode an Applied with one command for each of `ticks` (at least one); `values` are concatenated."""
    head = applied(ticks[0], ticks[0] * frame_ns, answers[0], statuses[0], values)
    if len(ticks) == 1:
        return head
    length = _length(8 * len(ticks))
    columns = zip((b"2", b":", b"B"), (ticks, answers, statuses))
    return b"".join([head, *(tag + length + column.tobytes() for tag, column in columns)])


def block(
    tick: int, t0_ns: int, dt_ns: int, v: np.ndarray | Sequence[float] | bytes, t_ns: np.ndarray | None = None
) -> bytes:
    """Encode a Block of samples published at `t0_ns` and every `dt_ns` after it, or at `t_ns` (int64), if given.

    `v`: the samples, or their bytes (float64).
    """
    raw = _raw(v)
    parts = [_THREE.pack(9, tick, 17, t0_ns, 25, dt_ns, 34), _length(len(raw)), raw]
    if t_ns is not None:
        parts += [b"\x2a", _length(8 * len(t_ns)), t_ns.astype(np.int64, copy=False).tobytes()]
    return b"".join(parts)


def band(
    tick: int,
    t0_ns: int,
    ends_ns: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    counts: np.ndarray,
    modes: np.ndarray,
    step_ns: int,
    pair: np.ndarray,
    pair_modes: np.ndarray,
) -> bytes:
    """Encode a Band; `low` and `high` float64 [span, output], `pair` float64 [step, 2], the others int64."""
    parts = [_TWO.pack(9, tick, 17, t0_ns, 26)[:-1]]
    for number, column in ((3, ends_ns), (4, low), (5, high), (6, counts), (7, modes), (9, pair), (10, pair_modes)):
        raw = column.tobytes()
        parts += [_tag(number, _PACKED), _length(len(raw)), raw]
        if number == 7:
            parts.append(_ONE.pack(65, step_ns))
    return b"".join(parts)


def samples(tick: int, t_ns: np.ndarray, v: np.ndarray) -> bytes:
    """Encode a Block of samples published at `t_ns` (int64, at least one); uneven times are listed one by one."""
    gaps = np.diff(t_ns)
    even = not gaps.size or not np.ptp(gaps)
    dt_ns = round((int(t_ns[-1]) - int(t_ns[0])) / gaps.size) if gaps.size else 0
    return block(tick, int(t_ns[0]), dt_ns, v, None if even else t_ns)


class StateEncoder:
    """Encodes the `State` of a scene with `count` outputs; call it with t_ns, tick, mode and the values in order.

    The message has a fixed layout, so each call only overwrites the numbers in one buffer.
    """

    def __init__(self, count: int) -> None:
        tags = [_tag(number, _FIXED) for number in range(1, 4 + count)]
        self._buffer = bytearray(b"".join(tag + bytes(8) for tag in tags))
        self._short = min(count, 12)  # fields 4 to 15 have a tag of one byte, all later ones of two
        self._head = self._view("u1", "<i8", 0, 3)
        self._low = self._view("u1", "<f8", 27, self._short)
        self._high = self._view("<u2", "<f8", 27 + 9 * self._short, count - self._short)

    def _view(self, tag: str, number: str, offset: int, count: int) -> np.ndarray:
        kind = np.dtype([("tag", tag), ("number", number)])
        return np.frombuffer(self._buffer, kind, count, offset)["number"] if count else np.empty(0)

    def __call__(self, t_ns: int, tick: int, mode: int, values: np.ndarray | bytes) -> bytes:
        """Encode the State at `t_ns`; `values` float64 [outputs], or their bytes."""
        head = self._head
        short = self._short
        numbers = np.frombuffer(values)
        head[0] = t_ns
        head[1] = tick
        head[2] = mode
        self._low[:] = numbers[:short]
        if self._high.size:
            self._high[:] = numbers[short:]
        return bytes(self._buffer)
