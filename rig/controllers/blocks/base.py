"""What a controller is: a pure object that turns measurements into commands, and nothing else.

A controller holds numbers only. Its state goes in and comes out of `update`, so that the same object serves a sweep
in one process, a process of its own on the bus, a replay and a property test:

    state, commands = controller.update(state, t_ns, values)

`values` [unit of each sensor] come in the order of `reads`, commands [unit of each actuator] go out in the order of
`drives`, t_ns is simulated time. Values are finite: `loop.Loop`, which runs a controller, sees to that.

A controller with `every_sample = True` gets, in place of the latest sample of each sensor, all that were published in
the last frame, as a tuple; its period is one frame. A sensor at 50 kHz is heard so by a loop at 1 kHz.

A controller whose class takes `(section, numbers)` and keeps the section can be retuned while it works.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal, Protocol, TypeVar, runtime_checkable

from annotated_types import Ge, Gt, Le, Lt
from pydantic import ValidationError

from rig.errors import UsageError
from rig.quantities import Nanoseconds, Section, brief, duration, optional, quantity, unit_of

Numbers = Mapping[str, Any]
Values = tuple[float, ...]
Samples = tuple[Sequence[float], ...]
State = Any


@runtime_checkable
class Controller(Protocol):
    """State in, state out; reads sensors, drives actuators, every `period_ns` of simulated time."""

    @property
    def reads(self) -> tuple[str, ...]:
        """Names of the sensors read."""

    @property
    def drives(self) -> tuple[str, ...]:
        """Names of the actuators driven."""

    @property
    def period_ns(self) -> int:
        """Time between two updates [ns]."""

    def start(self) -> State:
        """The state before the first update."""

    def update(self, state: State, t_ns: int, values: Values) -> tuple[State, Values]:
        """State and commands after the measurements of time t_ns; `state` itself is not changed."""


C = TypeVar("C", bound=Controller)

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


class ControllerSection(Section):
    """What every controller of a scene states: its period, the delay that the stand adds to its loop, where it works.

    where     works in a live run: "process", one of its own, over the bus, or "plant", that of the plant [chosen]
    """

    fixed: ClassVar[frozenset[str]] = frozenset({"kind", "period", "delay", "where"})

    period: Nanoseconds = 1_000_000
    delay: Delay = 0
    where: Literal["process", "plant"] = "process"


def retune(controller: C, changes: Mapping[str, object]) -> C:
    """The same controller with other parameters: all of `changes` or, with a UsageError, none of them.

    The state of the old controller fits the new one, so the loop goes on without a bump of its own making.
    """
    section = getattr(controller, "section", None)
    if not isinstance(section, Section):
        raise UsageError(f"{type(controller).__name__} has no parameters to tune: it keeps no section")
    known = type(section).model_fields
    fixed: frozenset[str] = getattr(section, "fixed", frozenset())
    faults = [f"{key:.80}: no such parameter{_near(key, known)}" for key in changes if key not in known]
    faults += [f"{key}: is fixed while the rig runs" for key in changes if key in fixed]
    try:
        changed = type(section).model_validate({**section.model_dump(), **changes})
    except ValidationError as error:
        faults += [line for line in explain(error) if line.partition(":")[0] not in changes.keys() - known.keys()]
    if faults:
        raise UsageError("\n".join(faults))
    return type(controller)(changed, getattr(controller, "numbers", {}))  # type: ignore[call-arg]


def hears(controller: Controller | type) -> bool:
    """Whether a controller gets every sample of its sensors."""
    return bool(getattr(controller, "every_sample", False))


def parameters(controller: Controller) -> dict[str, Any]:
    """The parameters of a controller, as plain values; none where it keeps no section."""
    section = getattr(controller, "section", None)
    return section.model_dump() if isinstance(section, Section) else {}


def tunable(controller: Controller) -> dict[str, str]:
    """The parameters that `retune` can change -> their units."""
    section = getattr(controller, "section", None)
    if not isinstance(section, Section):
        return {}
    fixed: frozenset[str] = getattr(section, "fixed", frozenset())
    return {key: unit_of(type(section), key) for key in type(section).model_fields if key not in fixed}


def explain(error: ValidationError) -> list[str]:
    """One line for each fault of a section: key, what is wrong."""
    lines = []
    for fault in error.errors(include_url=False):
        key = ".".join(str(part) for part in fault["loc"]) or "the parameters"
        lines.append(f"{key}: {fault['msg'].removeprefix('Value error, ')} (given: {brief(fault['input'])})")
    return lines


def _near(key: str, known: Mapping[str, object]) -> str:
    near = difflib.get_close_matches(key, known, n=3)
    return f"; near: {', '.join(near)}" if near else f"; known: {', '.join(known)}"
