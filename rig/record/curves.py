"""Reduced curves and a log in a recording for programs that know nothing of this project.

rerun and Foxglove make no time series of blocks of samples. A recording therefore contains, beside its messages:

    curve/<output>_in_<unit>, measured/<sensor>_in_<unit>    std_msgs/Float64MultiArray (CDR) with one number
    log/<process>                                            foxglove.Log (protobuf), one for each event

A curve has at most two points in each `WINDOW_NS`: the lowest and the highest sample, in the order in which they
occurred, at their own times. A vibration that is faster than the curve appears as a band and not as an alias. Readers
of this project ignore these topics: they contain nothing that is not elsewhere in the recording.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from google.protobuf import descriptor_pb2, timestamp_pb2
from mcap.well_known import MessageEncoding, SchemaEncoding
from numpy.typing import NDArray

from rig.record.foxglove import Log_pb2

WINDOW_NS = 40_000_000
SCHEMA = """std_msgs/MultiArrayLayout layout
float64[] data
================================================================================
MSG: std_msgs/MultiArrayLayout
std_msgs/MultiArrayDimension[] dim
uint32 data_offset
================================================================================
MSG: std_msgs/MultiArrayDimension
string label
uint32 size
uint32 stride
"""
_FORMER = "plot"
"""The only derived topic of older recordings: outputs and latest measurements, 50 times a second."""
_ROOTS = ("curve/", "measured/", "log/")
_POINT = struct.Struct("<4sIII4xd")  # CDR, little endian: no dimensions, no offset, one number at a multiple of 8
_CDR = b"\0\1\0\0"
_LEVELS = {
    "fault": 4,
    "diverged": 4,
    "limit": 4,
    "emergency": 4,
    "refused": 3,
    "left": 3,
    "pause": 3,
    "overrun": 3,
    "missing": 3,
    "safe": 3,
}
_INFO = 2
_SILENT = frozenset({"contact"})
"""Kinds of events that are not in the log: there may be thousands a second."""


class Point(NamedTuple):
    """One message of a curve."""

    t_ns: int
    topic: str
    payload: bytes


def derived(topic: str) -> bool:
    """Whether a topic of a recording was derived by its writer, and never was on the bus."""
    return topic == _FORMER or topic.startswith(_ROOTS)


def topic_of(root: str, name: str, unit: str) -> str:
    """Topic of a curve, e.g. "curve/velocity_in_m_per_s"; `root`: "curve" for an output, "measured" for a sensor."""
    plain = unit.replace("^", "").replace("/", "_per_").replace("*", "_")
    return f"{root}/{name}_in_{plain}" if unit not in ("", "1") else f"{root}/{name}"


class Curves:
    """Reduces the samples of outputs and sensors (name -> unit) to points of their curves."""

    def __init__(self, outputs: Mapping[str, str], sensors: Mapping[str, str]) -> None:
        self.topics = {f"truth/{name}": topic_of("curve", name, unit) for name, unit in outputs.items()}
        self.topics |= {f"meas/{name}": topic_of("measured", name, unit) for name, unit in sensors.items()}
        self.units = dict(zip(self.topics.values(), [*outputs.values(), *sensors.values()]))
        self._open = {topic: _Window() for topic in self.topics}

    def add(self, topic: str, t_ns: NDArray[np.int64], v: NDArray[np.float64]) -> Iterator[Point]:
        """Add samples of `truth/<output>` or `meas/<sensor>`; yield the points of windows that are complete."""
        if topic not in self.topics or not t_ns.size:
            return
        window = self._open[topic]
        curve = self.topics[topic]
        numbers = t_ns // WINDOW_NS
        inside = numbers[0] == numbers[-1]
        cuts = [0, t_ns.size] if inside else [0, *(np.flatnonzero(np.diff(numbers)) + 1).tolist(), t_ns.size]
        for begin, end in pairwise(cuts):
            if window.number != numbers[begin]:
                yield from window.points(curve)
                window.begin(int(numbers[begin]))
            window.add(t_ns[begin:end], v[begin:end])

    def complete(self, until_ns: float = math.inf) -> Iterator[Point]:
        """Yield the points of the windows before `until_ns`, of which every sample is there."""
        for topic, window in self._open.items():
            if (window.number + 1) * WINDOW_NS <= until_ns:
                yield from window.points(self.topics[topic])
                window.begin(window.number)


class _Window:
    """Lowest and highest sample of one curve in the present window."""

    def __init__(self) -> None:
        self.begin(-1)

    def begin(self, number: int) -> None:
        self.number = number
        self._extremes: list[tuple[int, float]] = []

    def add(self, t_ns: NDArray[np.int64], v: NDArray[np.float64]) -> None:
        if (lost := np.isnan(v)).any():
            t_ns = t_ns[~lost]
            v = v[~lost]
        if v.size:
            rows = {int(v.argmin()), int(v.argmax())}
            extremes = [*self._extremes, *((int(t_ns[row]), float(v[row])) for row in sorted(rows))]
            self._extremes = [min(extremes, key=_value), max(extremes, key=_value)]

    def points(self, curve: str) -> Iterator[Point]:
        for t_ns, value in sorted(set(self._extremes)):
            yield Point(t_ns, curve, _POINT.pack(_CDR, 0, 0, 1, value))


def _value(sample: tuple[int, float]) -> float:
    return sample[1]


def schema(topic: str) -> tuple[str, str, bytes, str]:
    """Schema of a derived topic: its name, its encoding and its text, and the encoding of the messages."""
    if topic.startswith("log/"):
        described = descriptor_pb2.FileDescriptorSet()
        for file in (timestamp_pb2.DESCRIPTOR, Log_pb2.DESCRIPTOR):
            file.CopyToProto(described.file.add())
        return "foxglove.Log", SchemaEncoding.Protobuf, described.SerializeToString(), MessageEncoding.Protobuf
    return "std_msgs/msg/Float64MultiArray", SchemaEncoding.ROS2, SCHEMA.encode(), MessageEncoding.CDR


def log(event: Any, source: str, t_ns: int) -> bytes | None:
    """The foxglove.Log message of an Event of a process; None for an event that is not logged."""
    if event.kind in _SILENT:
        return None
    seconds, nanos = divmod(t_ns, 10**9)
    text = f"t = {event.t_ns * 1e-9:.3f} s, {event.kind}: {event.text}"
    content = Log_pb2.Log(  # type: ignore[attr-defined]
        timestamp={"seconds": seconds, "nanos": nanos}, level=_LEVELS.get(event.kind, _INFO), message=text, name=source
    )
    return bytes(content.SerializeToString())
