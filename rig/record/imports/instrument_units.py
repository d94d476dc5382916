"""What the units mean that instruments and their programs write, and the SI unit that their values become.

A unit is a whole text of `_WHOLE`, or a product and quotient of the symbols and words below. What is not in these
tables is unknown: nothing is guessed. A unit with two meanings is refused with both ways to write it. A result that is
no quantity of a bench, such as kg/A, is refused too.
"""

from __future__ import annotations

import math
import re
from contextlib import suppress
from functools import cache
from typing import NamedTuple

from rig.units import SIZES, brief

_GRAVITY = 9.80665  # m/s^2, standard
_INCH = 0.0254  # m
_POUND = 0.45359237  # kg
_TURN = 2.0 * math.pi  # rad
_DEGREE = math.pi / 180.0  # rad
_ZERO_CELSIUS = 273.15  # K
_FAHRENHEIT = 5.0 / 9.0  # K
_LONGEST = 60  # characters: a longer text is no unit. chosen

Powers = tuple[tuple[str, int], ...]
"""Base units with their exponents, in the order of their names."""

# Symbol -> size in the base units, base units with exponents, and the prefixes that it takes
_SYMBOLS: dict[str, tuple[float, dict[str, int], str]] = {
    "m": (1.0, {"m": 1}, "numcdk"),
    "s": (1.0, {"s": 1}, "num"),
    "min": (60.0, {"s": 1}, ""),
    "h": (3600.0, {"s": 1}, ""),
    "d": (86400.0, {"s": 1}, ""),
    "Hz": (1.0, {"s": -1}, "mkMG"),
    "kg": (1.0, {"kg": 1}, ""),
    "gram": (1e-3, {"kg": 1}, ""),
    "milligram": (1e-6, {"kg": 1}, ""),
    "microgram": (1e-9, {"kg": 1}, ""),
    "t": (1e3, {"kg": 1}, ""),
    "pound": (_POUND, {"kg": 1}, ""),
    "ounce": (_POUND / 16.0, {"kg": 1}, ""),
    "in": (_INCH, {"m": 1}, ""),
    "ft": (0.3048, {"m": 1}, ""),
    "yd": (0.9144, {"m": 1}, ""),
    "thou": (1e-3 * _INCH, {"m": 1}, ""),
    "uin": (1e-6 * _INCH, {"m": 1}, ""),
    "l": (1e-3, {"m": 3}, "m"),
    "L": (1e-3, {"m": 3}, "m"),
    "rad": (1.0, {"rad": 1}, "um"),
    "deg": (_DEGREE, {"rad": 1}, "m"),
    "gon": (math.pi / 200.0, {"rad": 1}, ""),
    "rev": (_TURN, {"rad": 1}, ""),
    "rpm": (_TURN / 60.0, {"rad": 1, "s": -1}, ""),
    "g_n": (_GRAVITY, {"m": 1, "s": -2}, "num"),
    "N": (1.0, {"kg": 1, "m": 1, "s": -2}, "umcdkM"),
    "Nm": (1.0, {"kg": 1, "m": 2, "s": -2}, "mckM"),
    "Ncm": (1e-2, {"kg": 1, "m": 2, "s": -2}, ""),
    "Ns": (1.0, {"kg": 1, "m": 1, "s": -1}, "m"),
    "Nms": (1.0, {"kg": 1, "m": 2, "s": -1}, ""),
    "Nmm": (1e-3, {"kg": 1, "m": 2, "s": -2}, ""),
    "daN": (10.0, {"kg": 1, "m": 1, "s": -2}, ""),
    "kp": (_GRAVITY, {"kg": 1, "m": 1, "s": -2}, ""),
    "kgf": (_GRAVITY, {"kg": 1, "m": 1, "s": -2}, ""),
    "gf": (1e-3 * _GRAVITY, {"kg": 1, "m": 1, "s": -2}, ""),
    "lbf": (_POUND * _GRAVITY, {"kg": 1, "m": 1, "s": -2}, ""),
    "kip": (1e3 * _POUND * _GRAVITY, {"kg": 1, "m": 1, "s": -2}, ""),
    "ozf": (_POUND * _GRAVITY / 16.0, {"kg": 1, "m": 1, "s": -2}, ""),
    "Pa": (1.0, {"kg": 1, "m": -1, "s": -2}, "umhkMG"),
    "bar": (1e5, {"kg": 1, "m": -1, "s": -2}, "um"),
    "psi": (_POUND * _GRAVITY / _INCH**2, {"kg": 1, "m": -1, "s": -2}, "k"),
    "atm": (101325.0, {"kg": 1, "m": -1, "s": -2}, ""),
    "Torr": (101325.0 / 760.0, {"kg": 1, "m": -1, "s": -2}, ""),
    "mmHg": (133.322387415, {"kg": 1, "m": -1, "s": -2}, ""),
    "J": (1.0, {"kg": 1, "m": 2, "s": -2}, "umkM"),
    "W": (1.0, {"kg": 1, "m": 2, "s": -3}, "umkM"),
    "V": (1.0, {"kg": 1, "m": 2, "s": -3, "A": -1}, "numk"),
    "A": (1.0, {"A": 1}, "pnumk"),
    "ohm": (1.0, {"kg": 1, "m": 2, "s": -3, "A": -2}, "mkM"),
    "Ohm": (1.0, {"kg": 1, "m": 2, "s": -3, "A": -2}, "mkM"),
    "coulomb": (1.0, {"A": 1, "s": 1}, ""),
    "farad": (1.0, {"kg": -1, "m": -2, "s": 4, "A": 2}, ""),
    "siemens": (1.0, {"kg": -1, "m": -2, "s": 3, "A": 2}, ""),
    "H": (1.0, {"kg": 1, "m": 2, "s": -2, "A": -2}, "um"),
    "T": (1.0, {"kg": 1, "s": -2, "A": -1}, "um"),
    "gauss": (1e-4, {"kg": 1, "s": -2, "A": -1}, ""),
    "K": (1.0, {"K": 1}, "m"),
    "degC": (1.0, {"K": 1}, ""),
    "degF": (_FAHRENHEIT, {"K": 1}, ""),
    "pC": (1e-12, {"A": 1, "s": 1}, ""),
    "nC": (1e-9, {"A": 1, "s": 1}, ""),
    "uC": (1e-6, {"A": 1, "s": 1}, ""),
    "pF": (1e-12, {"kg": -1, "m": -2, "s": 4, "A": 2}, ""),
    "nF": (1e-9, {"kg": -1, "m": -2, "s": 4, "A": 2}, ""),
    "uF": (1e-6, {"kg": -1, "m": -2, "s": 4, "A": 2}, ""),
    "mF": (1e-3, {"kg": -1, "m": -2, "s": 4, "A": 2}, ""),
    "count": (1.0, {}, ""),
    "bit": (1.0, {}, ""),
}
_PREFIXES = {"p": 1e-12, "n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "d": 0.1, "h": 1e2, "k": 1e3, "M": 1e6, "G": 1e9}
# Words, in small letters -> symbol
_WORDS = {
    **dict.fromkeys(("volt", "volts"), "V"),
    **dict.fromkeys(("millivolt", "millivolts", "mvolt", "mvolts"), "mV"),
    **dict.fromkeys(("amp", "amps", "ampere", "amperes"), "A"),
    **dict.fromkeys(("milliamp", "milliamps", "milliampere"), "mA"),
    **dict.fromkeys(("ohm", "ohms"), "ohm"),
    **dict.fromkeys(("sec", "secs", "second", "seconds", "sek", "sekunde", "sekunden"), "s"),
    **dict.fromkeys(("msec", "msecs", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("usec", "microsecond", "microseconds"), "us"),
    **dict.fromkeys(("nsec", "nanosecond", "nanoseconds"), "ns"),
    **dict.fromkeys(("mins", "minute", "minutes", "minuten"), "min"),
    **dict.fromkeys(("hr", "hrs", "hour", "hours", "stunden"), "h"),
    **dict.fromkeys(("day", "days", "tage"), "d"),
    **dict.fromkeys(("hz", "hertz", "cps"), "Hz"),
    **dict.fromkeys(("khz", "kilohertz"), "kHz"),
    **dict.fromkeys(("meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("millimeter", "millimeters", "millimetre", "millimetres"), "mm"),
    **dict.fromkeys(("micron", "microns", "micrometer", "micrometre"), "um"),
    **dict.fromkeys(("inch", "inches", "zoll"), "in"),
    **dict.fromkeys(("foot", "feet"), "ft"),
    **dict.fromkeys(("mils",), "thou"),
    **dict.fromkeys(("newton", "newtons"), "N"),
    **dict.fromkeys(("pascal", "pascals"), "Pa"),
    **dict.fromkeys(("kpa",), "kPa"),
    **dict.fromkeys(("watt", "watts"), "W"),
    **dict.fromkeys(("joule", "joules"), "J"),
    **dict.fromkeys(("kelvin",), "K"),
    **dict.fromkeys(("celsius", "degc", "deg_c"), "degC"),
    **dict.fromkeys(("fahrenheit", "degf", "deg_f"), "degF"),
    **dict.fromkeys(("degree", "degrees", "degs"), "deg"),
    **dict.fromkeys(("radian", "radians"), "rad"),
    **dict.fromkeys(("turn", "turns", "revolution", "revolutions", "umdrehungen"), "rev"),
    **dict.fromkeys(("counts", "cnts", "digit", "digits", "lsb"), "count"),
    **dict.fromkeys(("bits",), "bit"),
    **dict.fromkeys(("grams", "gramm"), "gram"),
    **dict.fromkeys(("kilogram", "kilograms"), "kg"),
    **dict.fromkeys(("tesla",), "T"),
    **dict.fromkeys(("gauss",), "gauss"),
    **dict.fromkeys(("litre", "liter", "litres", "liters"), "l"),
    **dict.fromkeys(("torr",), "Torr"),
    **dict.fromkeys(("psi",), "psi"),
    **dict.fromkeys(("bar",), "bar"),
}
# Texts that are not what the symbols in them would be -> what they are
_WHOLE = {
    **dict.fromkeys(("1", "-", "--", "[]", "[-]", "none", "unitless", "dimensionless", "ratio", "v/v", "strain"), "1"),
    **dict.fromkeys(("%", "percent", "prozent", "pct"), "%"),
    **dict.fromkeys(("‰", "promille"), "‰"),
    **dict.fromkeys(("ppm", "ustrain", "microstrain", "µstrain", "ue", "uε", "um/m", "uv/v"), "ppm"),
    **dict.fromkeys(("u/min", "1/min", "min-1", "min^-1", "/min", "1/minute", "r/min", "rev/min", "upm"), "rpm"),
    **dict.fromkeys(("umin-1", "u min-1", "umdr/min", "umdr./min", "rpm", "r.p.m."), "rpm"),
    **dict.fromkeys(("tr/min", "tours/min", "giri/min", "obr/min"), "rpm"),
    **dict.fromkeys(("u/s", "rps", "r/s"), "rev/s"),
    **dict.fromkeys(("ft-lb", "ft-lbs", "ft lb", "ft*lb", "lb-ft", "lb ft", "lb*ft", "ft-lbf", "lbf-ft"), "lbf*ft"),
    **dict.fromkeys(("in-lb", "in-lbs", "in lb", "in*lb", "lb-in", "lb in", "lb*in", "in-lbf", "lbf-in"), "lbf*in"),
    **dict.fromkeys(("kpm",), "kp*m"),
    **dict.fromkeys(("ips",), "in/s"),
    **dict.fromkeys(("mph",), "mph"),
    **dict.fromkeys(("kmh", "kph"), "km/h"),
    **dict.fromkeys(("lpm",), "l/min"),
    **dict.fromkeys(('"',), "in"),
    **dict.fromkeys(("deg", "degree", "degrees"), "deg"),
    **dict.fromkeys(("deg c", "deg. c", "degree c", "degrees c", "grad c", "grad celsius", "deg celsius"), "degC"),
    **dict.fromkeys(("deg f", "deg. f", "degree f", "degrees f", "deg fahrenheit"), "degF"),
    **dict.fromkeys(("ms-2", "ms^-2", "m s-2"), "m/s^2"),
    **dict.fromkeys(("mms-1", "mms^-1"), "mm/s"),
    **dict.fromkeys(("mms-2", "mms^-2"), "mm/s^2"),
    **dict.fromkeys(("kgm^2", "kgm2"), "kg*m^2"),
    **dict.fromkeys(("gn", "g0", "gee"), "g_n"),
}
_RATIOS = {"1": 1.0, "%": 1e-2, "‰": 1e-3, "ppm": 1e-6}
_MPH = 5280.0 * 0.3048 / 3600.0  # m/s
# Texts with two meanings -> both ways to write them, with what they are
_AMBIGUOUS: dict[str, tuple[tuple[str, str], ...]] = {
    "g": (("g_n", "standard gravity, 9.80665 m/s^2"), ("gram", "0.001 kg")),
    "mg": (("mg_n", "0.001 of standard gravity"), ("milligram", "1e-6 kg")),
    "ug": (("ug_n", "1e-6 of standard gravity"), ("microgram", "1e-9 kg")),
    "G": (("g_n", "standard gravity, 9.80665 m/s^2"), ("gauss", "1e-4 T")),
    "C": (("degC", "degree Celsius"), ("coulomb", "A*s")),
    "F": (("degF", "degree Fahrenheit"), ("farad", "A*s/V")),
    "S": (("s", "second"), ("siemens", "A/V")),
    **dict.fromkeys(
        ("mil", "Mil", "MIL"),
        (("thou", "a thousandth of an inch, 25.4 um"), ("mrad", "a thousandth of a radian")),
    ),
    "Grad": (("deg", "1/360 of a turn"), ("gon", "1/400 of a turn")),
    "grad": (("deg", "1/360 of a turn"), ("gon", "1/400 of a turn")),
    "lb": (("lbf", "pound-force, 4.448 N"), ("pound", "0.4536 kg")),
    "lbs": (("lbf", "pound-force, 4.448 N"), ("pound", "0.4536 kg")),
    "oz": (("ozf", "ounce-force, 0.278 N"), ("ounce", "0.02835 kg")),
    **dict.fromkeys(("ms-1", "ms^-1"), (("m/s", "metre per second"), ("kHz", "1/ms, a thousand times per second"))),
    **dict.fromkeys(
        ("kg/cm2", "kg/cm^2"),
        (("kgf/cm^2", "a pressure, 98066.5 Pa"), ("kilogram/cm^2", "a mass per area, 10000 kg/m^2")),
    ),
    "fps": (("ft/s", "feet per second"), ("Hz", "frames per second")),
}
_BENCH = (
    *(
        "1",
        "m",
        "m/s",
        "m/s^2",
        "m/s^3",
        "rad",
        "rad/s",
        "rad/s^2",
        "N",
        "N*m",
        "N/m",
        "N*s/m",
        "N*m/rad",
        "N*s",
        "N/s",
    ),
    *("Pa", "Pa/s", "Pa*s", "kg", "kg*m^2", "kg/m^3", "s", "Hz", "V", "A", "W", "K", "K/s", "ohm", "H", "T"),
    *("F", "C", "S", "m^2", "m^3", "m^3/s", "kg/m", "kg/m^2", "N/V", "m/V", "V/s", "1/m", "W/m^2", "N*m*s/rad"),
)
"""SI units of what a bench measures, in the way in which recordings write them."""
_SPELT = {"F": "farad", "C": "coulomb", "S": "siemens"}

_SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺", "0123456789-+")
_RAISED = re.compile("[⁻⁺]?[⁰¹²³⁴⁵⁶⁷⁸⁹]+")
_SAME = str.maketrans(
    {
        **dict.fromkeys("µμ", "u"),
        **dict.fromkeys("·⋅∙×", "*"),
        **dict.fromkeys("\u03a9\u2126", "ohm"),
        **dict.fromkeys("−–—", "-"),
        **dict.fromkeys("∕⁄", "/"),
        "℃": "degC",
        "℉": "degF",
    }
)
_BRACKETED = re.compile(r"\[([^\[\]]+)\]|<([^<>]+)>|\{([^{}]+)\}|\"([^\"]+)\"|'([^']+)'")
_PER = re.compile(r"(?<=[A-Za-z]) per (?=[A-Za-z])")
_BESIDE_MARK = re.compile(r" ?([*/]) ?")
_DEGREES = re.compile(r"[°º]\s*([CFKcf]?)(?![A-Za-z])")
_TOKEN = re.compile(r"\s*(?:(?P<symbol>[A-Za-z_]+|1(?=\s*/))(?:\^?(?P<power>[-+]?\d)(?![\d.]))?|(?P<mark>[*/()]))\s*")
_PRODUCT = re.compile(r"(?<=[A-Za-z0-9])[.-](?=[A-Za-z])")  # N.m, N-m
_LEVEL = re.compile(r"dB|Np\b", re.IGNORECASE)


class Meaning(NamedTuple):
    """A unit in SI: value = factor * number + shift, in `unit`."""

    unit: str
    factor: float
    shift: float = 0.0


class UnitFault(ValueError):
    """A unit that cannot be used; `ways`: how to write what it may be, each with a description."""

    def __init__(self, text: str, ways: tuple[tuple[str, str], ...] = ()) -> None:
        super().__init__(text)
        self.ways = ways


@cache
def meaning(text: str, target: str = "") -> Meaning:
    """What the unit `text` is in SI; with a `target` in that unit, which decides between two meanings.

    Raises UnitFault (a ValueError) for a unit that is unknown, has two meanings, is a level, is no quantity of a bench
    or does not convert to `target`.
    """
    written = _plain(text)
    if not written or len(written) > _LONGEST:
        raise UnitFault(f"{brief(text)} is unknown")
    if _LEVEL.match(written):
        raise UnitFault(f"{brief(text)} is a level, the logarithm of a quantity")
    ways = _ways(written)
    if not ways:
        return _of_one(written, target, text)
    fitting = list[Meaning]()
    for way, _ in ways:
        with suppress(UnitFault):
            fitting.append(_of_one(way, target, text))
    if len(fitting) == len(ways):
        raise UnitFault(f"{brief(text)} has two meanings", ways)
    return fitting[0] if fitting else _of_one(ways[0][0], target, text)


def is_unit(text: str) -> bool:
    """Whether a text is a unit that is known, or that has two meanings."""
    try:
        meaning(text)
    except UnitFault as fault:
        return bool(fault.ways or _LEVEL.match(text.strip()))
    return True


def is_time(text: str) -> bool:
    """Whether a text is a unit of time."""
    try:
        return meaning(text).unit == "s"
    except UnitFault:
        return False


def _plain(text: str) -> str:
    """A unit in the characters that the tables have, without brackets or quotes around it."""
    text = text.strip()
    if match := _BRACKETED.fullmatch(text):
        text = match[match.lastindex or 0].strip()
    text = _RAISED.sub(lambda match: f"^{match[0].translate(_SUPERSCRIPTS)}", text)
    text = text.replace("**", "^").translate(_SAME)
    text = _DEGREES.sub(lambda match: f"deg{match[1].upper()}", text)
    return _BESIDE_MARK.sub(r"\1", _PER.sub("/", " ".join(text.split())))


def _ways(written: str) -> tuple[tuple[str, str], ...]:
    """Both ways to write a unit of which one symbol, or the whole, has two meanings; none for others."""
    if written in _AMBIGUOUS:
        return _AMBIGUOUS[written]
    if written.lower() in _WHOLE:
        return ()
    for symbol in re.findall(r"[A-Za-z_]+", written):
        if symbol in _AMBIGUOUS:
            place = re.compile(rf"(?<![A-Za-z_]){symbol}(?![A-Za-z_])")
            return tuple((place.sub(way, written, count=1), told) for way, told in _AMBIGUOUS[symbol])
    return ()


def _of_one(written: str, target: str, text: str) -> Meaning:
    """The meaning of a unit without a symbol of two meanings."""
    whole = _whole(written)
    if whole in _RATIOS:
        return _converted(_RATIOS[whole], (), target, text)
    if whole == "mph":
        return _converted(_MPH, (("m", 1), ("s", -1)), target, text)
    if whole in ("degC", "degF"):
        factor = 1.0 if whole == "degC" else _FAHRENHEIT
        found = _converted(factor, (("K", 1),), target, text)
        return found._replace(shift=_ZERO_CELSIUS if whole == "degC" else 459.67 * _FAHRENHEIT)
    try:
        factor, powers = _parsed(whole)
    except UnitFault:
        raise UnitFault(f"{brief(text)} is unknown") from None
    named = _converted(factor, powers, target, text)
    energy = re.fullmatch(r"[umkM]?J", whole) and not target
    return named._replace(unit="J") if energy else named


def _whole(written: str) -> str:
    """The unit that a text is as a whole, or the text."""
    low = written.lower()
    return _WHOLE.get(low) or (written if written in _SYMBOLS else _WORDS.get(low, written))


def _converted(factor: float, powers: Powers, target: str, text: str) -> Meaning:
    """The quantity in its unit of a bench, or in `target`."""
    if target:
        if _parsed_target(target) != powers:
            raise UnitFault(f"{brief(text)} does not convert to {'1 (no unit)' if target == '1' else target}")
        return Meaning(target, factor)
    unit = _bench().get(powers)
    if unit is None:
        shown = "*".join(f"{base}^{power}" if power != 1 else base for base, power in powers)
        raise UnitFault(f"{brief(text)} is {shown}, which no bench measures")
    return Meaning(unit, factor)


@cache
def _bench() -> dict[Powers, str]:
    named: dict[Powers, str] = {}
    for unit in (*_BENCH, *SIZES):
        named.setdefault(_parsed_target(unit), unit)
    return named


@cache
def _parsed_target(unit: str) -> Powers:
    """The base units of an SI unit."""
    if unit == "1":
        return ()
    return _parsed(_SPELT.get(unit, unit))[1]


def _parsed(written: str) -> tuple[float, Powers]:
    """Size and base units of a product of symbols. Raises UnitFault."""
    text = _PRODUCT.sub("*", written)
    tokens = list[re.Match[str]]()
    place = 0
    while place < len(text):
        token = _TOKEN.match(text, place)
        if token is None:
            raise UnitFault(written)
        tokens.append(token)
        place = token.end()
    factor, powers, rest = _product(tokens, written)
    if rest:
        raise UnitFault(written)
    return factor, tuple(sorted((base, power) for base, power in powers.items() if power))


def _product(tokens: list[re.Match[str]], written: str) -> tuple[float, dict[str, int], list[re.Match[str]]]:
    """Size and base units up to the end or a closing bracket, and the tokens from there on."""
    factor = 1.0
    powers: dict[str, int] = {}
    sign = 1
    due = True  # a symbol has to follow
    while tokens and tokens[0]["mark"] != ")":
        token = tokens.pop(0)
        mark = token["mark"]
        if mark in ("*", "/"):
            if due:
                raise UnitFault(written)
            sign = -1 if mark == "/" else 1
            due = True
            continue
        if mark == "(":
            size, inner, tokens = _product(tokens, written)
            if not tokens:
                raise UnitFault(written)
            tokens.pop(0)
            power = 1
        else:
            size, inner = _symbol(token["symbol"], written)
            power = int(token["power"] or 1)
        factor *= size ** (sign * power)
        for base, exponent in inner.items():
            powers[base] = powers.get(base, 0) + sign * power * exponent
        sign = 1
        due = False
    if due:
        raise UnitFault(written)
    return factor, powers, tokens


def _symbol(symbol: str, written: str) -> tuple[float, dict[str, int]]:
    """Size and base units of one symbol. Raises UnitFault."""
    if symbol == "1":
        return 1.0, {}
    if symbol in _SYMBOLS:
        return _SYMBOLS[symbol][:2]
    prefix, base = symbol[:1], symbol[1:]
    if prefix in _PREFIXES and base in _SYMBOLS and prefix in _SYMBOLS[base][2]:
        size, powers, _ = _SYMBOLS[base]
        return _PREFIXES[prefix] * size, powers
    word = _WORDS.get(symbol.lower())
    if word is None:
        raise UnitFault(written)
    return _symbol(word, written)
