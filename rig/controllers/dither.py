"""Dither with the smallest amplitude that suppresses the stick-slip cycle.

A fast tangential vibration of velocity amplitude a turns the falling friction law into a rising average law if it
reverses the slip: a > v_b. An amplitude below the belt speed increases the instability. The generator of the rig
produces the signal; this controller commands its amplitude, frequency and enable, and searches:

    quench   the largest amplitude, until a whole window is quiet
    lower    one step after each quiet window, never below  max(lowest, margin v_b)
    back     the cycle returns (alarm) or does not decay from window to window: the ratio a / v_b has failed, the
             margin is set `back_off` above it; quench again

The oscillation is half the peak-to-peak value of the velocity below `band`, which excludes the dither itself, in
windows that begin `hold_off` after each change. Dither is off if the belt is too fast for any allowed amplitude.
Source: Kroeger, Neubauer, Popp (2008), section 1, which mentions dither; averaged dry friction for v_b < a.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any, ClassVar, Literal, NamedTuple, Self

from pydantic import model_validator

from rig.controllers.blocks import base
from rig.controllers.blocks.design import Rig
from rig.errors import UsageError
from rig.quantities import Hertz, PositiveMetrePerSecond, PositiveSecond, Second, Speed

FALLING = 0.8  # largest ratio of the oscillations of two successive windows that counts as decay
SPEED_BAND = 0.1  # bandwidth of the filter of a measured belt speed, which contains the dither, as a share of `band`


_STATED = ("highest", "lowest", "margin", "step", "back_off", "quiet", "alarm")


class Dither(base.ControllerSection):
    """Parameters; amplitudes and the belt `speed` are velocities at the contact [m/s] for every kind of generator."""

    fixed: ClassVar[frozenset[str]] = base.ControllerSection.fixed | {"speed_sensor"}

    kind: Literal["dither"]
    sensor: str
    speed_sensor: str | None = None
    speed: base.OptionalSpeed = None
    frequency: base.OptionalHertz = None
    highest: PositiveMetrePerSecond = 0.2
    lowest: Speed = 0.0
    margin: base.Margin = 1.2
    step: base.Fraction = 0.1
    back_off: base.Fraction = 0.1
    quiet: PositiveMetrePerSecond = 0.004
    alarm: PositiveMetrePerSecond = 0.015
    band: Hertz = 20.0
    hold_off: Second = 1.0
    window: PositiveSecond = 1.0
    enable_at: Second = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for low, high in (("lowest", "highest"), ("quiet", "alarm"), ("band", "frequency")):
            if getattr(self, high) is not None and getattr(self, low) >= getattr(self, high):
                raise ValueError(f"{high} = {getattr(self, high):g} is not above {low} = {getattr(self, low):g}")
        return self


class Search(NamedTuple):
    """The state of the search: amplitude, smallest ratio to the belt speed, present window, filters."""

    amplitude: float = 0.0
    margin: float = 0.0  # above every ratio that has failed so far
    since_ns: int = -1  # time of the last change of the amplitude; -1 while off
    top: float = -math.inf  # extremes of the slow velocity in this window
    bottom: float = math.inf
    last: float = math.inf  # oscillation in the previous window, inf after a change
    smooth: float = 0.0
    slow: float = 0.0
    speed: float = -1.0


class Rules(NamedTuple):
    """The constants of the search; velocities at the contact [m/s], times [ns]."""

    read_scale: float
    smoothing: float
    speed_column: int  # of the measured belt speed among the measurements; 0 if it is not measured
    speed_scale: float
    speed_smoothing: float
    speed: float  # belt speed that is not measured
    frequency: float
    drive_scale: float
    highest: float
    lowest: float
    margin: float
    step: float
    back_off: float
    quiet: float
    alarm: float
    enable_ns: int
    hold_ns: int
    full_ns: int


def law(p: Rules, state: Search, t_ns: int, values: base.Values) -> tuple[Search, base.Values]:
    """State of the search after a sample, and the command of the generator."""
    amplitude, margin, since, top, bottom, last, smooth, slow, speed = state
    smooth += p.smoothing * (p.read_scale * values[0] - smooth)
    slow += p.smoothing * (smooth - slow)
    if p.speed_column > 0:
        measured = abs(p.speed_scale * values[p.speed_column])
        speed = measured if speed < 0.0 else speed + p.speed_smoothing * (measured - speed)
    else:
        speed = p.speed
    if t_ns < p.enable_ns or p.margin * speed > p.highest:
        return Search(0.0, margin, -1, -math.inf, math.inf, math.inf, smooth, slow, speed), (0.0, p.frequency, 0.0)
    if since < 0:
        amplitude, since = p.highest, t_ns
    elif t_ns - since > p.hold_ns:
        top = slow if slow > top else top
        bottom = slow if slow < bottom else bottom
        whole = t_ns - since >= p.full_ns
        if whole or 0.5 * (top - bottom) > p.alarm:
            amplitude, margin, changed = _judged(p, amplitude, margin, speed, 0.5 * (top - bottom), last, whole)
            last = math.inf if changed else 0.5 * (top - bottom)
            since = t_ns if changed else t_ns - p.hold_ns
            top, bottom = -math.inf, math.inf
    amplitude = max(amplitude, _least(p, margin, speed))
    command = (p.drive_scale * amplitude, p.frequency, 1.0)
    return Search(amplitude, margin, since, top, bottom, last, smooth, slow, speed), command


def _judged(
    p: Rules, amplitude: float, margin: float, speed: float, oscillation: float, last: float, whole: bool
) -> tuple[float, float, bool]:
    """Amplitude [m/s], margin, and whether the amplitude changes, after a window with this oscillation [m/s]."""
    stays = whole and oscillation > p.quiet and oscillation > FALLING * last
    if (stays or oscillation > p.alarm) and amplitude < p.highest:
        failed = (1.0 + p.back_off) * amplitude / speed if speed > 0.0 else 0.0
        return p.highest, max(margin, failed), True
    if oscillation < p.quiet:
        lower = max((1.0 - p.step) * amplitude, _least(p, margin, speed))
        return lower, margin, lower < amplitude
    return amplitude, margin, False


def _least(p: Rules, margin: float, speed: float) -> float:
    """The smallest allowed amplitude [m/s] at this belt speed [m/s]."""
    return min(max(p.lowest, max(p.margin, margin) * speed), p.highest)


class DitherSearch(base.SceneController[Dither]):
    """The controller; it commands amplitude, frequency and enable of the generator."""

    drives = ("dither.amplitude", "dither.frequency", "dither.enable")

    update: base.Update

    def __init__(self, section: Dither, numbers: base.Numbers) -> None:
        super().__init__(section, numbers)
        self.reads += () if section.speed_sensor is None else (section.speed_sensor,)
        speed = section.speed if section.speed is not None else numbers.get("nominal")
        if speed is None and section.speed_sensor is None:
            raise UsageError("speed: is neither stated nor measured, and dither below the belt speed makes it worse")
        frequency = section.frequency if section.frequency is not None else numbers.get("frequency")
        if frequency is None:
            raise UsageError("frequency: is not stated, and the design step gives no number for it")
        turn = -2.0 * math.pi * section.band * section.period * 1e-9
        hold_ns = round(section.hold_off * 1e9)
        rules = Rules(
            read_scale=float(numbers.get("read_scale", 1.0)),
            smoothing=-math.expm1(turn),
            speed_column=len(self.reads) - 1,
            speed_scale=float(numbers.get("speed_scale", 1.0)),
            speed_smoothing=-math.expm1(SPEED_BAND * turn),
            speed=abs(float(speed or 0.0)),
            frequency=float(frequency),
            # a generator on the belt gets a velocity; one on the mass the force that causes it far above resonance
            drive_scale=float(numbers["force_per_hertz"]) * frequency if "force_per_hertz" in numbers else 1.0,
            enable_ns=round(section.enable_at * 1e9),
            hold_ns=hold_ns,
            full_ns=hold_ns + round(section.window * 1e9),
            **{key: getattr(section, key) for key in _STATED},
        )
        self.update = partial(law, rules)

    @staticmethod
    def design(rig: Rig, section: Dither) -> dict[str, Any]:
        """Frequency and scales of the search. Raises ValueError without a tangential dither."""
        amplitude = rig.actuator("dither.amplitude")
        frequency = rig.actuator("dither.frequency")
        if amplitude is None or frequency is None:
            raise ValueError("kind: commands a dither generator, and the scene has no [dither]")
        numbers: dict[str, Any] = {"frequency": frequency.value, "read_scale": rig.read_scale(section.sensor)}
        if amplitude.unit == "N":
            if not rig.pushed_by("dither.sin"):
                raise ValueError("kind: searches a tangential dither; the generator of this scene acts on the load")
            numbers["force_per_hertz"] = 2.0 * math.pi * rig.inertia
        numbers["nominal"] = rig.surface_speed
        if section.speed_sensor is not None:
            numbers["speed_scale"] = rig.speed_scale(section.speed_sensor)
        return numbers

    def start(self) -> Search:
        """The state before the first sample: dither is off."""
        return Search()
