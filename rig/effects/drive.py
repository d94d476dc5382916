"""The drive: the speed of the belt or of the disc, equal to the command or following it with a lag within limits.

    without lag   V = u,  u' = slope                         u: command, slope: of a ramp
    with lag      V' = (min(max(u, speed_min), speed_max) - V) / lag

The limits are a limiter inside the plant, so a ramp is clamped at the instant at which it reaches a limit.
Source: Kroeger, Neubauer, Popp (2008), equation 4.7 and figure 22 (the actuator of the belt-velocity feedback).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Self

from pydantic import Field, model_validator

from rig.about import About, Bound, SetPoint
from rig.model.assembly import Assembly, Input
from rig.model.named_rows import Row
from rig.quantities import MetrePerSecond, PositiveSecond, RadianPerSecond, Section

Lag = Annotated[PositiveSecond | None, About("a first-order actuator")]
"""The time constant of an actuator that does not reach its command at once; None: no lag."""
_LOW = Bound(of="speed", sign=-1)
_HIGH = Bound(of="speed", sign=1)
FASTEST = {"m/s": 100.0, "rad/s": 1e4}
"""Largest speed in either direction that can be commanded to a drive without limits, by unit [chosen]."""


class _Drive(Section):
    declares: ClassVar = About("moves the surface at the commanded speed")

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
    """The drive of a belt; speeds in m/s."""

    speed: Annotated[MetrePerSecond, Field(title="belt speed"), SetPoint()]
    speed_min: Annotated[MetrePerSecond | None, _LOW] = None
    speed_max: Annotated[MetrePerSecond | None, _HIGH] = None


class DiscDrive(_Drive):
    """The drive of a disc; speeds in rad/s (a scene may state rpm)."""

    speed: Annotated[RadianPerSecond, Field(title="disc speed"), SetPoint()]
    speed_min: Annotated[RadianPerSecond | None, _LOW] = None
    speed_max: Annotated[RadianPerSecond | None, _HIGH] = None


def limits(low: float | None, high: float | None) -> tuple[float, float]:
    """The limits (low, high); minus or plus infinity where a limit is None."""
    return (-math.inf if low is None else low), (math.inf if high is None else high)


def add(a: Assembly, drive: _Drive, unit: str, moved: Mapping[str, str]) -> Row:
    """Add the drive's states and its actuator `drive.speed`; returns the row of its speed [`unit`].

    With a lag the command is a state even if nothing moves it. A surface that has reached its command is then without
    acceleration to the last bit; a multiple of the constant would leave a rounding error, divided by the lag.
    """
    low, high = limits(drive.speed_min, drive.speed_max)
    if drive.lag is not None:
        moved = {"drive.speed": "held", **moved}
    safe = 0.0 if low <= 0.0 <= high else drive.speed
    bounds = (low, high)
    most = FASTEST[unit]
    return actuator(a, "drive.speed", unit, drive.speed, safe, bounds, most, drive.lag, "drive", moved)


def command_range(value: float, low: float, high: float, most: float) -> tuple[float, float]:
    """The range of an actuator. A missing limit is replaced by `most` in size, or by `value` if that is larger."""
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
    """Add a commanded quantity with ramp, lag and limits, each only if the scene needs it; returns its row.

    `moved[name]` states what the scene does with it: nothing (absent), "held" commands, or also ramps ("ramped"). With
    infinite `bounds` it accepts commands up to `most` in size, and the plant contains no limiter.
    """
    how = moved.get(name, "")
    low, high = bounds
    state = ""
    slope = ""
    row: Row = {"one": value}
    if how:
        state = f"{owner}.command"
        slope = f"{owner}.slope" if how == "ramped" else ""
        if slope:
            a.signal(slope, {}, 0.0, f"{owner} ramp", "the slope of a value that runs linearly")
        description = "the commanded value, held from tick to tick"
        a.signal(state, {slope: 1.0} if slope else {}, value, f"{owner} command", description)
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
    a.inputs[name] = Input(unit, *command_range(value, low, high, most), value, safe, state, slope, lagging=lagging)
    return row
