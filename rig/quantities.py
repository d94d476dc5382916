"""Physical quantities of a scene: declared with unit and bounds, read from text or numbers, converted to SI.

A parameter is declared once, as a field of a `Section`:

    class Body(Section):
        mass: Kilogram
        damping: NewtonSecondPerMetre = 0.0

A value is a number (in SI units), a text with a unit ("2 rpm"), or a list [value, origin, note], whose origin says
where the value comes from. Inside the project every number is in SI units.

Every quantity has a range: its own bounds, and the sizes that are plausible for its unit (`rig.units.SIZES`).
Products of a few values within these sizes stay far below the largest double.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from functools import lru_cache, partial
from numbers import Integral
from typing import Annotated, Any, ClassVar, NamedTuple, Self

from annotated_types import Ge, Gt, Le, Lt
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    GetCoreSchemaHandler,
    PlainSerializer,
    ValidationError,
)
from pydantic_core import CoreSchema, ErrorDetails, InitErrorDetails, PydanticCustomError, core_schema

from rig.about import About
from rig.errors import UsageError
from rig.units import OTHERS, SIZES, brief, parted, si, with_point

ORIGINS = ("paper", "public", "derived", "identified", "designed", "calibrated", "chosen", "user")
LONGEST = 1_000_000_000_000_000
"""Longest duration [ns]: 1e6 s, eleven days."""

_CONDITION = re.compile(r"\s*(?P<bar>\|?)\s*(?P<name>[^<>=|]+?)\s*(?P=bar)\s*(?P<sense>[<>=])\s*(?P<level>[^<>|]+?)\s*")

BOUNDS = {
    "greater_than": ("greater than", "gt"),
    "greater_than_equal": ("at least", "ge"),
    "less_than": ("less than", "lt"),
    "less_than_equal": ("at most", "le"),
}
"""Kind of pydantic's fault of a bound -> the bound in words, its name in the context of the fault."""
_WORDS = {
    "missing": "is missing",
    "extra_forbidden": "unknown key",
    "finite_number": "must be a finite number",
    "string_type": "expected a text",
    "bool_type": "expected true or false",
    "bool_parsing": "expected true or false",
    "int_type": "expected a whole number",
    "int_parsing": "expected a whole number",
    "int_from_float": "expected a whole number",
    "float_type": "expected a number",
    "float_parsing": "expected a number",
    "model_type": "expected a table",
    "model_attributes_type": "expected a table",
    "dict_type": "expected a table",
    "tuple_type": "expected a list",
    "too_long": "has too many entries",
    "list_type": "expected a list",
}


class Unit(str):
    """Marks a field with its SI unit; `Unit("1")` is dimensionless."""


class Section(BaseModel):
    """One table of a scene. It is immutable and rejects unknown keys.

    `declares`: the description of an effect, for tables that a plant can have or not.
    """

    declares: ClassVar[About] = About()

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    def continuing(self, begun: Self) -> Self:
        """These parameters of a plant in a run that began with the parameters `begun`.

        States keep their values when a rig changes in a run. Raises ValueError where they would mean another motion.
        """
        return self

    def comparable(self, other: Self) -> bool:
        """Whether a state of the same name means the same motion in a plant with the parameters `other`."""
        return True


class Hand(NamedTuple):
    """A value that matters to a person at the bench, as a slider.

    `low`, `high`: its ends as multiples of the value of the scene, so that one declaration serves a seal as well as a
    brake. They should reach from where the rig is quiet to where it vibrates.
    """

    words: str
    low: float = 0.0
    high: float = 2.0


class Range:
    """The allowed range of a quantity of `unit`: from `low` to `high` (SI).

    The lower limit of a positive quantity is the least size of its unit. As metadata of a field a Range raises
    ValueError for all values outside.
    """

    def __init__(self, unit: str, bounds: Iterable[Gt | Ge | Lt | Le] = ()) -> None:
        least, most = SIZES.get(unit, OTHERS)
        self.unit = unit
        self.low = -most
        self.high = most
        for bound in bounds:
            if isinstance(bound, Gt):
                self.low = float(bound.gt) or least  # type: ignore[arg-type]
            elif isinstance(bound, Ge):
                self.low = float(bound.ge)  # type: ignore[arg-type]
            elif isinstance(bound, Lt):
                self.high = float(bound.lt)  # type: ignore[arg-type]
            else:
                self.high = float(bound.le)  # type: ignore[arg-type]

    def read(self, value: Any) -> float:
        """Read `value` as `si` does, without checking the range. Raises ValueError if it is not finite."""
        number = si(value, self.unit)
        if not math.isfinite(number):
            raise ValueError(f"must be a finite number, {self}")
        return number

    def check(self, value: float) -> float:
        """Return `value` if it is in the range. Raises ValueError, which states the range."""
        if self.low <= value <= self.high:
            return value
        raise ValueError(f"must be {self}")

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g}" + ("" if self.unit == "1" else f" {self.unit}")

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self.check, handler(source))


def finite(value: Any, unit: str, *bounds: Gt | Ge | Lt | Le) -> float:
    """Read `value` as `si` does and check it against `bounds` and the sizes of its unit. Raises ValueError."""
    within = Range(unit, bounds)
    return within.check(within.read(value))


def run_length_ns(duration: float | None) -> int | None:
    """The length [ns] of a run of `duration` [s]; None, which is that of its protocol, for None. Raises UsageError."""
    if duration is None:
        return None
    try:
        return round(finite(duration, "s", Gt(0.0)) * 1e9)
    except ValueError as fault:
        given = "" if isinstance(duration, str) else f" of {brief(duration)} s"
        raise UsageError(f"the duration{given} {fault}") from None


class Condition(NamedTuple):
    """A condition as its user wrote it: `name` is above (>), below (<) or at (=) a `level`, a text with a unit.

    `size`: the absolute value of `name` is compared. `option`: where the condition was given.
    """

    option: str
    name: str
    sense: str
    level: str
    size: bool

    @classmethod
    def read(cls, text: str, option: str, signs: str, expected: str) -> Self:
        """Read "NAME > VALUE UNIT", or "|NAME| > ...". `signs`: those that are allowed, of "<>=|".

        Raises UsageError, which states what is `expected`.
        """
        form = _CONDITION.fullmatch(text) if isinstance(text, str) else None
        if form is None or not {form["sense"], *form["bar"]} <= {*signs}:
            raise UsageError(f"{option} {text}: expected {expected}")
        level = with_point(form["level"], f"{option} {text}: the level")
        return cls(option, form["name"], form["sense"], level, bool(form["bar"]))

    def __str__(self) -> str:
        return f"{f'|{self.name}|' if self.size else self.name} {self.sense} {self.level}"

    def level_in(self, unit: str, plain: bool = True) -> float:
        """Return the level in `unit`; `plain`: it may be a number without a unit. Raises UsageError."""
        try:
            if plain and not parted(self.level)[1]:
                return finite(float(self.level), unit)
            return finite(self.level, unit)
        except ValueError as fault:
            raise UsageError(f"{self.option} {self}: the level {fault}") from None


def whole(name: str, value: Any, least: int, most: int) -> int:
    """Return a whole number from `least` to `most`. Raises UsageError for anything else."""
    if isinstance(value, Integral) and not isinstance(value, bool) and least <= int(value) <= most:
        return int(value)
    raise UsageError(f"{name} = {brief(value)}: must be a whole number from {least} to {most}")


def in_words(kind: str, message: str, context: Mapping[str, Any] | None = None) -> str:
    """A fault that pydantic found, of `kind` with its `message` and `context`, in the words of this project."""
    if kind in BOUNDS:
        words, name = BOUNDS[kind]
        return f"must be {words} {(context or {})[name]:g}"
    return _WORDS.get(kind) or message.removeprefix("Value error, ")


def refused(faults: Iterable[tuple[str, str]]) -> ValidationError:
    """The exception by which a validator of a whole section refuses values: (their key, what is wrong) of each."""
    details = list[InitErrorDetails]()
    for key, what in faults:
        kind = PydanticCustomError("refused", "{what}", {"what": what})
        details.append({"type": kind, "loc": tuple(key.split(".")), "input": None})
    return ValidationError.from_exception_data("section", details)


def details_of(error: ValidationError) -> list[ErrorDetails]:
    """Each fault that pydantic found, as it describes it.

    The errors that validators raised lose their tracebacks. The garbage collector does not see that an error of
    pydantic holds them: a function that keeps the error and is part of a traceback would never be freed, nor its run.
    """
    details = error.errors(include_url=False)
    for fault in details:
        if isinstance(raised := fault.get("ctx", {}).get("error"), Exception):
            raised.__traceback__ = None
    return details


def faults_of(error: ValidationError) -> list[tuple[str, str, Any]]:
    """Dotted key, fault in words and given value of each fault that pydantic found in a section."""
    faults = []
    for fault in details_of(error):
        key = ".".join(map(str, fault["loc"]))
        words = in_words(fault["type"], fault["msg"], fault.get("ctx"))
        faults.append((key, words, fault["input"]))
    return faults


def quantity(unit: str, *bounds: Gt | Ge | Lt | Le) -> Any:
    """The annotated type of a float with SI `unit` and bounds, for fields of a `Section`."""
    within = Range(unit, bounds)
    return Annotated[float, Unit(unit), BeforeValidator(within.read), *bounds, within]


def optional(unit: str, *bounds: Gt | Ge | Lt | Le) -> Any:
    """Like `quantity`, but the value may be omitted (None)."""
    return Annotated[quantity(unit, *bounds) | None, Unit(unit)]


def nanoseconds(value: Any, within: Range | None = None) -> int:
    """Convert a duration to whole nanoseconds; a text has a unit, a number is in seconds.

    Raises ValueError, which states the range `within`, if it is not finite or longer than `LONGEST`.
    """
    within = within or Range("s")
    seconds = within.read(value)
    if abs(seconds) > 1e-9 * LONGEST:  # much longer durations have no exact number of nanoseconds
        raise ValueError(f"must be {within}")
    return round(seconds * 1e9)


def duration(least: int = 1, most: int = LONGEST) -> Any:
    """The annotated type of a duration in whole nanoseconds, from `least` to `most` [ns]; written in seconds."""
    within = Range("s", (Ge(least * 1e-9), Le(most * 1e-9)))
    return Annotated[
        int,
        Unit("s"),
        BeforeValidator(partial(nanoseconds, within=within)),
        Ge(least),
        Le(most),
        PlainSerializer(lambda ns: ns * 1e-9),
    ]


def _rising(rows: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    """A table of damping ratios. Raises ValueError for one that cannot be interpolated."""
    hertz = [row[0] for row in rows]
    rising = bool(hertz) and sorted(set(hertz)) == hertz
    if not rising or not all(0.0 <= value < math.inf for row in rows for value in row):
        raise ValueError("expected rows [Hz, ratio] with rising frequencies and ratios from 0 on")
    return rows


@lru_cache(4096)  # each quantity of a rig is asked for, in a design of thousands of rigs
def unit_of(section: type[BaseModel], field: str) -> str:
    """SI unit of a field of a section; "" if it has none."""
    return next((str(m) for m in section.model_fields[field].metadata if isinstance(m, Unit)), "")


Ratio = quantity("1", Ge(0.0))
Number = quantity("1")
PositiveNumber = quantity("1", Gt(0.0))
Kilogram = quantity("kg", Gt(0.0))
NonNegativeKilogram = quantity("kg", Ge(0.0))
KilogramSquareMetre = quantity("kg*m^2", Gt(0.0))
KilogramPerCubicMetre = quantity("kg/m^3", Gt(0.0))
Pascal = quantity("Pa", Gt(0.0))
PoissonRatio = quantity("1", Ge(0.0), Lt(0.5))
Metre = quantity("m")
PositiveMetre = quantity("m", Gt(0.0))
NonNegativeMetre = quantity("m", Ge(0.0))
MetrePerSecond = quantity("m/s")
PositiveMetrePerSecond = quantity("m/s", Gt(0.0))
RadianPerSecond = quantity("rad/s")
Newton = quantity("N")
NonNegativeNewton = quantity("N", Ge(0.0))
PositiveNewton = quantity("N", Gt(0.0))
NewtonPerMetre = quantity("N/m", Gt(0.0))
NonNegativeNewtonPerMetre = quantity("N/m", Ge(0.0))
NewtonSecondPerMetre = quantity("N*s/m", Ge(0.0))
NewtonMetrePerRadian = quantity("N*m/rad", Gt(0.0))
NonNegativeNewtonMetrePerRadian = quantity("N*m/rad", Ge(0.0))
NewtonMetreSecondPerRadian = quantity("N*m*s/rad", Ge(0.0))
Second = quantity("s", Ge(0.0))
PositiveSecond = quantity("s", Gt(0.0))
Hertz = quantity("Hz", Gt(0.0))
SecondPerMetre = quantity("s/m", Ge(0.0))
PositiveSecondPerMetre = quantity("s/m", Gt(0.0))
Speed = quantity("m/s", Ge(0.0))
Angle = quantity("rad")
AcuteAngle = quantity("rad", Gt(0.0), Lt(math.pi / 2.0))
NewtonPerRootSpeed = quantity("N/(m/s)^0.5", Ge(0.0))
Farad = quantity("F", Gt(0.0))
NewtonPerVolt = quantity("N/V", Gt(0.0))
MetrePerVolt = quantity("m/V", Gt(0.0))
Ohm = quantity("ohm", Ge(0.0))
PositiveOhm = quantity("ohm", Gt(0.0))
Henry = quantity("H", Ge(0.0))
PositiveHenry = quantity("H", Gt(0.0))
Volt = quantity("V")
PositiveVolt = quantity("V", Gt(0.0))
Nanoseconds = duration()
Ratios = Annotated[tuple[tuple[float, float], ...], AfterValidator(_rising)]
"""Damping ratios over frequency, [[Hz, ratio], ...], linear in between."""


def at_most(value: float, digits: int = 2) -> str:
    """Text of an upper limit with `digits` digits, rounded down, so that the stated value is itself allowed."""
    return f"{float(Context(digits, ROUND_FLOOR).create_decimal_from_float(value)):.{digits}g}"


def at_least(value: float, digits: int = 2) -> str:
    """Text of a lower limit with `digits` digits, rounded up, so that the stated value is itself allowed."""
    return f"{float(Context(digits, ROUND_CEILING).create_decimal_from_float(value)):.{digits}g}"
