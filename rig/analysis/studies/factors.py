"""The parameters that a study varies: values of a grid, or a distribution, in Python or as text, normal(0.4, 0.02).

And the condition of the recordings that a study keeps: a measure beyond a level, such as "cycle.amplitude > 5 mm".
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rig.analysis.studies.measures import Measure
from rig.errors import SceneError, UsageError
from rig.quantities import Condition
from rig.scenes.axis import Axis, in_words, numbers, unknown, value_count
from rig.scenes.faults import near, shortened
from rig.scenes.scene import Scene
from rig.units import brief, number_or_text, parted, si, with_units

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
IDENTIFIED = "identified"
FORM = 'expected values such as [10, 20], "10 N:30 N:5", "10 N, 20 N" or "normal(20 N, 2 N)"'


def check_once(over: Any, overrides: Mapping[str, Any] | None, untold: Mapping[str, Any] | None) -> None:
    """Raise UsageError for a key that is varied and has a value of its own too."""
    for option, given in (("-p, overrides", overrides), ("--untold, untold", untold)):
        for key in given or ():
            if isinstance(over, Mapping) and key in over:
                raise UsageError(f"over {key}: is stated as one value as well ({option}); leave one of the two out")


@dataclass(frozen=True)
class Distribution:
    """A distribution `kind` with its values by name: numbers in SI, or texts with a unit."""

    kind: str
    values: tuple[tuple[str, float | str], ...]

    @classmethod
    def parse(cls, text: str) -> Distribution:
        """Parse "normal(20 N, 2 N)" or "normal(0.4, 0.1, low=0.2)". Raises UsageError."""
        form = _TEXT.fullmatch(text)
        if form is None or form["kind"] not in FORMS:
            known = ", ".join(f"{kind}({', '.join(names)})" for kind, names in FORMS.items())
            raise UsageError(f"{text.strip()}: no distribution; known: {known}")
        given: dict[str, str] = {}
        names = list(FORMS[form["kind"]])
        for part in filter(None, (part.strip() for part in form["values"].split(","))):
            name, equals, value = (text.strip() for text in part.partition("="))
            if not equals:
                name = names.pop(0) if names else ""
                value = part
            if name in given and name:
                raise UsageError(f"{text.strip()}: {name} is given twice")
            given[name] = value
        alike = [name for name in given if (form["kind"], name) != _OF_LOGARITHM]
        try:
            given |= dict(zip(alike, with_units([given[name] for name in alike])))
        except ValueError as fault:
            raise UsageError(f"{text.strip()}: {fault}") from None
        return made(form["kind"], {name: number_or_text(value) for name, value in given.items()})

    def __str__(self) -> str:
        texts = ((name, f"{value:g}" if isinstance(value, float | int) else value) for name, value in self.values)
        named = (text if name in FORMS[self.kind] else f"{name}={text}" for name, text in texts)
        return f"{self.kind}({', '.join(named)})"

    def in_si(self, unit: str) -> dict[str, float]:
        """Return its values in `unit`, the SI unit of the parameter. Raises ValueError for a wrong value or unit."""
        in_unit = {}
        for name, value in self.values:
            plain = "1" if (self.kind, name) == _OF_LOGARITHM else unit
            try:
                in_unit[name] = si(value, plain)
            except ValueError as fault:
                raise ValueError(f"{self}: {name} {fault}") from None
        _check(str(self), self.kind, in_unit)
        return in_unit

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
    missing = ", ".join(name for name in names if name not in given)
    excess = ", ".join(name or "one value too many" for name in given if name not in allowed)
    if what := [f"{missing} missing"] * bool(missing) + [f"{excess} not expected"] * bool(excess):
        raise UsageError(f"{kind}: {'; '.join(what)}; expected {form}")
    values: list[tuple[str, float | str]] = []
    for name in dict.fromkeys(allowed):
        if (value := given.get(name)) is not None:
            try:
                values.append((name, value if isinstance(value, str) else si(value, "1")))
            except ValueError:
                message = f"{kind}: {name} is {brief(value)}; expected a number or a text with a unit"
                raise UsageError(message) from None
    numbers = {name: value for name, value in values if isinstance(value, float)}
    distribution = Distribution(kind, tuple(values))
    if len(numbers) == len(values):
        try:
            _check(str(distribution), kind, numbers)
        except ValueError as fault:
            raise UsageError(str(fault)) from None
    return distribution


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


@dataclass(frozen=True)
class Identified:
    """One parameter of the joint distribution that `rig identify` wrote into a file (NAME.covariance.json).

    Parameters of one file are drawn together, with their correlations.
    """

    file: str
    key: str
    content: str = field(repr=False)
    """Of the file: results depend on it."""
    kind: ClassVar[str] = IDENTIFIED

    @classmethod
    def read(cls, text: str, key: str) -> Identified:
        """Read "identified(FILE)". Raises UsageError."""
        form = _TEXT.fullmatch(text)
        file = form["values"].strip() if form else ""
        if form is None or form["kind"] != IDENTIFIED or not file:
            raise UsageError(f"{text.strip()}: expected {IDENTIFIED}(FILE), the covariance that rig identify wrote")
        try:
            content = Path(file).read_text("utf-8")
        except OSError as fault:
            raise UsageError(f"{file}: cannot be read: {fault.strerror}") from None
        except UnicodeDecodeError:
            content = ""
        known = _identified(content)
        if not known:
            raise UsageError(f"{file}: is no covariance of rig identify (NAME.covariance.json)")
        if key not in known:
            raise UsageError(f"{file} has no {key}; {near(key, known, 'it has ' + ', '.join(known))}")
        return cls(file, key, content)

    def in_si(self, unit: str) -> None:
        """Raise ValueError if its unit is another one than that of the parameter."""
        stated = next(row["unit"] for row in json.loads(self.content)["parameters"] if row["key"] == self.key)
        if stated != unit:
            raise ValueError(f"{self.file}: {self.key} is in {stated}, here in {unit}")

    def __str__(self) -> str:
        return f"{IDENTIFIED}({self.file})"

    @staticmethod
    def drawn(together: Sequence[Identified], shares: Array) -> Array:
        """The values [sample, parameter] of parameters of one file, from independent shares of the same shape."""
        from scipy import stats

        stored = json.loads(together[0].content)
        order = [row["key"] for row in stored["parameters"]]
        index = [order.index(each.key) for each in together]
        rows = [stored["parameters"][i] for i in index]
        C = np.array(stored["covariance"], dtype=np.float64)[np.ix_(index, index)]
        z = stats.norm.ppf(shares) @ np.linalg.cholesky(C).T
        values = [
            np.exp(math.log(row["value"]) + column) if row["log"] else row["value"] + row["size"] * column
            for row, column in zip(rows, z.T)
        ]
        return np.column_stack([np.clip(v, row["from"], row["to"]) for v, row in zip(values, rows)])


def _identified(content: str) -> list[str]:
    """The keys of a covariance that rig identify has written; none of anything else."""
    try:
        stored = json.loads(content)
        rows = stored["parameters"]
        numbers = [[float(row[name]) for name in ("value", "size", "from", "to")] for row in rows]
        known = [str(row["key"]) for row in rows if isinstance(row["unit"], str) and isinstance(row["log"], bool)]
        C = np.array(stored["covariance"], dtype=np.float64)
        np.linalg.cholesky(C)
    except (ValueError, KeyError, TypeError, np.linalg.LinAlgError):
        return []
    positive = all(value > 0.0 for (value, *_), row in zip(numbers, rows) if row["log"])
    whole = positive and not np.isnan(numbers).any() and np.isfinite(C).all()
    return known if whole and C.shape == (len(rows), len(rows)) == (len(known), len(known)) else []


def drawn(given: Sequence[Distribution | Identified], units: Sequence[str], shares: Array) -> Array:
    """Return the values [sample, parameter] of distributions, each in its unit, at shares of the same shape.

    Parameters that were identified together are drawn together.
    """
    values = np.zeros_like(shares)
    joint: dict[str, list[int]] = {}
    for i, each in enumerate(given):
        if isinstance(each, Identified):
            joint.setdefault(each.file, []).append(i)
        else:
            values[:, i] = each.quantile(shares[:, i], units[i])
    for index in joint.values():
        together = [each for i in index if isinstance(each := given[i], Identified)]
        values[:, index] = Identified.drawn(together, shares[:, index])
    return values


@dataclass(frozen=True)
class Factor:
    """A varied parameter: the values of `axis`, or with `distribution` values drawn from it."""

    axis: Axis
    distribution: Distribution | Identified | None = None

    @property
    def key(self) -> str:
        """Dotted key of the parameter."""
        return self.axis.key


def factors(scene: Scene, over: Mapping[str, Any]) -> tuple[Factor, ...]:
    """Return the factors of `over`: key -> values, text or distribution. Raises SceneError with every fault."""
    if not isinstance(over, Mapping):
        raise SceneError(
            scene.name, [f'over = {brief(over)}: expected keys with values, such as {{"load.force": [10, 20]}}']
        )
    known = numbers(scene)
    varied = []
    faults = []
    for key, given in over.items():
        if key not in known:
            faults.append(unknown(str(key), known, scene))
            continue
        try:
            varied.append(_factor(scene, key, known[key], given))
        except (ValueError, UsageError) as fault:
            faults.append(f"{key}: {fault}")
        except SceneError as error:
            faults += error.faults
    if not over:
        faults.append(f"no parameter is varied; {FORM}")
    if faults:
        raise SceneError(scene.name, faults)
    return tuple(varied)


def ranges(scene: Scene, over: Mapping[str, Any]) -> tuple[Factor, ...]:
    """Return the factors of ranges, with both ends as values: key -> "10 N:30 N" or (10.0, 30.0).

    Raises SceneError with every fault.
    """
    pairs = {key: pair(given) for key, given in over.items()} if isinstance(over, Mapping) else {}
    faults = [f'{key}: expected a range FROM:TO, such as "10 N:30 N"' for key, ends in pairs.items() if ends is None]
    given = {key: ends for key, ends in pairs.items() if ends is not None}
    varied: tuple[Factor, ...] = ()
    try:
        varied = factors(scene, given if pairs else over) if given or not pairs else ()
    except SceneError as error:
        faults += error.faults
    for factor in varied:
        low, high = factor.axis.values
        if not low < high:
            faults.append(f"{factor.key}: the range must rise, from {factor.axis.text(low)} upwards")
    if faults:
        raise SceneError(scene.name, faults)
    return varied


def pair(given: Any) -> Any:
    """Return both ends of a range, "10 N:30 N" or two numbers, as a list of values; None for what is no range."""
    if isinstance(given, str):
        parts = [part.strip() for part in given.split(":")]
        if len(parts) != 2 or not all(parts) or "," in given:
            return None
        return ", ".join(parts)
    if not isinstance(given, Sequence | np.ndarray) or len(given) != 2 or "" in map(str, given):
        return None
    return list(given)


def _factor(scene: Scene, key: str, unit: str, given: Any) -> Factor:
    if isinstance(given, str) and given.strip().startswith(f"{IDENTIFIED}("):
        given = Identified.read(given, key)
    elif isinstance(given, str) and "(" in given:
        given = Distribution.parse(given)
    words = in_words(key, scene)
    if isinstance(given, Distribution | Identified):
        given.in_si(unit)  # the values have units that fit
        return Factor(Axis(key, unit, (), unit, words=words), given)
    values, shown = _spaced(given, unit) if isinstance(given, str) and ":" in given else listed(given, unit)
    if not values:
        raise ValueError(f"the list is empty; {FORM}")
    if len(set(values)) < len(values):
        raise ValueError("a value is given twice")
    axis = Axis(key, unit, tuple(values), shown, words)
    axis.check(scene, values)
    return Factor(axis)


def _spaced(given: str, unit: str) -> tuple[list[float], str]:
    """The evenly spaced values of FROM:TO:COUNT in SI, and the unit in which they are shown."""
    parts = [part.strip() for part in given.split(":")]
    if len(parts) != 3 or not all(parts):
        raise ValueError(f"{shortened(given)}: {FORM}")
    count = value_count(parts[2])
    if any("," in part for part in parts):
        raise ValueError(f"{shortened(given)}: {FORM}; a number has a point, 0.5, not a comma")
    (low, high), shown = listed(f"{parts[0]}, {parts[1]}", unit)
    return np.linspace(low, high, count).tolist(), shown


def listed(given: Any, unit: str) -> tuple[list[float], str]:
    """Return the values of a list in SI, and the unit in which they are shown. Raises ValueError."""
    if isinstance(given, str):
        texts = with_units([part for part in map(str.strip, given.split(",")) if part])
        parts: list[Any] = [text if parted(text)[1] else number_or_text(text) for text in texts]
    elif isinstance(given, Iterable) and not isinstance(given, bytes | Mapping) and getattr(given, "shape", 1) != ():
        parts = list(given)
    else:
        parts = [given]
    units = {parted(part)[1] for part in parts if isinstance(part, str)} - {"", "1"}
    values = []
    for part in parts:
        value = si(part, unit)
        if not np.isfinite(value):
            raise ValueError(f"{brief(part)} is not finite")
        values.append(value)
    return values, units.pop() if len(units) == 1 else unit


def condition(text: str, measures: Sequence[Measure]) -> tuple[int, Callable[[float], bool]]:
    """Read "MEASURE > VALUE UNIT" or "MEASURE < VALUE UNIT": number of the measure, and whether a value meets it.

    A missing value (nan) does not. Raises UsageError.
    """
    given = Condition.read(text, "keep", "<>", 'MEASURE > VALUE or MEASURE < VALUE, such as "cycle.amplitude > 5 mm"')
    names = [measure.name for measure in measures]
    if given.name not in names:
        raise UsageError(f"keep {text}: {given.name} is not a measure of this study; {near(given.name, names)}")
    number = names.index(given.name)
    level = given.level_in(measures[number].unit or "1")
    return number, (lambda value: value > level) if given.sense == ">" else (lambda value: value < level)
