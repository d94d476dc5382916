"""The steps of an experiment, as a scene declares them; `rig.bench` carries them out, on ticks, inside the plant.

    load         press with `force`, reached after `over`
    ramp         an actuator runs linearly to a value within `over`
    hold         nothing changes for `time`
    wait         until a measured signal is above or below a value, quiet or settled; at most `timeout`
    mark         write a line into the recording
    knock        an impulse on the body, along the sliding direction at the contact
    set          an actuator, a parameter of the rig or of a controller takes a value at once
    connect      the commands of a controller reach its actuators from here on
    disconnect   they no longer do; the actuators go back to what the protocol asked for last
    repeat       steps, several times or "forever"

A value takes the unit of what it changes or compares, so texts with units need to know the rig: the loader hands
`Known` over as validation context. Without it only SI numbers are read (a scene that comes back from a recording).
Times are whole nanoseconds.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any, Literal, Self

from annotated_types import Ge, Le
from pydantic import BeforeValidator, Field, PlainSerializer, ValidationInfo, field_validator, model_validator

from rig.quantities import LONGEST, Nanoseconds, PositiveNewton, Range, Section, Unit, finite, nanoseconds, quantity, si
from rig.scenes.faults import near

Length = Annotated[
    int,
    Unit("s"),
    BeforeValidator(partial(nanoseconds, within=Range("s", (Ge(0.0),)))),
    Ge(0),
    Le(LONGEST),
    PlainSerializer(lambda ns: ns / 1e9),
]
Impulse: Any = quantity("N*s")
DEFAULT_TIMEOUT = 60_000_000_000
DEFAULT_WINDOW = 1_000_000_000


@dataclass(frozen=True)
class Known:
    """What a protocol may name: actuators, further keys that may be set, sensors, each with its unit; controllers."""

    inputs: Mapping[str, str] = field(default_factory=dict)
    settable: Mapping[str, str] = field(default_factory=dict)
    sensors: Mapping[str, str] = field(default_factory=dict)
    controllers: frozenset[str] = frozenset()
    whole: bool = True
    """False for a rig that could not be built: any name is taken then, and values are not read."""


UNKNOWN = Known(whole=False)


def _named(value: str, what: str, info: ValidationInfo, *rooms: str) -> str:
    """A name that stands in one of the `rooms` of the rig."""
    told = info.context
    if told is not None and told.whole:
        names = {name for room in rooms for name in getattr(told, room)}
        if value not in names:
            raise ValueError(f"unknown {what}; {near(value, names)}")
    return value


def _read(value: Any, field: str, info: ValidationInfo, *rooms: str) -> Any:
    """A value in the unit of what `field` names; a name that is wrong is reported by itself."""
    if value is None:
        return None
    told, name = info.context, info.data.get(field, "")
    if told is None:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError("expected a number in SI")
        return value
    if "inputs" in rooms and name in told.inputs:
        return si(value, told.inputs[name])  # what an actuator takes is told by rig.scenes.checks.commanded
    unit = next((getattr(told, room)[name] for room in rooms if name in getattr(told, room)), None)
    return 0.0 if unit is None else finite(value, unit)


class Load(Section):
    """Press the bodies together; the magnet's force runs linearly to `force` within `over`."""

    step: Literal["load"]
    force: PositiveNewton
    over: Length = 0

    @field_validator("step")
    @classmethod
    def _loadable(cls, step: str, info: ValidationInfo) -> str:
        told = info.context
        if told is not None and told.whole and "load.force" not in told.inputs:
            raise ValueError("this rig has no actuator load.force")
        return step

    @property
    def target(self) -> str:
        """The actuator that is moved."""
        return "load.force"


class Ramp(Section):
    """Run the actuator `target` linearly to `to` within `over`."""

    step: Literal["ramp"]
    target: str
    to: float
    over: Nanoseconds

    @field_validator("target")
    @classmethod
    def _known(cls, target: str, info: ValidationInfo) -> str:
        return _named(target, "actuator", info, "inputs")

    @field_validator("to", mode="before")
    @classmethod
    def _in_unit(cls, to: Any, info: ValidationInfo) -> Any:
        return _read(to, "target", info, "inputs")


class Hold(Section):
    """Let time pass."""

    step: Literal["hold"]
    time: Nanoseconds


class Wait(Section):
    """Wait for a measured signal, judged at every frame with the latest sample.

    above, below   the sample is beyond the value
    quiet          half the peak-to-peak within the last `window` is below the value
    settled        highest and lowest of the last two windows, laid end to end, agree within the value

    After `timeout` the protocol goes on, or with `otherwise = "stop"` ends the run.
    """

    step: Literal["wait"]
    sensor: str
    above: float | None = None
    below: float | None = None
    quiet: float | None = None
    settled: float | None = None
    window: Nanoseconds = DEFAULT_WINDOW
    timeout: Nanoseconds = DEFAULT_TIMEOUT
    otherwise: Literal["go on", "stop"] = "go on"

    @field_validator("sensor")
    @classmethod
    def _known(cls, sensor: str, info: ValidationInfo) -> str:
        return _named(sensor, "sensor", info, "sensors")

    @field_validator("above", "below", "quiet", "settled", mode="before")
    @classmethod
    def _in_unit(cls, value: Any, info: ValidationInfo) -> Any:
        return _read(value, "sensor", info, "sensors")

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
        """Which of above, below, quiet, settled is asked for."""
        return next(name for name in CONDITIONS if getattr(self, name) is not None)

    @property
    def limit(self) -> float:
        """The value of the condition, in the unit of the sensor."""
        return float(getattr(self, self.condition))


CONDITIONS = ("above", "below", "quiet", "settled")


class Mark(Section):
    """Write `text` into the recording."""

    step: Literal["mark"]
    text: str


class Knock(Section):
    """Change the momentum of the body at once, as a hammer does."""

    step: Literal["knock"]
    impulse: Impulse


class Set(Section):
    """An actuator, a parameter of the rig (`friction.mu_dynamic`) or of a controller (`controllers.nf.gain`)."""

    step: Literal["set"]
    target: str
    to: float

    @field_validator("target")
    @classmethod
    def _known(cls, target: str, info: ValidationInfo) -> str:
        return _named(target, "key", info, "inputs", "settable")

    @field_validator("to", mode="before")
    @classmethod
    def _in_unit(cls, to: Any, info: ValidationInfo) -> Any:
        if isinstance(to, bool):
            return float(to)
        return _read(to, "target", info, "inputs", "settable")


class _Connection(Section):
    step: str
    controller: str

    @field_validator("controller")
    @classmethod
    def _known(cls, controller: str, info: ValidationInfo) -> str:
        return _named(controller, "controller", info, "controllers")


class Connect(_Connection):
    """Connect a controller. One that the protocol connects is not connected before."""

    step: Literal["connect"]


class Disconnect(_Connection):
    """Disconnect a controller."""

    step: Literal["disconnect"]


def _times(value: Any) -> Any:
    if value != "forever" and (isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= 1_000_000):
        raise ValueError('expected a whole number above 0 and at most 1000000, or "forever"')
    return value


Times = Annotated[int | Literal["forever"], BeforeValidator(_times)]


class Repeat(Section):
    """Carry `steps` out `times` times."""

    step: Literal["repeat"]
    times: Times
    steps: tuple[Step, ...]

    @model_validator(mode="after")
    def _takes_time(self) -> Self:
        if self.times == "forever" and least_ns(self.steps) == 0:
            raise ValueError("steps repeated forever must take time: add a hold")
        return self


Step = Annotated[
    Load | Ramp | Hold | Wait | Mark | Knock | Set | Connect | Disconnect | Repeat, Field(discriminator="step")
]
Repeat.model_rebuild()


def flat(steps: Iterable[Section]) -> Iterator[Section]:
    """Every step, those inside a repeat once."""
    for step in steps:
        yield step
        if isinstance(step, Repeat):
            yield from flat(step.steps)


def longest_ns(steps: Iterable[Section]) -> int | None:
    """Time the steps take at most, waits up to their timeout; None where they never end."""
    total = 0
    for step in steps:
        if isinstance(step, Repeat):
            inner = longest_ns(step.steps)
            if inner is None or step.times == "forever":
                return None
            total += inner * step.times
        else:
            total += _length(step, "timeout")
    return total


def least_ns(steps: Iterable[Section]) -> int:
    """Time the steps take at least, waits not at all; a repeat counted once."""
    return sum(least_ns(s.steps) if isinstance(s, Repeat) else _length(s, "") for s in steps)


def _length(step: Section, wait: str) -> int:
    return sum(getattr(step, name, 0) for name in ("over", "time", wait) if name)
