"""Physical quantities of a scene: declared with unit and bounds, read from text or numbers, converted to SI.

A parameter is declared once, as a field of a `Section`:

    class Body(Section):
        mass: Kilogram
        damping: NewtonSecondPerMetre = 0.0

A value is a number (in SI units), a text with a unit ("2 rpm"), or a list [value, origin, note], whose origin says
where the value comes from. Inside the project every number is in SI units.

Every quantity has a range: its own bounds, and the sizes that are plausible for its unit (`SIZES`). Products of a few
values within these sizes stay far below the largest double.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from functools import cache, partial
from typing import Annotated, Any, ClassVar

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel, BeforeValidator, ConfigDict, GetCoreSchemaHandler, PlainSerializer
from pydantic_core import CoreSchema, core_schema

from rig.about import About

ORIGINS = ("paper", "public", "derived", "calibrated", "chosen", "user")
LONGEST = 1_000_000_000_000_000
"""Longest duration [ns]: 1e6 s, eleven days."""

SIZES: dict[str, tuple[float, float]] = {
    "1": (1e-15, 1e9),
    "kg": (1e-9, 1e6),
    "kg*m^2": (1e-12, 1e6),
    "kg/m^3": (1e-3, 1e5),
    "Pa": (1e-9, 1e13),
    "m": (1e-12, 1e4),
    "m/s": (1e-12, 1e4),
    "m/s^2": (1e-12, 1e9),
    "rad": (1e-12, 1e4),
    "rad/s": (1e-12, 1e6),
    "N": (1e-12, 1e9),
    "N/m": (1e-15, 1e15),
    "N*s/m": (1e-9, 1e9),
    "N*m/rad": (1e-15, 1e15),
    "N*m*s/rad": (1e-12, 1e9),
    "N*s": (1e-12, 1e6),
    "s": (1e-9, 1e6),
    "Hz": (1e-6, 1e6),
    "F": (1e-15, 1.0),
    "N/V": (1e-15, 1e6),
    "m/V": (1e-15, 1.0),
    "V": (1e-9, 1e6),
    "ohm": (1e-9, 1e15),
    "H": (1e-15, 1e6),
}
"""Unit -> least and largest plausible size of a value: wider than any real rig, but narrow enough to find typos."""
OTHERS = (1e-15, 1e12)
"""Least and largest size for all other units."""


class Unit(str):
    """Marks a field with its SI unit; `Unit("1")` is dimensionless."""


class Section(BaseModel):
    """One table of a scene. It is immutable and rejects unknown keys.

    `declares`: the description of an effect, for tables that a plant can have or not.
    """

    declares: ClassVar[About] = About()

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)


class Range:
    """The allowed range of a quantity of `unit`: from `low` to `high` (SI).

    The lower limit of a positive quantity is the least size of its unit. As metadata of a field a Range raises
    ValueError for all values outside.
    """

    def __init__(self, unit: str, bounds: Iterable[Gt | Ge | Lt | Le] = ()) -> None:
        least, most = SIZES.get(unit, OTHERS)
        self.unit, self.low, self.high = unit, -most, most
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
        found = si(value, self.unit)
        if not math.isfinite(found):
            raise ValueError(f"must be a finite number, {self}")
        return found

    def check(self, value: float) -> float:
        """Return `value` if it is in the range. Raises ValueError, which states the range."""
        if self.low <= value <= self.high:
            return value
        raise ValueError(f"must be {self}")

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g}" + ("" if self.unit == "1" else f" {self.unit}")

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self.check, handler(source))


@cache
def _registry() -> Any:
    import pint  # takes 0.3 s, so only when a text has a unit

    return pint.UnitRegistry()


_POWER = r"(?:\^|\*\*)\s*[-+]?\d{1,2}(?:\.\d)?(?!\s*(?:\^|\*\*))"
_UNIT = re.compile(rf"(?:[^\W\d]\d?|[°%µμ*/()·\s]|1(?=\s*/)|{_POWER})+")
"""Unit names, products, quotients and small powers; other arithmetic is excluded, as it could take for ever."""
_LONGEST_UNIT = 60
_ALLOWED = 'expected an SI unit such as "m", "m/s", "N", "Pa", "V" or "1" (no unit)'


@cache
def _factor(text: str, unit: str) -> tuple[float, float]:
    """Scale and offset that convert values in the unit `text` to `unit`."""
    if len(text) > _LONGEST_UNIT or not _UNIT.fullmatch(text):
        raise ValueError(text)
    registry = _registry()
    target = registry.parse_units("" if unit == "1" else unit)
    source = registry.parse_units(text)
    if source == target:
        return 1.0, 0.0
    zero = registry.Quantity(0.0, source).to(target).magnitude
    one = registry.Quantity(1.0, source).to(target).magnitude
    return float(one - zero), float(zero)


def si(value: Any, unit: str) -> float:
    """Convert `value` to `unit`: a number is already in SI, a text has a unit. Too large for a double is infinite.

    Raises ValueError, which states the given value and what is expected.
    """
    if isinstance(value, bool):
        raise ValueError(f"is {value}; expected a number in {_named(unit)}")
    if isinstance(value, int | float):
        try:
            return float(value)
        except OverflowError:
            return math.inf if value > 0 else -math.inf
    if not isinstance(value, str):
        raise ValueError(f"is {brief(value)}; expected a number or a text with a unit in {_named(unit)}")
    number, _, rest = value.strip().partition(" ")
    try:
        magnitude = float(number)
    except ValueError:
        raise ValueError(f"is {brief(value)}; expected a number, a space and a unit in {_named(unit)}") from None
    rest = rest.strip()
    if rest == unit or (not rest and unit == "1"):
        return magnitude
    if not rest:
        raise ValueError(f"is {brief(value)} without a unit; expected {_named(unit)}")
    try:
        scale, offset = _factor(rest, unit)
    except Exception:  # pint raises many kinds: unknown unit, wrong dimension, bad syntax
        raise ValueError(f"is {brief(value)}; expected a unit that converts to {_named(unit)}") from None
    return magnitude * scale + offset


@cache
def unit_fault(unit: Any) -> str:
    """What is wrong with the unit that a part declares, in words; "" for an SI unit without a prefix (kg has one)."""
    if not isinstance(unit, str):
        return f"{brief(unit)} is no unit; {_ALLOWED}"
    if unit in SIZES:
        return ""
    try:
        if len(unit) > _LONGEST_UNIT or not _UNIT.fullmatch(unit):
            raise ValueError(unit)
        registry = _registry()
        si_value = registry.Quantity(1.0, registry.parse_units(unit)).to_base_units().magnitude
    except Exception:  # pint raises many kinds: unknown unit, bad syntax
        return f"{brief(unit)} is unknown; {_ALLOWED}"
    return (
        ""
        if math.isclose(si_value, 1.0, rel_tol=1e-12)
        else f"{brief(unit)} is not SI, and no number is converted to it; {_ALLOWED}"
    )


def same_unit(one: str, other: str) -> bool:
    """Whether two SI units are the same, however they are written ("N*s/m", "kg/s"); Hz is not rad/s."""
    if one == other:
        return True
    turns = [("Hz" in unit, "rad" in unit) for unit in (one, other)]
    return sorted(turns) != [(False, True), (True, False)] and _exponents(one) == _exponents(other)


@cache
def _exponents(unit: str) -> Any:
    return _registry().parse_units("" if unit == "1" else unit).dimensionality


def finite(value: Any, unit: str, *bounds: Gt | Ge | Lt | Le) -> float:
    """Read `value` as `si` does and check it against `bounds` and the sizes of its unit. Raises ValueError."""
    within = Range(unit, bounds)
    return within.check(within.read(value))


def brief(value: Any) -> str:
    """`repr` of a value, shortened to 60 characters."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _named(unit: str) -> str:
    return "1 (no unit)" if unit == "1" else unit


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
    found = within.read(value)
    if abs(found) > 1e-9 * LONGEST:  # much longer durations have no exact number of nanoseconds
        raise ValueError(f"must be {within}")
    return round(found * 1e9)


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


def at_most(value: float, digits: int = 2) -> str:
    """Text of an upper limit with `digits` digits, rounded down, so that the stated value is itself allowed."""
    return f"{float(Context(digits, ROUND_FLOOR).create_decimal_from_float(value)):.{digits}g}"


def at_least(value: float, digits: int = 2) -> str:
    """Text of a lower limit with `digits` digits, rounded up, so that the stated value is itself allowed."""
    return f"{float(Context(digits, ROUND_CEILING).create_decimal_from_float(value)):.{digits}g}"
