"""Distributions of a parameter: normal, lognormal, uniform, triangular; in Python or as text, normal(0.4, 0.02)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.units import brief, si, with_units

Array = NDArray[np.float64]
FORMS = {
    "normal": ("mean", "deviation"),
    "lognormal": ("median", "deviation"),
    "uniform": ("low", "high"),
    "triangular": ("low", "mode", "high"),
}
"""Name of a distribution -> names of its values."""
_CUT = ("normal", "lognormal")  # these reach to infinity and may be cut off at low and high
_OF_LOGARITHM = ("lognormal", "deviation")  # without a unit
_FARTHEST = 37.0  # deviations: beyond, a normal distribution has no share that a double holds
_TEXT = re.compile(r"\s*(?P<kind>\w+)\s*\((?P<values>[^()]*)\)\s*")


@dataclass(frozen=True)
class Distribution:
    """A distribution `kind` with its values by name: numbers in SI, or texts with a unit."""

    kind: str
    values: tuple[tuple[str, float | str], ...]

    @classmethod
    def parse(cls, text: str) -> Distribution:
        """Parse "normal(20 N, 2 N)" or "normal(0.4, 0.1, low=0.2)". Raises UsageError."""
        found = _TEXT.fullmatch(text)
        if found is None or found["kind"] not in FORMS:
            known = ", ".join(f"{kind}({', '.join(names)})" for kind, names in FORMS.items())
            raise UsageError(f"{text.strip()}: no distribution; known: {known}")
        given: dict[str, str] = {}
        names = list(FORMS[found["kind"]])
        for part in filter(None, (part.strip() for part in found["values"].split(","))):
            name, equals, value = (text.strip() for text in part.partition("="))
            if not equals:
                name, value = names.pop(0) if names else "", part
            if name in given and name:
                raise UsageError(f"{text.strip()}: {name} is given twice")
            given[name] = value
        alike = [name for name in given if (found["kind"], name) != _OF_LOGARITHM]
        try:
            given |= dict(zip(alike, with_units([given[name] for name in alike])))
        except ValueError as fault:
            raise UsageError(f"{text.strip()}: {fault}") from None
        return made(found["kind"], {name: _number(value) for name, value in given.items()})

    def __str__(self) -> str:
        texts = [f"{value:g}" if isinstance(value, float | int) else value for _, value in self.values]
        named = [text if name in FORMS[self.kind] else f"{name}={text}" for (name, _), text in zip(self.values, texts)]
        return f"{self.kind}({', '.join(named)})"

    def in_si(self, unit: str) -> dict[str, float]:
        """Return its values in `unit`, the SI unit of the parameter. Raises ValueError for a wrong value or unit."""
        found = {}
        for name, value in self.values:
            plain = "1" if (self.kind, name) == _OF_LOGARITHM else unit
            try:
                found[name] = si(value, plain)
            except ValueError as fault:
                raise ValueError(f"{self}: {name} {fault}") from None
        _check(str(self), self.kind, found)
        return found

    def quantile(self, share: Array, unit: str) -> Array:
        """Return the values in `unit` below which `share` of the distribution lies, of the same shape."""
        from scipy import stats

        v = self.in_si(unit)
        if self.kind == "uniform":
            return v["low"] + (v["high"] - v["low"]) * share
        if self.kind == "triangular":
            span = v["high"] - v["low"]
            return np.asarray(stats.triang.ppf(share, (v["mode"] - v["low"]) / span, v["low"], span), dtype=np.float64)
        a, b = _cuts(self.kind, v)
        if a > 0.0:  # the shares above are exact there, those below are close to 1
            below, above = stats.norm.sf([a, b])
            z = stats.norm.isf(below + (above - below) * share)
        else:
            below, above = stats.norm.cdf([a, b])
            z = stats.norm.ppf(below + (above - below) * share)
        if self.kind == "normal":
            return np.asarray(v["mean"] + v["deviation"] * z, dtype=np.float64)
        with np.errstate(over="ignore"):  # what is infinite then, no parameter takes
            return np.asarray(v["median"] * np.exp(v["deviation"] * z), dtype=np.float64)


def _cuts(kind: str, v: dict[str, float]) -> tuple[float, float]:
    """The cuts `low` and `high` of a normal or lognormal distribution, in deviations from its centre."""
    low, high = v.get("low", -np.inf), v.get("high", np.inf)
    if kind == "normal":
        return (low - v["mean"]) / v["deviation"], (high - v["mean"]) / v["deviation"]
    with np.errstate(divide="ignore"):
        return tuple(float(np.log(max(end, 0.0) / v["median"])) / v["deviation"] for end in (low, high))  # type: ignore[return-value]


def made(kind: str, given: dict[str, Any]) -> Distribution:
    """Return the distribution `kind` of values by name. Raises UsageError for missing and unknown ones."""
    names = FORMS[kind]
    allowed = (*names, "low", "high") if kind in _CUT else names
    form = f"{kind}({', '.join(names)}{', low=..., high=...' if kind in _CUT else ''})"
    missing = [name for name in names if name not in given]
    unknown = [name for name in given if name not in allowed]
    if missing or unknown:
        what = [f"{', '.join(missing)} missing"] if missing else []
        what += [f"{', '.join(name or 'one value too many' for name in unknown)} not expected"] if unknown else []
        raise UsageError(f"{kind}: {'; '.join(what)}; expected {form}")
    found = Distribution(
        kind,
        tuple(
            (name, _plain(kind, name, given[name])) for name in dict.fromkeys(allowed) if given.get(name) is not None
        ),
    )
    if all(isinstance(value, float) for _, value in found.values):
        try:
            _check(str(found), kind, {name: float(value) for name, value in found.values})
        except ValueError as fault:
            raise UsageError(str(fault)) from None
    return found


def _plain(kind: str, name: str, value: Any) -> float | str:
    """A value as a number or a text. Raises UsageError for anything else."""
    if isinstance(value, str):
        return value
    try:
        return si(value, "1")
    except ValueError:
        raise UsageError(f"{kind}: {name} is {brief(value)}; expected a number or a text with a unit") from None


def _check(text: str, kind: str, v: dict[str, float]) -> None:
    """Raise ValueError for values that make no distribution."""
    if not np.isfinite(list(v.values())).all():
        raise ValueError(f"{text}: the values must be finite")
    if "deviation" in v and not v["deviation"] > 0.0:
        raise ValueError(f"{text}: deviation must be greater than 0")
    if kind == "lognormal" and not v["median"] > 0.0:
        raise ValueError(f"{text}: median must be greater than 0")
    if "low" in v and "high" in v and not v["low"] < v["high"]:
        raise ValueError(f"{text}: low must be less than high")
    if kind in _CUT:
        low, high = _cuts(kind, v)
        if not (low < _FARTHEST and high > -_FARTHEST):
            raise ValueError(f"{text}: no value of the distribution lies between low and high")
    if kind == "triangular" and not v["low"] <= v["mode"] <= v["high"]:
        raise ValueError(f"{text}: mode must lie between low and high")


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
