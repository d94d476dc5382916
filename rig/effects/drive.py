"""The drive: the speed of the belt or of the disc, as commanded, or through a lag with limits.

    without lag   V = u,  u' = slope                         u: command, slope: of a ramp
    with lag      V' = (min(max(u, speed_min), speed_max) - V) / lag

The limits are a limiter inside the plant, so a ramp that runs beyond them is clamped at the instant it does.
Source: Kroeger, Neubauer, Popp (2008), equation 4.7 and figure 22 (the actuator of the belt-velocity feedback).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Self

from pydantic import model_validator

from rig.about import About, Bound
from rig.model.assembly import Assembly, Input
from rig.model.named_rows import Row
from rig.quantities import MetrePerSecond, PositiveSecond, RadianPerSecond, Section

Lag = Annotated[PositiveSecond | None, About("a first-order actuator")]
"""Of an actuator that does not reach its command at once."""
_LOW, _HIGH = Bound(of="speed", sign=-1), Bound(of="speed", sign=1)


class _Drive(Section):
    declares: ClassVar = About("moves the surface at the speed commanded")

    speed: Any
    lag: Lag = None
    speed_min: Any = None
    speed_max: Any = None

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        low, high = limits(self.speed_min, self.speed_max)
        if low >= high:
            raise ValueError(f"speed_min {low:g} is not below speed_max {high:g}")
        if not low <= self.speed <= high:
            raise ValueError(f"speed {self.speed:g} is outside speed_min {low:g} .. speed_max {high:g}")
        return self


class BeltDrive(_Drive):
    """Drives a belt; speeds in m/s."""

    speed: MetrePerSecond
    speed_min: Annotated[MetrePerSecond | None, _LOW] = None
    speed_max: Annotated[MetrePerSecond | None, _HIGH] = None


class DiscDrive(_Drive):
    """Drives a disc; speeds in rad/s (rpm are understood)."""

    speed: RadianPerSecond
    speed_min: Annotated[RadianPerSecond | None, _LOW] = None
    speed_max: Annotated[RadianPerSecond | None, _HIGH] = None


FASTEST = {"m/s": 100.0, "rad/s": 1e4}
"""Speed that a drive without limits of its own can be commanded to, either way round [chosen]."""


def limits(low: float | None, high: float | None) -> tuple[float, float]:
    """Limits with infinity where none is given."""
    return (-math.inf if low is None else low), (math.inf if high is None else high)


def add(a: Assembly, drive: _Drive, unit: str, moved: Mapping[str, str]) -> Row:
    """Add the drive's signals and its actuator `drive.speed`; returns the row of its speed."""
    low, high = limits(drive.speed_min, drive.speed_max)
    return actuator(a, "drive.speed", unit, drive.speed, 0.0 if low <= 0.0 <= high else drive.speed,
                    (low, high), FASTEST[unit], drive.lag, "drive", moved)  # fmt: skip


def reach(value: float, low: float, high: float, most: float) -> tuple[float, float]:
    """Range of an actuator: its limits; where there are none `most` in size, or its `value` if that is more."""
    return min(-most, value) if low == -math.inf else low, max(most, value) if high == math.inf else high


def actuator(
    a: Assembly,
    name: str,
    unit: str,
    value: float,
    safe: float,
    bounds: tuple[float, float],
    most: float,
    lag: float | None,
    owner: str,
    moved: Mapping[str, str],
) -> Row:
    """A commanded quantity, with ramp, lag and limits as far as they are needed; returns its row.

    `moved[name]` says what the scene does with it: nothing (absent), "held" commands, or "ramped" too. Where `bounds`
    are infinite, it takes commands up to `most` in size, but no limiter is part of the plant.
    """
    how = moved.get(name, "")
    low, high = bounds
    state, slope = "", ""
    row: Row = {"one": value}
    if how:
        state, slope = f"{owner}.command", f"{owner}.slope" if how == "ramped" else ""
        if slope:
            a.signal(slope, {}, 0.0, f"{owner} ramp", "the slope of a value that runs linearly")
        told = "the value commanded, held from tick to tick"
        a.signal(state, {slope: 1.0} if slope else {}, value, f"{owner} command", told)
        row = {state: 1.0}
    if lag is not None:
        real = f"{owner}.actual"
        a.signal(real, {real: -1.0 / lag}, value, f"{owner} lag")
        if how and math.isfinite(low + high):
            a.limit(owner, row, low, high, real, 1.0 / lag)
        else:
            for entry, coefficient in row.items():
                a.signals[real][entry] = coefficient / lag
        row = {real: 1.0}
    lagging = f"{owner}.actual" if lag is not None else ""
    a.inputs[name] = Input(unit, *reach(value, low, high, most), value, safe, state, slope, lagging=lagging)
    return row
