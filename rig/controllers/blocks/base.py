"""The protocol of controllers: a pure object that computes commands from measurements.

A controller contains only numbers. `update` takes its state and returns the next one, so the same object works in a
sweep in one process, in its own process on the bus, in a replay and in a property test:

    state, commands = controller.update(state, t_ns, values)

`values` [unit of each sensor] are in the order of `reads`, commands [unit of each actuator] in the order of `drives`;
t_ns is simulated time. Values are finite, which `loop.Loop` ensures.

A controller with `every_sample = True` gets a tuple of all samples of each sensor published in the last frame, instead
of the latest one; its period is one frame. In this way a loop at 1 kHz reads a sensor at 50 kHz.

A controller with `elsewhere = True` has its law on other hardware, whose memory nobody else sees
(rig.controllers.device): it is called once a step and never for a trial. Without an answer it returns () as commands.

A controller whose class takes `(section, numbers)` and stores the section can be retuned during a run.

A controller whose `update` is `functools.partial(law, constants)` can be compiled (`runtime.native`): the control law
`law(constants, state, t_ns, values)` is a function of a module, constants and state are (named) tuples of numbers.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import repeat
from typing import Any, ClassVar, Generic, Literal, Protocol, TypeVar, runtime_checkable

from annotated_types import Ge, Gt, Le, Lt
from pydantic import ValidationError

from rig.errors import UsageError
from rig.quantities import Nanoseconds, Section, duration, faults_of, optional, quantity, unit_of
from rig.units import brief

Numbers = Mapping[str, Any]
Values = tuple[float, ...]
Samples = tuple[Sequence[float], ...]
State = Any
Update = Callable[[Any, int, Any], tuple[Any, Values]]
"""Type of `update` where it is `functools.partial(law, constants)`."""
Delay: Any = duration(0)
OptionalSpeed = optional("m/s", Ge(0.0))
OptionalHertz = optional("Hz", Gt(0.0))
OptionalForce = optional("N", Ge(0.0))
OptionalSecond = optional("s", Gt(0.0))
Fraction = quantity("1", Gt(0.0), Lt(1.0))
Gain = quantity("V*s/m", Gt(0.0))
Margin = quantity("1", Ge(1.0))
Ahead = quantity("s", Ge(0.0), Le(1.0))
ForcePerSpeed = quantity("N*s/m")

Entry = TypeVar("Entry", float, complex)


@runtime_checkable
class Controller(Protocol):
    """A controller that reads sensors and drives actuators every `period_ns` of simulated time."""

    @property
    def reads(self) -> tuple[str, ...]:
        """Names of the sensors that it reads."""

    @property
    def drives(self) -> tuple[str, ...]:
        """Names of the actuators that it drives."""

    @property
    def period_ns(self) -> int:
        """Time between two updates [ns]."""

    def start(self) -> State:
        """The state before the first update."""

    def update(self, state: State, t_ns: int, values: Values) -> tuple[State, Values]:
        """Next state, and commands for the measurements of time t_ns [ns]; `state` itself is not changed."""


C = TypeVar("C", bound=Controller)


class ControllerSection(Section):
    """The keys of every controller of a scene: period, additional delay of its loop, process in which it works.

    `fixed`: keys that a run cannot change, among them the names of a sensor and an actuator that most sections have.
    where     process in a live run: "process" (its own, over the bus) or "plant" (the process of the plant) [chosen]
    """

    fixed: ClassVar[frozenset[str]] = frozenset({"kind", "period", "delay", "where", "sensor", "drive"})
    files: ClassVar[tuple[str, ...]] = ()
    """Suffixes of files that this kind reads, if the key `file` names one."""

    period: Nanoseconds = 1_000_000
    delay: Delay = 0
    where: Literal["process", "plant"] = "process"


S = TypeVar("S", bound=ControllerSection)


class SceneController(Generic[S]):
    """What a controller of a scene stores; it reads the sensor and drives the actuator that its section names."""

    reads: tuple[str, ...]
    drives: tuple[str, ...]

    def __init__(self, section: S, numbers: Numbers) -> None:
        self.section = section
        self.numbers = numbers
        self.period_ns = section.period
        if hasattr(section, "sensor"):
            self.reads = (section.sensor,)
        if hasattr(section, "drive"):
            self.drives = (section.drive,)


def require(numbers: Numbers, keys: Iterable[str], what: str = "needs numbers of the design step") -> None:
    """Raise UsageError if the design step has not given these numbers."""
    if missing := [key for key in keys if key not in numbers]:
        raise UsageError(f"{what}; missing: {', '.join(missing)}")


def retune(controller: C, changes: Mapping[str, object]) -> C:
    """The same controller with all of `changes` to its parameters. Raises UsageError with the faults of all changes.

    The new controller continues from the state of the old one.
    """
    section = getattr(controller, "section", None)
    if not isinstance(section, Section):
        raise UsageError(f"{type(controller).__name__} has no parameters to tune: it has no attribute section")
    known = type(section).model_fields
    fixed: frozenset[str] = getattr(section, "fixed", frozenset())
    faults = [f"{key:.80}: no such parameter{_near(key, known)}" for key in changes if key not in known]
    faults += [f"{key}: is fixed while the rig runs" for key in changes if key in fixed]
    possible = {key: value for key, value in changes.items() if key in known and key not in fixed}
    try:
        changed = type(section).model_validate({**section.model_dump(), **possible})
    except ValidationError as error:
        faults += explain(error)
    if faults:
        raise UsageError("\n".join(faults))
    return type(controller)(changed, getattr(controller, "numbers", {}))  # type: ignore[call-arg]


def gets_every_sample(controller: Controller | type) -> bool:
    """Whether a controller gets every sample of its sensors, not only the latest one of a frame."""
    return bool(getattr(controller, "every_sample", False))


def is_elsewhere(controller: Controller | type) -> bool:
    """Whether the law of a controller runs on other hardware, so that no trial may call it."""
    return bool(getattr(controller, "elsewhere", False))


def parameters(controller: Controller) -> dict[str, Any]:
    """The parameters of a controller as plain values; empty if it has no section."""
    section = getattr(controller, "section", None)
    return section.model_dump() if isinstance(section, Section) else {}


def tunable(controller: Controller) -> dict[str, str]:
    """Parameters that `retune` can change -> their units; `parameter_units` of a controller adds to those declared."""
    section = getattr(controller, "section", None)
    if not isinstance(section, Section):
        return {}
    fixed: frozenset[str] = getattr(section, "fixed", frozenset())
    units = {key: unit_of(type(section), key) for key in type(section).model_fields if key not in fixed}
    return units | getattr(controller, "parameter_units", {})


def explain(error: ValidationError) -> list[str]:
    """One line for each fault of a section: key, fault, given value."""
    shown = {"is missing": ""}  # what was given is then the whole section
    lines = []
    for key, fault, given in faults_of(error):
        value = shown.get(fault, f" (given: {brief(given)})")
        lines.append(f"{key or 'the parameters'}: {fault}{value}")
    return lines


def _near(key: str, known: Mapping[str, object]) -> str:
    near = difflib.get_close_matches(key, known, n=3)
    return f"; near: {', '.join(near)}" if near else f"; known: {', '.join(known)}"


def mapped(like: tuple[Entry, ...], entry: Callable[..., Entry], given: tuple[Any, ...], *columns: Any) -> Any:
    """The tuple of `entry(a, b, ..., *given)` for the entries a, b, ... of the columns, in turn.

    `like`: a tuple of equal length and type. Compiled code has a function of its own for this.
    """
    return tuple(map(entry, *columns, *map(repeat, given)))


def dot(a: Values, b: Values) -> float:
    """The sum of products in this order; compiled code has its own for tuples without entries."""
    total = 0.0
    for x, y in zip(a, b):  # `sum` rounds differently in newer Python versions
        total += x * y
    return total
