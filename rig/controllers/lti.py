"""A linear controller from a file, from matrices in the scene, or from python-control.

    v = nominal + gain (C x + D y),  u = v within the limits,  x(k+1) = A x + B y + L (u - v) / gain

y: measurements in the order of `reads`; u: commands in the order of `drives`. L keeps the state from winding up while a
command is at a limit (rig.controllers.blocks.discretise). A continuous system is discretised when the scene is
read: scene and recording contain the discrete matrices, and need the file no more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from annotated_types import Gt
from pydantic import Strict, field_validator, model_validator

from rig.controllers.blocks import discretise, system_file
from rig.controllers.blocks.base import ControllerSection, Numbers, OptionalHertz, Update, Values, dot, mapped
from rig.controllers.blocks.design import Actuator, Linear, Rig
from rig.errors import UsageError
from rig.quantities import Number, finite, nanoseconds

Rows = tuple[tuple[float, ...], ...]
Levels = tuple[Annotated[float, Strict()] | str, ...]
MATRICES = ("A", "B", "C", "D", "L")
_PERIOD = 1e-9 * ControllerSection.model_fields["period"].default


class LTI(ControllerSection):
    """A linear controller; matrices stated in a scene are discrete, with the period of the controller.

    file       linear system: .json, .npz or .mat, from the folder of the scene
    method     discretisation of a continuous system: tustin (default), zoh, foh, impulse, euler, backward_diff
    prewarp    frequency at which the method tustin is exact
    reads      sensors in the order of the inputs, by default those named like the inputs
    drives     actuators in the order of the outputs, by default those named like the outputs
    gain       factor of the linear part [chosen]
    nominal    command without a measurement, by default the value of the actuator at the start; one for all or one each
    lowest, highest   limits of the command, by default the range of the actuator; one for all or one each
    A, B, C, D   matrices, row by row
    L          gain of the anti-windup, by default computed
    """

    fixed: ClassVar[frozenset[str]] = ControllerSection.fixed | {
        "file",
        "method",
        "prewarp",
        "reads",
        "drives",
        *MATRICES,
    }
    files: ClassVar[tuple[str, ...]] = tuple(system_file.READERS)

    kind: Literal["lti"]
    file: str = ""
    method: Literal["zoh", "foh", "tustin", "impulse", "euler", "backward_diff"] | None = None
    prewarp: OptionalHertz = None
    reads: tuple[str, ...] = ()
    drives: tuple[str, ...] = ()
    gain: Number = 1.0
    nominal: Levels | None = None
    lowest: Levels | None = None
    highest: Levels | None = None
    A: Rows = ()
    B: Rows = ()
    C: Rows = ()
    D: Rows = ()
    L: Rows = ()

    @model_validator(mode="before")
    @classmethod
    def _with_system(cls, raw: Any) -> Any:
        """Read the file, and compute what follows from the matrices."""
        if not isinstance(raw, Mapping) or "L" in raw:  # a recording
            return raw
        if "D" in raw:
            matrices = {key: raw[key] for key in "ABCD" if key in raw}
            given = system_file.system({**matrices, "dt": _period(raw) or _PERIOD}, "the matrices")
        elif raw.get("file"):
            given = system_file.read(Path(str(raw["file"])))
        else:
            raise ValueError("file: is missing, and so are the matrices A, B, C, D; state one of them")
        return {**raw, **table(given, raw)}

    @field_validator("reads", "drives", mode="before")
    @classmethod
    def _listed(cls, given: Any) -> Any:
        """A single name, or several with commas between them, as a list."""
        return [name.strip() for name in given.split(",")] if isinstance(given, str) else given

    @field_validator("nominal", "lowest", "highest", mode="before")
    @classmethod
    def _each(cls, given: Any) -> Any:
        """A single level as a list of one; a text that is a number as this number."""
        levels = given if isinstance(given, list | tuple) or given is None else [given]
        return levels and [_number(level) for level in levels]

    @model_validator(mode="after")
    def _fits(self) -> LTI:
        outputs = len(self.D)
        inputs = len(self.D[0]) if self.D else 0
        faults = []
        for key, names, count in (("reads", self.reads, inputs), ("drives", self.drives, outputs)):
            what = "inputs" if key == "reads" else "outputs"
            if not names:
                faults.append(f"{key}: is missing, and the system does not name its {count} {what}")
            elif len(names) != count or len({*names}) != count:
                faults.append(f"{key}: names {', '.join(names)}; expected {count} different ones, for the {what}")
        for key in ("nominal", "lowest", "highest"):
            levels = getattr(self, key)
            if levels is not None and len(levels) not in (1, outputs):
                faults.append(f"{key}: has {len(levels)} values; expected one, or one for each of {outputs} outputs")
        if faults:
            raise ValueError("; ".join(faults))
        return self


def _number(given: Any) -> Any:
    try:
        return float(given) if isinstance(given, str) else given
    except ValueError:  # with a unit
        return given


def _period(raw: Mapping[str, Any]) -> float | None:
    """The period that a table states [s], or that of every controller; None for one that is no duration."""
    try:
        return nanoseconds(raw["period"]) * 1e-9 if "period" in raw else _PERIOD
    except ValueError:
        return None


def table(given: system_file.System, raw: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of the table `raw` that follow from a linear system."""
    own: dict[str, Any] = {}
    if given.dt and "period" not in raw:
        own["period"] = given.dt
        if abs(given.dt * 1e9 - round(given.dt * 1e9)) > 1e-3:
            raise ValueError(f"period: the system has dt = {given.dt!r} s, which is not a whole number of nanoseconds")
    if not given.dt and raw.get("method") is None:
        own["method"] = discretise.DEFAULT
    method = {**raw, **own}.get("method")
    period = _period({**raw, **own})
    try:
        prewarp = None if raw.get("prewarp") is None else finite(raw["prewarp"], "Hz", Gt(0.0))
        known = period is not None and (method is None or method in discretise.METHODS)
    except ValueError:
        known = False
    if known and period is not None:
        made = discretise.discrete(given, period, method, prewarp)
    else:  # the declaration of the key at fault reports it
        made = discretise.Discrete(*given[:4], np.zeros((len(given.A), len(given.D))))
    for name, matrix in zip(MATRICES, made):
        own[name] = [list(map(float, row)) for row in matrix]
    if raw.get("file"):
        own["file"] = Path(str(raw["file"])).name
    # python-control has no dots in names: load_force is load.force
    drives = [name if "." in name else name.replace("_", ".", 1) for name in given.outputs]
    names = {"reads": given.inputs, "drives": drives}
    return own | {key: list(labels) for key, labels in names.items() if labels and not raw.get(key)}


def of_python_control(given: Any, **keys: Any) -> LTI:
    """The section of a StateSpace or TransferFunction of python-control; `keys`: others of the table.

    Raises ValueError for a system that cannot be a controller.
    """
    return LTI.model_validate({"kind": "lti", **keys, **table(system_file.of_control(given), keys)})


class Constants(NamedTuple):
    """The constants of the controller: discrete matrices, gain and its inverse (0 for none), levels of the commands."""

    a: Rows
    b: Rows
    c: Rows
    d: Rows
    back: Rows
    gain: float
    inverse: float
    nominal: Values
    low: Values
    high: Values


def _free(nominal: float, c: Values, d: Values, gain: float, state: Values, values: Values) -> float:
    return nominal + gain * (dot(c, state) + dot(d, values))


def _within(free: float, low: float, high: float) -> float:
    if free < low:
        return low
    return high if free > high else free


def _cut(given: float, free: float, inverse: float) -> float:
    return inverse * (given - free)


def _after(a: Values, b: Values, back: Values, state: Values, values: Values, cut: Values) -> float:
    return dot(a, state) + dot(b, values) + dot(back, cut)


def law(p: Constants, state: Values, t_ns: int, values: Values) -> tuple[Values, Values]:
    """Next state, and the commands [unit of each actuator]."""
    free: Values = mapped(p.nominal, _free, (p.gain, state, values), p.nominal, p.c, p.d)
    given: Values = mapped(free, _within, (), free, p.low, p.high)
    cut: Values = mapped(free, _cut, (p.inverse,), given, free)
    return mapped(state, _after, (state, values, cut), p.a, p.b, p.back), given


class LinearController:
    """The controller. Its state is that of the linear system."""

    update: Update

    def __init__(self, section: LTI, numbers: Numbers) -> None:
        self.section = section
        self.numbers = numbers
        self.reads = section.reads
        self.drives = section.drives
        self.period_ns = section.period
        matrices = section.A, section.B, section.C, section.D, section.L
        count = len(self.drives)
        units = numbers.get("unit", (None,) * count)
        nominal = self._levels("nominal", units, numbers.get("value", (0.0,) * count))
        low = self._levels("lowest", units, numbers.get("low", (-np.inf,) * count))
        high = self._levels("highest", units, numbers.get("high", (np.inf,) * count))
        inverse = 1.0 / section.gain if section.gain else 0.0
        self.constants = Constants(*matrices, section.gain, inverse, nominal, low, high)
        self.update = partial(law, self.constants)
        for drive, lowest, level, highest in zip(self.drives, low, nominal, high):
            if not lowest < highest:
                raise UsageError(f"highest: is {highest:g} for {drive}, not above lowest = {lowest:g}")
            if not lowest <= level <= highest:
                raise UsageError(f"nominal: is {level:g} for {drive}, outside {lowest:g} to {highest:g}")

    @property
    def parameter_units(self) -> dict[str, str]:
        """See `base.tunable`: the unit of the levels, if that of all actuators is known and the same."""
        known = {*self.numbers.get("unit", ())}
        return dict.fromkeys(("nominal", "lowest", "highest"), *known) if len(known) == 1 else {}

    def _levels(self, key: str, units: Sequence[str | None], default: Sequence[float]) -> Values:
        """One level for each actuator, in its unit."""
        levels = getattr(self.section, key)
        if levels is None:
            levels = tuple(default)
        elif len(levels) == 1:
            levels = levels * len(self.drives)
        values = []
        for level, drive, unit in zip(levels, self.drives, units):
            if isinstance(level, str) and unit is None:
                raise UsageError(f"{key}: is {level!r}; the unit of {drive} is not known here, state a number in SI")
            try:
                values.append(finite(level, unit or "1") if isinstance(level, str) else float(level))
            except ValueError as fault:
                raise UsageError(f"{key}: {fault}, the unit of {drive}") from None
        return tuple(values)

    @staticmethod
    def design(rig: Rig, section: LTI) -> dict[str, Any]:
        """Unit, value at the start and range of each actuator."""
        actuators = {drive: rig.actuator(drive) for drive in section.drives}
        if missing := [drive for drive, actuator in actuators.items() if actuator is None]:
            raise ValueError(f"drives: the rig has no actuator {', '.join(missing)}")
        numbers = dict(zip(Actuator._fields, map(list, zip(*filter(None, actuators.values())))))
        try:
            LinearController(section, numbers)
        except UsageError as fault:
            raise ValueError(str(fault)) from None
        return numbers

    def linear(self) -> Linear:
        """See `Linear`; for one input and one output."""
        p = self.constants

        def step(xi: Sequence[float], y: float) -> tuple[Sequence[float], float]:
            x = tuple(xi)
            after = [dot(a, x) + dot(b, (y,)) for a, b in zip(p.a, p.b)]
            return after, p.gain * (dot(p.c[0], x) + dot(p.d[0], (y,)))

        return Linear(len(p.a), step, gain="gain")

    def start(self) -> Values:
        """The state at rest."""
        return (0.0,) * len(self.constants.a)
