"""The protocol steps that a scene declares. `rig.bench` carries them out in the plant, at ticks.

    load         moves the normal force linearly to `force` within `over`
    ramp         moves an actuator linearly to a value within `over`
    hold         lets `time` pass
    wait         waits until a measurement is above or below a value, quiet or settled; at most `timeout`
    mark         writes a line into the recording
    knock        gives the body an impulse along the sliding direction at the contact; with `duration` by a half sine
    follow       lets actuators follow channels of a recording, frame by frame, from `begin` to `end` of its time; or
                 sensors, for `time`: a stream of a real rig (rig.sensors.stream), or an instrument
    set          sets an actuator, a parameter of the rig or of a controller at once
    connect      connects a controller to its actuators
    disconnect   disconnects it; the actuators return to the latest values of the protocol
    repeat       carries out steps a number of times or "forever"

A value has the unit of the quantity that it changes or is compared with. To read a text with a unit, the rig must be
known: the loader passes `Known` as validation context. Without it only SI numbers are read, as in a recorded scene.
Times are whole nanoseconds. `Clock` is the section [clock], whose frames the steps are carried out in.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from annotated_types import Ge, Gt, Le
from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    PlainSerializer,
    TypeAdapter,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import CoreSchema, core_schema

from rig.parts import DataFile
from rig.quantities import (
    LONGEST,
    Nanoseconds,
    NonNegativeNewton,
    PositiveMetrePerSecond,
    Range,
    Section,
    Unit,
    duration,
    finite,
    nanoseconds,
    quantity,
)
from rig.scenes.faults import near
from rig.units import si

Count = Annotated[int, Gt(0), Le(1_000_000)]
Frame: Any = duration(1_000, 1_000_000_000)
FixedStep: Any = duration(10, 1_000_000_000)
Share: Any = quantity("1", Ge(0.0), Le(1.0))
Small: Any = quantity("1", Gt(0.0), Le(1e-2))
Large: Any = quantity("1", Gt(0.0))
Impulse: Any = quantity("N*s")

Length = Annotated[
    int,
    Unit("s"),
    BeforeValidator(partial(nanoseconds, within=Range("s", (Ge(0.0),)))),
    Ge(0),
    Le(LONGEST),
    PlainSerializer(lambda ns: ns / 1e9),
]

DEFAULT_TIMEOUT = 60_000_000_000
DEFAULT_WINDOW = 1_000_000_000

CONDITIONS = ("above", "below", "quiet", "settled")

_SWITCHED = BeforeValidator(lambda to: float(to) if isinstance(to, bool) else to)

_LATER = ConfigDict(defer_build=True)


class Clock(Section):
    """Frame, pace and integration of a scene.

    frame     loop period: commands in, measurements out [chosen]
    method    of integration [chosen]; auto: exact if laws are constant, rosenbrock if one has memory, else dopri5
    tolerance   of dopri5, dop853 and rosenbrock, relative [chosen]
    rk4_step  of rk4 and kick [chosen]
    smoothing   slip speed over which smooth lets friction rise [chosen]
    overrun   policy of a paced run that is late [chosen]
    late_share_valid, late_share_degraded   share of frames late by more than one frame, for the timing verdict [chosen]
    pace_limit   largest pace (simulated over wall time) at which the scene keeps up with the clock; its note says why
    hold_frames   frames for which a missing command is replaced by the last one; after them, by the safe value [chosen]
    events_per_frame   largest number of events in one frame; more stop the run [chosen]
    limit     largest norm of the state; beyond, the run has diverged [chosen]
    """

    frame: Frame = 1_000_000
    method: Literal["auto", "exact", "dopri5", "dop853", "rosenbrock", "rk4", "kick", "smooth"] = "auto"
    tolerance: Small = 1e-7
    rk4_step: FixedStep = 100_000
    smoothing: PositiveMetrePerSecond = 1e-3
    overrun: Literal["catch-up", "skip", "slow", "stop"] = "catch-up"
    late_share_valid: Share = 0.01
    late_share_degraded: Share = 0.05
    pace_limit: Large | None = None
    hold_frames: Count = 50
    events_per_frame: Count = 200
    limit: Large = 1e6
    unstable: Literal["refuse", "run"] = "refuse"

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.late_share_degraded < self.late_share_valid:
            raise ValueError("late_share_degraded is below late_share_valid")
        return self

    def substeps(self, step_ns: int) -> int:
        """Steps of rk4 or kick in `step_ns` [ns], none longer than `rk4_step`."""
        return max(1, -(-step_ns // int(self.rk4_step)))


@dataclass(frozen=True)
class Known:
    """The names that a protocol may use: actuators, other keys to set and sensors, each with its unit; controllers."""

    inputs: Mapping[str, str] = field(default_factory=dict)
    settable: Mapping[str, str] = field(default_factory=dict)
    sensors: Mapping[str, str] = field(default_factory=dict)
    controllers: frozenset[str] = frozenset()
    frame_ns: int = 1_000_000
    whole: bool = True
    """False for a rig that could not be built: any name is taken then, and values are not read."""


UNKNOWN = Known(whole=False)


def _named(value: str, what: str, info: ValidationInfo, *rooms: str) -> str:
    """A name in one of the `rooms` of the rig."""
    known = info.context
    if known is not None and known.whole:
        names = {name for room in rooms for name in getattr(known, room)}
        if value not in names:
            raise ValueError(f"unknown {what}; {near(value, names)}")
    return value


def read_in_unit_of(value: Any, field: str, info: ValidationInfo, of: Callable[[str], str], *rooms: str) -> Any:
    """A value in the unit `of` the quantity that `field` names. A wrong name is reported separately."""
    if value is None:
        return None
    known = info.context
    name = info.data.get(field, "")
    if known is None:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError("expected a number in SI")
        return value
    if "inputs" in rooms and name in known.inputs:
        return si(value, of(known.inputs[name]))  # rig.scenes.checks.commanded checks the range of an actuator
    unit = next((getattr(known, room)[name] for room in rooms if name in getattr(known, room)), None)
    return 0.0 if unit is None else finite(value, of(unit))


def _of(what: str, *rooms: str) -> AfterValidator:
    """A field that names something in one of the `rooms` of the rig."""
    return AfterValidator(lambda name, info: _named(name, what, info, *rooms))


def _like(field: str, *rooms: str) -> BeforeValidator:
    """A field with a value in the unit of what `field` names."""
    return BeforeValidator(lambda value, info: read_in_unit_of(value, field, info, str, *rooms))


class Load(Section):
    """Move the normal force (of the magnet) linearly to `force` within `over`."""

    step: Literal["load"]
    force: NonNegativeNewton
    over: Length = 0

    @field_validator("step")
    @classmethod
    def _loadable(cls, step: str, info: ValidationInfo) -> str:
        known = info.context
        if known is not None and known.whole and "load.force" not in known.inputs:
            raise ValueError("this rig has no actuator load.force")
        return step

    @property
    def target(self) -> str:
        """The actuator that is moved."""
        return "load.force"


class Ramp(Section):
    """Move the actuator `target` linearly to `to` within `over`."""

    step: Literal["ramp"]
    target: Annotated[str, _of("actuator", "inputs")]
    to: Annotated[float, _like("target", "inputs")]
    over: Nanoseconds


class Hold(Section):
    """Let time pass."""

    step: Literal["hold"]
    time: Nanoseconds


Level = Annotated[float | None, _like("sensor", "sensors")]


class Wait(Section):
    """Wait for a condition on a sensor, tested at every frame with the latest sample.

    above, below   the sample is beyond the value
    quiet          half the peak-to-peak within the last `window` is below the value
    settled        the maxima of the last two windows agree within the value, and so do the minima

    After `timeout` the protocol continues, or with `otherwise = "stop"` ends the run.
    """

    step: Literal["wait"]
    sensor: Annotated[str, _of("sensor", "sensors")]
    above: Level = None
    below: Level = None
    quiet: Level = None
    settled: Level = None
    window: Nanoseconds = DEFAULT_WINDOW
    timeout: Nanoseconds = DEFAULT_TIMEOUT
    otherwise: Literal["go on", "stop"] = "go on"

    @model_validator(mode="after")
    def _one_condition(self) -> Self:
        given = [name for name in CONDITIONS if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"needs one of {', '.join(CONDITIONS)}; given: {', '.join(given) or 'none'}")
        if self.limit <= 0.0 and self.condition in ("quiet", "settled"):
            raise ValueError(f"{self.condition} is an amplitude and must be greater than 0")
        return self

    @property
    def condition(self) -> str:
        """The condition: above, below, quiet or settled."""
        return next(name for name in CONDITIONS if getattr(self, name) is not None)

    @property
    def limit(self) -> float:
        """The value of the condition, in the unit of the sensor."""
        return float(getattr(self, self.condition))


class Mark(Section):
    """Write `text` into the recording."""

    step: Literal["mark"]
    text: str


class Knock(Section):
    """Change the momentum of the body by `impulse`: at once, or by a half sine of force that takes `duration`."""

    step: Literal["knock"]
    impulse: Impulse
    duration: Nanoseconds | None = None


class Track(DataFile):
    """What actuators follow: their values at the frames of a step. Its text is the base name of the recording.

    `content`: float64, little-endian, [actuators, frames + 1], in SI. `about`: the frame [ns], the time of the
    recording at which the step begins [s], and `note`: what was bridged, in words.
    """

    READER = "rig.record.track:track"
    """What reads it from a recording, in a room above this one."""

    @property
    def frame_ns(self) -> int:
        """Distance of the values [ns]."""
        return int(self.about["frame_ns"])

    def values(self, actuators: int) -> np.ndarray[Any, np.dtype[np.float64]]:
        """The values [actuators, frames + 1]."""
        return np.frombuffer(self.content, "<f8").reshape(actuators, -1)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        to_json = core_schema.plain_serializer_function_ser_schema(cls.to_json, when_used="json")
        return core_schema.with_info_plain_validator_function(cls._followed, serialization=to_json)

    @classmethod
    def _followed(cls, value: Any, info: ValidationInfo) -> Track:
        known = info.context
        channels = info.data.get("channels")
        if not isinstance(value, str) or isinstance(value, cls):
            return cls._from(value)
        if known is None:
            raise ValueError("expected the values that a recording contains")
        if not known.whole or channels is None or not {"begin", "end"} <= info.data.keys():
            return cls.of("unread", b"")  # the fault is reported elsewhere
        module, _, name = cls.READER.partition(":")
        units = {actuator: known.inputs[actuator] for actuator in channels}
        read = getattr(importlib.import_module(module), name)
        content, about = read(value, channels, units, info.data["begin"], info.data["end"], known.frame_ns)
        return cls.of(Path(value).name, content, about)


def _followable(channels: dict[str, str], info: ValidationInfo) -> dict[str, str]:
    if not channels:
        raise ValueError('expected actuators with their channels, such as {"drive.speed" = "belt_speed"}')
    for actuator in channels:
        _named(actuator, f"actuator {actuator}", info, "inputs")
    return channels


class Follow(Section):
    """Let actuators follow channels of a recording, or sensors: a straight line from one frame to the next.

    channels   actuator -> channel of the recording, or sensor in the unit of the actuator
    begin, end   times of the recording [s]; by default the first and the last time that all channels have
    file       the recording; its values at the frames are interpolated linearly between samples
    time       instead of a recording: how long they follow the latest measurements
    """

    step: Literal["follow"]
    channels: Annotated[dict[str, str], AfterValidator(_followable)]
    begin: Length | None = None
    end: Length | None = None
    file: Track | None = None
    time: Nanoseconds | None = None

    @model_validator(mode="after")
    def _one_source(self, info: ValidationInfo) -> Self:
        if (self.file is None) is (self.time is None):
            raise ValueError("needs a file, or the time for which it follows sensors")
        if self.time is not None and (self.begin, self.end) != (None, None):
            raise ValueError("begin and end are times of a recording; state time alone to follow sensors")
        known = info.context
        if self.time is None or known is None or not known.whole:
            return self
        for actuator, sensor in self.channels.items():
            unit = known.sensors.get(_named(sensor, f"sensor {sensor}", info, "sensors"))
            if unit != known.inputs[actuator]:
                raise ValueError(f"{sensor} is in {unit}, {actuator} in {known.inputs[actuator]}")
        return self

    @property
    def duration(self) -> int:
        """Whole frames of the recording [ns]; 0 without one."""
        if self.file is None:
            return 0
        frames = len(self.file.content) // (8 * len(self.channels)) - 1
        return max(frames, 0) * self.file.frame_ns if self.file.content else 0


class Set(Section):
    """Set an actuator, a parameter of the rig (`friction.mu_dynamic`) or of a controller (`controllers.nf.gain`)."""

    step: Literal["set"]
    target: Annotated[str, _of("key", "inputs", "settable")]
    to: Annotated[float, _like("target", "inputs", "settable"), _SWITCHED]


class Connect(Section):
    """Connect a controller. A controller that the protocol connects is disconnected at the start."""

    step: Literal["connect"]
    controller: Annotated[str, _of("controller", "controllers")]


class Disconnect(Section):
    """Disconnect a controller."""

    step: Literal["disconnect"]
    controller: Annotated[str, _of("controller", "controllers")]


def _times(value: Any) -> Any:
    if value != "forever" and (isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= 1_000_000):
        raise ValueError('expected a whole number above 0 and at most 1000000, or "forever"')
    return value


Times = Annotated[int | Literal["forever"], BeforeValidator(_times)]


class Repeat(Section):
    """Carry out `steps` a number of `times`."""

    step: Literal["repeat"]
    times: Times
    steps: tuple[Step, ...]

    @model_validator(mode="after")
    def _takes_time(self) -> Self:
        if self.times == "forever" and not any(map(duration_ns, flat(self.steps))):
            raise ValueError("steps repeated forever must take time: add a hold")
        return self


Step = Annotated[
    Load | Ramp | Hold | Wait | Mark | Knock | Follow | Set | Connect | Disconnect | Repeat, Field(discriminator="step")
]
STEP: TypeAdapter[Step] = TypeAdapter(Step, config=_LATER)
STEPS: TypeAdapter[tuple[Step, ...]] = TypeAdapter(tuple[Step, ...], config=_LATER)


def flat(steps: Iterable[Any]) -> Iterator[Any]:
    """All steps; those inside a repeat once."""
    for step in steps:
        yield step
        if isinstance(step, Repeat):
            yield from flat(step.steps)


def duration_ns(step: Section, waits: bool = False) -> int:
    """Duration of a step [ns]; 0 for a repeat. `waits`: a wait counts with its timeout, else with 0."""
    names = ("over", "time", "duration", *(("timeout",) if waits else ()))
    return sum(getattr(step, name, None) or 0 for name in names)


def recorded(step: Any) -> bool:
    """Whether a step follows a recording."""
    return isinstance(step, Follow) and step.file is not None


def targets(step: Any) -> tuple[str, ...]:
    """The actuators and parameters that a step sets or moves."""
    if isinstance(step, Follow):
        return tuple(step.channels)
    return (step.target,) if isinstance(step, Load | Ramp | Set) else ()


def moves(step: Any) -> bool:
    """Whether a step moves its actuators linearly."""
    return isinstance(step, Follow) or (isinstance(step, Load | Ramp) and step.over > 0)


def extremes(step: Any, target: str) -> tuple[float, float]:
    """The smallest and the largest value that a step gives to one of its `targets`; NaN where only the run shows it."""
    if isinstance(step, Follow):
        if step.file is None:
            return math.nan, math.nan
        values = step.file.values(len(step.channels))[list(step.channels).index(target)]
        return float(values.min()), float(values.max())
    value = float(step.force if isinstance(step, Load) else step.to)
    return value, value


def knock_durations(steps: Iterable[Section]) -> tuple[int, ...]:
    """Durations [ns] of the knocks that take time, in ascending order, each once."""
    return tuple(sorted({step.duration for step in flat(steps) if isinstance(step, Knock) and step.duration}))
