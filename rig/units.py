"""Units of physical quantities: plausible sizes, and the conversion of numbers and texts to SI."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, TypeGuard

from rig.errors import UsageError

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
USUAL: dict[str, dict[str, float]] = {
    "1": {"%": 0.01, "ppm": 1e-6},
    "kg": {"mg": 1e-6, "g": 1e-3, "t": 1e3},
    "kg*m^2": {"kg*cm^2": 1e-4},
    "Pa": {"mbar": 100.0, "kPa": 1e3, "bar": 1e5, "MPa": 1e6, "GPa": 1e9},
    "m": {"nm": 1e-9, "um": 1e-6, "mm": 1e-3, "cm": 0.01, "km": 1e3},
    "m/s": {"nm/s": 1e-9, "um/s": 1e-6, "mm/s": 1e-3, "cm/s": 0.01, "km/h": 0.2777777777777778},
    "m/s^2": {"mm/s^2": 1e-3},
    "rad": {"mrad": 1e-3, "deg": 0.017453292519943295, "°": 0.017453292519943295},
    "rad/s": {"mrad/s": 1e-3, "deg/s": 0.017453292519943295, "rpm": 0.10471975511965977, "1/s": 1.0, "Hz": 1.0},
    "N": {"uN": 1e-6, "mN": 1e-3, "kN": 1e3, "MN": 1e6},
    "N/m": {"mN/m": 1e-3, "N/cm": 100.0, "kN/m": 1e3, "N/mm": 1e3, "MN/m": 1e6, "N/um": 1e6, "kN/mm": 1e6},
    "N*s/m": {"mN*s/m": 1e-3, "kg/s": 1.0, "N*s/mm": 1e3, "kN*s/m": 1e3},
    "N*m/rad": {"mN*m/rad": 1e-3, "N*m": 1.0},
    "N*s": {"mN*s": 1e-3},
    "s": {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "min": 60.0, "h": 3600.0},
    "Hz": {"mHz": 1e-3, "1/s": 1.0, "kHz": 1e3, "MHz": 1e6},
    "F": {"pF": 1e-12, "nF": 1e-9, "uF": 1e-6, "mF": 1e-3},
    "m/V": {"nm/V": 1e-9, "um/V": 1e-6, "mm/V": 1e-3},
    "V": {"uV": 1e-6, "mV": 1e-3, "kV": 1e3},
    "ohm": {"mohm": 1e-3, "kohm": 1e3, "Mohm": 1e6},
    "H": {"uH": 1e-6, "mH": 1e-3},
}
"""SI unit -> other units that its values are usually given in -> size of these; a u is also written µ.

pint knows these as well: to load it takes 0.3 s, which neither a start nor a running loop has.
"""

_POWER = r"(?:\^|\*\*)\s*[-+]?\d{1,2}(?:\.\d)?(?!\s*(?:\^|\*\*))"
# Unit names, products, quotients and small powers; other arithmetic is excluded, as it could take for ever
_UNIT = re.compile(rf"(?:[^\W\d]\d?|[°%µμ*/()·\s]|1(?=\s*/)|{_POWER})+")
_LONGEST_UNIT = 60  # characters: a longer text is no unit. chosen
# A number that a unit follows without a space: 2s, 40mm/s. No run of digits is split: that took quadratic time.
_GLUED = re.compile(r"^([-+]?(?:\d++\.?\d*+|\.\d++)(?:[eE][-+]?\d++)?)(?![eE][-+]?\d)(?=[^\W\d_]|[°%µμ])")
_ALLOWED = 'expected an SI unit such as "m", "m/s", "N", "Pa", "V" or "1" (no unit)'

# Characters of typeset numbers: the minus sign, and spaces of fixed width
_PASTED = {ord("\u2212"): "-"} | dict.fromkeys(map(ord, "\xa0\u2007\u2009\u202f"), " ")
_COMMA = re.compile(r"([-+]?(\d++)),(\d++)(?![.,])([^,]*)")
_POINT = " with a decimal point, not a comma"


@cache
def _registry() -> Any:
    import pint  # takes 0.3 s, so only for a unit that is not a usual one

    return pint.UnitRegistry()


def _usual(text: str, unit: str) -> float | None:
    return USUAL.get(unit, {}).get(text.replace("µ", "u").replace("μ", "u"))


@cache
def _factor(text: str, unit: str) -> tuple[float, float]:
    """Scale and offset that convert values in the unit `text` to `unit`."""
    if usual := _usual(text, unit):
        return usual, 0.0
    if len(text) > _LONGEST_UNIT or not _UNIT.fullmatch(text):
        raise ValueError(text)
    registry = _registry()
    target = registry.parse_units("" if unit == "1" else unit)
    source = registry.parse_units(text)
    if source == target:
        return 1.0, 0.0
    zero = registry.Quantity(0.0, source).to(target).magnitude
    unit_size = registry.Quantity(1.0, source).to(target).magnitude
    return float(unit_size - zero), float(zero)


def conversion(text: str, unit: str) -> tuple[float, float]:
    """Factor and offset that convert values in the unit `text` to `unit` (SI). Raises ValueError."""
    if text == unit:
        return 1.0, 0.0
    try:
        return _factor(text, unit)
    except Exception:  # pint raises many kinds: unknown unit, wrong dimension, bad syntax
        raise ValueError(f"{brief(text)} is unknown, or does not convert to {_named(unit)}") from None


@cache
def si_unit(text: str) -> str:
    """The SI unit without a prefix for values in the unit `text`: "m/s" for "mm/s". Raises ValueError."""
    if text in SIZES:
        return text
    try:
        if len(text) > _LONGEST_UNIT or not _UNIT.fullmatch(text):
            raise ValueError(text)
        powers = exponents(text)
    except Exception:  # pint raises many kinds
        powers = None
    if powers is None:
        raise ValueError(f"{brief(text)} is unknown, or has no SI unit")
    known = (unit for unit in SIZES if exponents(unit) == powers)
    return next(known, "*".join(f"{base}^{power}" if power != 1 else base for base, power in powers.items()))


def with_point(text: str, name: str) -> str:
    """The typed value `name` with its decimal comma as a point: "15,5 N" becomes "15.5 N"; other texts are unchanged.

    Raises UsageError for "1,500", which some read as 1.5 and others as 1500.
    """
    match = _COMMA.fullmatch(text.strip().translate(_PASTED))
    if match is None:
        return text
    number, whole, decimals, rest = match.groups()
    if len(decimals) == 3 and len(whole) <= 3 and whole[0] != "0":
        raise UsageError(f"{name} {text} may be {number}.{decimals} or {number}{decimals}; write one of these")
    return f"{number}.{decimals}{rest}"


def parted(text: str) -> tuple[str, str]:
    """Return the number and the unit of a value, "2 rpm" or "2rpm", as texts; "" for a unit that is missing."""
    number, _, unit = _GLUED.sub(r"\1 ", text.strip().translate(_PASTED), count=1).partition(" ")
    return number, unit.strip()


def converts(value: Any, unit: str) -> TypeGuard[str]:
    """Whether `value` is a text in another unit than `unit`."""
    return isinstance(value, str) and parted(value)[1] not in ("", unit)


def refuse_unusual(changes: Mapping[str, object], units: Mapping[str, str]) -> None:
    """Raise UsageError for texts that `si` can convert to `units`, by key, only with pint: to load it stops a loop."""
    faults = []
    for key, value in changes.items():
        unit = units.get(key)
        if unit and converts(value, unit) and _usual(parted(value)[1], unit) is None:
            reason = "because a running loop converts usual units only"
            faults.append(f"{key}: is {brief(value)}; expected a number in {unit}, {reason}")
    if faults:
        raise UsageError("\n".join(faults))


def with_units(values: Sequence[str]) -> list[str]:
    """Return the values of a list with units: one without a unit takes that of the others ("10", "20 kN").

    Raises ValueError if the others have several. Without any unit the values stay as they are.
    """
    units = [parted(value)[1] for value in values]
    named = [unit for unit in dict.fromkeys(units) if unit not in ("", "1")]
    bare = [value for value, unit in zip(values, units) if not unit]
    if len(named) > 1 and bare:
        raise ValueError(f"{brief(bare[0])} has no unit, and the others have {' and '.join(named)}; state its unit")
    return [f"{value} {named[0]}" if named and not unit else value for value, unit in zip(values, units)]


def si(value: Any, unit: str) -> float:
    """Convert `value` to `unit`: a number is already in SI, a text has a unit. Too large for a double is infinite.

    Raises ValueError, which states the given value and what is expected.
    """
    if hasattr(value, "item") and getattr(value, "shape", None) == ():  # a number of numpy
        value = value.item()
    if isinstance(value, bool):
        raise ValueError(f"is {value}; expected a number in {_named(unit)}")
    if isinstance(value, int | float):
        try:
            return float(value)
        except OverflowError:
            return math.inf if value > 0 else -math.inf
    if not isinstance(value, str):
        parts = isinstance(value, list | tuple) and len(value) in (2, 3, 4) and [type(part) for part in value[:2]]
        comma = _POINT if parts == [int, int] else ""  # [0,1, "chosen"]
        raise ValueError(f"is {brief(value)}; expected a number or a text with a unit in {_named(unit)}{comma}")
    number, rest = parted(value)
    try:
        magnitude = float(number)
    except ValueError:
        what = "a number" if unit == "1" else f"a number and a unit in {unit}"
        comma = _POINT if _COMMA.fullmatch(value.strip().translate(_PASTED)) else ""
        raise ValueError(f"is {brief(value)}; expected {what}{comma}") from None
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
        return f"{brief(unit)} is not a unit; {_ALLOWED}"
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


def same_unit(first: str, other: str) -> bool:
    """Whether two SI units are the same, however they are written ("N*s/m", "kg/s"); Hz is not rad/s."""
    if first == other:
        return True
    turns = [("Hz" in unit, "rad" in unit) for unit in (first, other)]
    return sorted(turns) != [(False, True), (True, False)] and _exponents(first) == _exponents(other)


@cache
def _exponents(unit: str) -> Any:
    return _registry().parse_units("" if unit == "1" else unit).dimensionality


def number_or_text(text: str) -> float | str:
    """A text as a number, if it is one without a unit."""
    try:
        return float(text)
    except ValueError:
        return text


def brief(value: Any) -> str:
    """`repr` of a value, shortened to 60 characters; of one whose `repr` fails its type."""
    try:
        text = repr(value)
    except Exception:  # of a class of the user
        text = f"a {type(value).__name__}"
    return text if len(text) <= 60 else f"{text[:57]}..."


def is_number(value: Any) -> bool:
    """Whether a value is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _named(unit: str) -> str:
    return "1 (no unit)" if unit == "1" else unit


def exponents(unit: str) -> dict[str, int] | None:
    """The exponents of kg, m, s, A, K, mol, cd and rad in an SI unit; None if one is not whole, or another base is."""
    registry = _registry()
    _, root = registry.get_root_units(registry.parse_units("" if unit == "1" else unit))
    names = {"kilogram": "kg", "gram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol"}
    names |= {"candela": "cd", "radian": "rad"}
    powers = {names.get(name, ""): power for name, power in root._units.items()}  # noqa: SLF001
    if "" in powers or any(power != int(power) for power in powers.values()):
        return None
    return {name: int(power) for name, power in powers.items()}
