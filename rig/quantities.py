"""Physical quantities at the boundary: declared with unit and bounds, given as text or numbers, SI inside.

A parameter is declared once, as a field of a `Section`:

    class Body(Section):
        mass: Kilogram
        damping: NewtonSecondPerMetre = 0.0

A value may be given as a number (taken as SI), as text with a unit ("2 rpm"), or as a list
[value, origin, note] whose origin says where it comes from. Inside the project every number is SI.

Every quantity has a range: its own bounds, and the sizes that a bench of this kind can have in its unit (`SIZES`).
Products of a few values within these sizes stay far from what a double can hold.
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
"""Unit -> least and largest size of a value: far beyond what is built, near enough to tell a slip of the keyboard."""
OTHERS = (1e-15, 1e12)
"""The same for a unit that has no line of its own."""


class Unit(str):
    """Marks a field with its SI unit; `Unit("1")` is dimensionless."""


class Section(BaseModel):
    """One table of a scene: frozen, and a key it does not know is a fault.

    `declares`: what it says of itself where a plant may be without it.
    """

    declares: ClassVar[About] = About()

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)


class Range:
    """What a quantity of `unit` may be: from `low` to `high` (SI); where it must be positive, at least the least size.

    As metadata of a field it refuses anything else with a ValueError.
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
        """`value` as `si` reads it, in the range or beyond. Raises ValueError for what is not finite."""
        found = si(value, self.unit)
        if not math.isfinite(found):
            raise ValueError(f"must be a finite number, {self}")
        return found

    def check(self, value: float) -> float:
        """`value` if it is in the range. Raises ValueError with what is allowed."""
        if self.low <= value <= self.high:
            return value
        raise ValueError(f"must be {self}")

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g}" + ("" if self.unit == "1" else f" {self.unit}")

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self.check, handler(source))


@cache
def _registry() -> Any:
    import pint  # 0.3 s: only when a text with a unit is met

    return pint.UnitRegistry()


_POWER = r"(?:\^|\*\*)\s*[-+]?\d{1,2}(?:\.\d)?(?!\s*(?:\^|\*\*))"
_UNIT = re.compile(rf"(?:[^\W\d]\d?|[°%µμ*/()·\s]|1(?=\s*/)|{_POWER})+")
"""Names of units, products, quotients and small powers: no other arithmetic, which could take for ever."""
_LONGEST_UNIT = 60


@cache
def _factor(text: str, unit: str) -> tuple[float, float]:
    """Scale and offset that turn `text`'s unit into `unit`."""
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
    """`value` in SI units of `unit`: a number stays, text is read with its unit. What no double can hold is infinite.

    Raises ValueError with what was given and what is expected.
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
        raise ValueError(f"is {brief(value)}; expected a unit of {_named(unit)}") from None
    return magnitude * scale + offset


def finite(value: Any, unit: str, *bounds: Gt | Ge | Lt | Le) -> float:
    """`value` as `si` reads it, within `bounds` and the sizes of its unit. Raises ValueError."""
    within = Range(unit, bounds)
    return within.check(within.read(value))


def brief(value: Any) -> str:
    """A value as Python writes it, shortened where long."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _named(unit: str) -> str:
    return "1 (no unit)" if unit == "1" else unit


def quantity(unit: str, *bounds: Gt | Ge | Lt | Le) -> Any:
    """An annotated float with SI `unit` and bounds, for use in a `Section`."""
    within = Range(unit, bounds)
    return Annotated[float, Unit(unit), BeforeValidator(within.read), *bounds, within]


def optional(unit: str, *bounds: Gt | Ge | Lt | Le) -> Any:
    """A quantity that may be left out (None)."""
    return Annotated[quantity(unit, *bounds) | None, Unit(unit)]


def nanoseconds(value: Any, within: Range | None = None) -> int:
    """A duration as whole nanoseconds; text is read with its unit, a number is seconds. `within`: what is allowed."""
    within = within or Range("s")
    found = within.read(value)
    if abs(found) > 1e-9 * LONGEST:  # what is much longer has no whole number of nanoseconds
        raise ValueError(f"must be {within}")
    return round(found * 1e9)


def duration(least: int = 1, most: int = LONGEST) -> Any:
    """An annotated duration in whole nanoseconds, from `least` to `most` [ns]; told in seconds."""
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
    """SI unit of a field of a section; "" where it has none."""
    return next((str(m) for m in section.model_fields[field].metadata if isinstance(m, Unit)), "")


Ratio = quantity("1", Ge(0.0))
Number = quantity("1")
PositiveNumber = quantity("1", Gt(0.0))
Kilogram = quantity("kg", Gt(0.0))
SomeKilogram = quantity("kg", Ge(0.0))
KilogramSquareMetre = quantity("kg*m^2", Gt(0.0))
KilogramPerCubicMetre = quantity("kg/m^3", Gt(0.0))
Pascal = quantity("Pa", Gt(0.0))
PoissonRatio = quantity("1", Ge(0.0), Lt(0.5))
Metre = quantity("m")
PositiveMetre = quantity("m", Gt(0.0))
SomeMetre = quantity("m", Ge(0.0))
MetrePerSecond = quantity("m/s")
PositiveMetrePerSecond = quantity("m/s", Gt(0.0))
RadianPerSecond = quantity("rad/s")
Newton = quantity("N")
PositiveNewton = quantity("N", Ge(0.0))
Pressing = quantity("N", Gt(0.0))
NewtonPerMetre = quantity("N/m", Gt(0.0))
SomeNewtonPerMetre = quantity("N/m", Ge(0.0))
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
    """An upper limit in so many digits, rounded down: the value that is told is itself allowed."""
    return f"{float(Context(digits, ROUND_FLOOR).create_decimal_from_float(value)):.{digits}g}"


def at_least(value: float, digits: int = 2) -> str:
    """A lower limit in so many digits, rounded up: the value that is told is itself allowed."""
    return f"{float(Context(digits, ROUND_CEILING).create_decimal_from_float(value)):.{digits}g}"
