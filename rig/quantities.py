"""Physical quantities at the boundary: declared with unit and bounds, given as text or numbers, SI inside.

A parameter is declared once, as a field of a `Section`:

    class Body(Section):
        mass: Kilogram
        damping: NewtonSecondPerMetre = 0.0

A value may be given as a number (taken as SI), as text with a unit ("2 rpm"), or as a list
[value, origin, note] whose origin says where it comes from. Inside the project every number is SI.
"""

from __future__ import annotations

import math
from functools import cache, partial
from typing import Annotated, Any

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel, BeforeValidator, ConfigDict, PlainSerializer

ORIGINS = ("paper", "public", "derived", "calibrated", "chosen", "user")


class Unit(str):
    """Marks a field with its SI unit; `Unit("1")` is dimensionless."""


class Section(BaseModel):
    """One table of a scene: frozen, and a key it does not know is a fault."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


@cache
def _registry() -> Any:
    import pint  # 0.3 s: only when a text with a unit is met

    return pint.UnitRegistry()


@cache
def _factor(text: str, unit: str) -> tuple[float, float]:
    """Scale and offset that turn `text`'s unit into `unit`."""
    registry = _registry()
    target = registry.parse_units("" if unit == "1" else unit)
    source = registry.parse_units(text)
    if source == target:
        return 1.0, 0.0
    zero = registry.Quantity(0.0, source).to(target).magnitude
    one = registry.Quantity(1.0, source).to(target).magnitude
    return float(one - zero), float(zero)


def si(value: Any, unit: str) -> float:
    """`value` in SI units of `unit`: a number stays, text is read with its unit.

    Raises ValueError with what was given and what is expected.
    """
    if isinstance(value, bool):
        raise ValueError(f"is {value}; expected a number in {_named(unit)}")
    if isinstance(value, int | float):
        return float(value)
    if not isinstance(value, str):
        raise ValueError(f"is {value!r}; expected a number or a text with a unit in {_named(unit)}")
    number, _, rest = value.strip().partition(" ")
    try:
        magnitude = float(number)
    except ValueError:
        raise ValueError(f"is {value!r}; expected a number, a space and a unit in {_named(unit)}") from None
    rest = rest.strip()
    if rest == unit or (not rest and unit == "1"):
        return magnitude
    if not rest:
        raise ValueError(f"is {value!r} without a unit; expected {_named(unit)}")
    try:
        scale, offset = _factor(rest, unit)
    except Exception:  # pint raises many kinds: unknown unit, wrong dimension, bad syntax
        raise ValueError(f"is {value!r}; expected a unit of {_named(unit)}") from None
    return magnitude * scale + offset


def _named(unit: str) -> str:
    return "1 (no unit)" if unit == "1" else unit


def quantity(unit: str, *bounds: Gt | Ge | Lt | Le) -> Any:
    """An annotated float with SI `unit` and bounds, for use in a `Section`."""
    return Annotated[float, Unit(unit), BeforeValidator(partial(si, unit=unit)), *bounds]


def nanoseconds(value: Any) -> int:
    """A duration as whole nanoseconds; text is read with its unit, a number is seconds."""
    return round(si(value, "s") * 1e9)


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
SpeedAmplitude = quantity("m/s", Ge(0.0))
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
Nanoseconds = Annotated[int, Unit("s"), BeforeValidator(nanoseconds), Gt(0), PlainSerializer(lambda ns: ns * 1e-9)]
