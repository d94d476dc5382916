"""The streams of a paced run: what boards and data acquisitions measure, taken in at each tick (docs/device.md).

A board sends its values on its own. The newest ones become the samples of their streams at this tick, before the step
is sent. While none arrive the last ones stay, their age grows, and after `patience` the stream counts as lost.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from math import isfinite

from rig.bench.run.journal import Journal
from rig.bench.run.runner import PlantRunner
from rig.machine.board import BOOT_S, MEASURED, Frame, Link
from rig.printable import counted
from rig.scenes.scene import Scene
from rig.sensors.stream import AGE, Stream, streams

LOST, BACK = "stream lost", "stream back"
"""Kinds of events."""
LATE = 16
"""Frames by which a sequence may be behind; one that is farther behind begins anew. # chosen: more than UDP reorders"""
COUNTED = ("frames", "damaged", "other", "unfit", "lost")


class StreamPort(Link):
    """The link to a board that sends on its own, and the sensors that its frames give values to: place in the bank ->
    section.

    COUNTED   frames    whose values were taken in
              damaged   no frame, or CRC, length or version is wrong
              other     late, doubled, or of another kind
              unfit     another number of values, or values that are not finite
              lost      how often no values came within the shortest patience of the sensors
    """

    def __init__(self, sensors: Mapping[int, Stream]) -> None:
        first = next(iter(sensors.values()))
        super().__init__(first.address, first.baud, COUNTED)
        self.sensors = sensors
        self.values: tuple[float, ...] = ()
        """The newest values; () before the first ones."""
        self.arrived = time.perf_counter()
        """When they arrived."""
        self.lost = False
        self.patience_s = min(float(section.patience) for section in sensors.values())
        self._number = max(section.channel for section in sensors.values())
        self._sequence = -1
        self.open()

    def receive(self, timeout_s: float = 0.0) -> None:
        """Take in the frames that have arrived, waiting at most `timeout_s` for the first one."""
        for frame in self.frames(timeout_s):
            if frame.kind != MEASURED or self._is_late(frame.sequence):
                self.counts["other"] += 1
            elif len(frame.values) != self._number or not all(map(isfinite, frame.values)):
                self.counts["unfit"] += 1
                self.unfit = f"expected frames with {counted(self._number, 'finite value')}"
            else:
                self._take(frame)

    def _is_late(self, sequence: int) -> bool:
        return self._sequence >= 0 and (self._sequence - sequence) & 0xFFFFFFFF < LATE

    def _take(self, frame: Frame) -> None:
        self._sequence = frame.sequence
        self.values = tuple([value + 0.0 for value in frame.values])  # no -0.0: a sample is offset + 0
        self.arrived = time.perf_counter()
        self.counts["frames"] += 1


class StreamPorts:
    """All ports of the streams of `scene`, opened. Raises DeviceError if one cannot be, or sends no values."""

    def __init__(self, scene: Scene, runner: PlantRunner, journal: Journal) -> None:
        self._bank = runner.bank
        self._journal = journal
        by_port: dict[str, dict[int, Stream]] = {}
        for name, section in streams(scene.sensors).items():
            by_port.setdefault(section.port, {})[self._bank.names.index(name)] = section
        self.ports = [StreamPort(sensors) for sensors in by_port.values()]

    def wait(self, stopping: Callable[[], object]) -> None:
        """Wait for the first values of each port. Raises DeviceError for one that sends none within `BOOT_S`."""
        end = time.perf_counter() + BOOT_S
        for port in self.ports:
            while not port.values and not stopping():
                left = end - time.perf_counter()
                if left <= 0.0:
                    raise port.silence("values", "send the frames of docs/device.md to this computer")
                port.receive(min(left, 0.1))

    def receive(self) -> None:
        """Put the newest values, and their ages, into the samples of this tick."""
        for port in self.ports:
            port.receive()
            if not port.values:  # the run ends before it has begun
                continue
            age = time.perf_counter() - port.arrived
            for i, section in port.sensors.items():
                self._bank.give(i, age if section.channel == AGE else port.values[section.channel - 1])
            if (age > port.patience_s) is not port.lost:
                self._change(port, age)

    def _change(self, port: StreamPort, age: float) -> None:
        port.lost = not port.lost
        if port.lost:
            port.counts["lost"] += 1
            self._journal.note(LOST, f"{port.address}: no values for {1e3 * age:.0f} ms{port.received}")
        else:
            self._journal.note(BACK, f"{port.address} sends values again")

    def counters(self) -> dict[str, dict[str, int]]:
        """Port -> its counts (`StreamPort`)."""
        return {str(port.address): dict(port.counts) for port in self.ports}

    def faults(self) -> list[str]:
        """A line for each port whose values were missing."""
        lost = [(port.address, port.counts["lost"]) for port in self.ports]
        return [f"the stream at {address} was lost {counted(count, 'time')}" for address, count in lost if count]

    def close(self) -> None:
        """Close all ports."""
        for port in self.ports:
            port.close()
