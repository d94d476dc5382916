"""Measures the link to a board with echo frames, which drive nothing: before a run, with the period that it holds."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rig.errors import DeviceError
from rig.machine.board import ECHO, HEAD, WIDTHS, Address, Line, line_bytes
from rig.qualify.round_trips import in_words, period_of, quantiles

RATES = {100: 100, 1000: 2000, 5000: 5000}
"""Rate of the frames [1/s] -> how many. # chosen: at most two seconds each"""
PATIENCE_S = 0.1
"""Time after which a frame is missed [s]."""
LATENCY = Path("/sys/bus/usb-serial/devices")
"""Folder with the latency timers of USB adapters."""


@dataclass(frozen=True)
class AtRate:
    """Round trips at a rate [1/s]: median, 99 % and worst [ms], and how many of the frames had no answer."""

    rate: int
    frames: int
    missed: int
    p50: float
    p99: float
    worst: float


@dataclass(frozen=True)
class BoardLink:
    """The link to a board. `size`: bytes of a frame and its answer on the link.

    `period_ms`: the least usual period of a controller for which 99 % of the answers come within its patience; None if
    there is none. `timer_ms`: latency timer of its USB adapter, if it has one.
    """

    port: str
    values: int
    size: int
    rates: tuple[AtRate, ...]
    period_ms: float | None
    timer_ms: int | None
    timer_file: str

    def to_json(self) -> dict[str, Any]:
        """The result as plain values for JSON."""
        return {**asdict(self), "bytes_per_ms": [self._carried(at) for at in self.rates]}

    def _carried(self, at: AtRate) -> float:
        return self.size / at.p50 if at.p50 else 0.0

    def text(self) -> str:
        """The result as text."""
        lines = [f"{self.port}: echo frames of {self.values} values each way, {self.size} bytes together"]
        for at in self.rates:
            times = f"{at.p50:.3f} / {at.p99:.3f} / {at.worst:.3f} ms (p50, p99, worst)"
            carried = f"{self._carried(at):.3g} bytes per ms"
            lines.append(f"  {at.rate:5d} Hz: {times}, {at.missed} of {at.frames} missed, {carried}")
        lines.append(f"  {in_words(self.period_ms)}")
        if self.timer_ms is not None and self.timer_ms > 1:
            lines.append(
                f"  its USB adapter keeps what arrives for {self.timer_ms} ms; shorter: "
                f"echo 1 | sudo tee {self.timer_file}"
            )
        return "\n".join(lines)


def measure(port: str, baud: int, values: str, count: int) -> BoardLink:
    """Measure the link to the board at `port` with frames of `count` values. Raises DeviceError."""
    try:
        address = Address.read(port)
    except ValueError as fault:
        raise DeviceError(f"{port}: {fault}") from None
    line = Line(address, values, count, baud)
    line.wait(count)
    rates = tuple(_at(line, count, rate) for rate in RATES)
    line.close()
    width = WIDTHS[values]
    size = 2 * (line_bytes(count, width) if address.kind == "serial" else HEAD.size + count * width)
    period = period_of(max(at.p99 for at in rates), max(at.missed / at.frames for at in rates))
    timer = LATENCY / address.device.name / "latency_timer"
    kept = int(timer.read_text()) if address.kind == "serial" and timer.is_file() else None
    return BoardLink(port, count, size, rates, period, kept, str(timer))


def _at(line: Line, count: int, rate: int) -> AtRate:
    """Round trips of frames that are sent at `rate`, or as fast as the answers come."""
    trips = []
    due = time.perf_counter()
    for number in range(RATES[rate]):
        due += 1.0 / rate
        left = due - time.perf_counter()
        if left > 0.0:
            time.sleep(left)
        begun = time.perf_counter()
        if line.ask(ECHO, number, (0.0,) * count, PATIENCE_S) is not None:
            trips.append(1e3 * (time.perf_counter() - begun))
    return AtRate(rate, RATES[rate], RATES[rate] - len(trips), *quantiles(trips, 1e3 * PATIENCE_S))
