"""The result of a continuation: branches of points over a parameter, and their special points."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from rig.results import Column, Result, Table
from rig.scenes.axis import Axis
from rig.scenes.scene import Scene

if TYPE_CHECKING:
    from xarray import Dataset

SLIDING = "sliding"
REST = "rest in stick"
CYCLES = "cycles"
FORCED = "forced motion"
TURNS = {kind: f"{kind} fold" for kind in ("grazing", "lift-off", "landing")}
WORDS = {"unresolved": "not followed further", "hopf": "Hopf point"}
_ONE_POINT = 1e-8  # relative: values of one special point that is met twice
_ROUNDED = 1e-12  # relative: the values of points are rounded
_ENDS = {"range": "end of the range", "most": "largest number of points"}  # of a branch that are no special points


def named(kind: str, contact: str) -> str:
    """Return what a special point is, in words."""
    what = WORDS.get(kind, kind)
    return f"{what} ({contact})" if contact else what


@dataclass(frozen=True)
class Point:
    """A motion at one value (SI) of the parameter.

    `low`, `high`: of the output in a period; at rest in stick the ends of the interval. `period` [s]: NaN for an
    equilibrium. `stick`: share of the period in which a contact sticks. `multipliers`: Floquet multipliers without
    that of the shift, with their accuracy, relative to the larger of 1 and each; of an equilibrium its eigenvalues
    [1/s]. `residual`: by how much the motion misses its start, over the range of each state; `state`: by name.

    Multipliers are those of the motion through `state`. Beside a canard, motions whose parameters agree to all digits
    have others.
    """

    value: float
    low: float
    high: float
    stable: bool
    period: float = math.nan
    stick: float = 0.0
    multipliers: tuple[complex, ...] = ()
    multiplier_accuracy: float = math.nan
    residual: float = 0.0
    state: dict[str, float] = field(default_factory=dict, compare=False, repr=False)

    @property
    def largest_multiplier(self) -> float:
        """Size of the largest multiplier; NaN without one, as of an equilibrium."""
        if math.isnan(self.period):
            return math.nan
        return max(map(abs, self.multipliers), default=math.nan)

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {**asdict(self), "multipliers": [[m.real, m.imag] for m in self.multipliers]}

    @classmethod
    def of(cls, raw: dict[str, Any]) -> Point:
        """Return the point of `to_json`."""
        return cls(**{**raw, "multipliers": tuple(complex(*m) for m in raw["multipliers"])})


@dataclass(frozen=True)
class SpecialPoint:
    """A special point: `kind`, parameter (SI) with its accuracy, motion there, contact, whether the branch turns."""

    kind: str
    value: float
    accuracy: float
    low: float
    high: float
    period: float = math.nan
    contact: str = ""
    turns: bool = False
    why: str = ""

    @property
    def name(self) -> str:
        """What it is, in words."""
        return named(TURNS.get(self.kind, self.kind) if self.turns else self.kind, self.contact)

    def same(self, other: SpecialPoint) -> bool:
        """Whether both are one point, met from two sides: of one name, and nearer than their accuracies."""
        apart = abs(self.value - other.value)
        known = sum(point.accuracy for point in (self, other) if math.isfinite(point.accuracy))
        return self.name == other.name and apart <= max(known, _ONE_POINT * abs(self.value))


@dataclass(frozen=True)
class Branch:
    """Points with the same events in a period, in the order in which they were computed, and special points among them.

    `kind`: sliding, rest in stick, cycles or forced motion. `family`: branches with one number continue each other.
    `end`: the special point at which it stops.
    """

    kind: str
    family: int
    events: tuple[str, ...]
    points: tuple[Point, ...] = field(repr=False)
    specials: tuple[SpecialPoint, ...] = ()
    end: SpecialPoint | None = None

    @property
    def name(self) -> str:
        """The motion in words."""
        if self.kind in (SLIDING, REST):
            return self.kind
        if not self.events:
            return "slip"
        opened = dict.fromkeys(event[: -len(" opens")] for event in self.events if event.endswith(" opens"))
        turned = (event for event in self.events if event.endswith((" slip ends", " releases +", " releases -")))
        stuck = dict.fromkeys(event.rsplit(" ", 2)[0] for event in turned)
        parts = []
        if stuck:
            how = "stick-slip" if any(point.stick for point in self.points) else "reversal"
            parts.append(f"{how}: {', '.join(stuck)}")
        if opened:
            parts.append(f"lift-off: {', '.join(opened)}")
        return "; ".join(parts) or ", ".join(self.events)

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {
            "kind": self.kind,
            "family": self.family,
            "name": self.name,
            "events": list(self.events),
            "points": [point.to_json() for point in self.points],
            "specials": [asdict(special) for special in self.specials],
            "end": self.end and asdict(self.end),
        }

    @classmethod
    def of(cls, raw: dict[str, Any]) -> Branch:
        """Return the branch of `to_json`."""
        points = tuple(Point.of(point) for point in raw["points"])
        specials = tuple(SpecialPoint(**special) for special in raw["specials"])
        end = raw["end"] and SpecialPoint(**raw["end"])
        return cls(raw["kind"], raw["family"], tuple(raw["events"]), points, specials, end)


@dataclass(frozen=True)
class Branches(Result):
    """Branches over `axis` of the `output` with its `unit`; `notes`: what was not computed, and why."""

    FIGURE: ClassVar = "rig.analysis.branches.figure:branches_figure"

    scene: Scene
    axis: Axis
    output: str
    unit: str
    branches: tuple[Branch, ...]
    notes: tuple[str, ...] = ()
    folder: Path | None = None

    @property
    def specials(self) -> tuple[SpecialPoint, ...]:
        """All special points by value, each once; ends of the range are left out."""
        met: list[SpecialPoint] = []
        for branch in self.branches:
            ends = [branch.end] if branch.end else []
            met += [special for special in (*branch.specials, *ends) if special.kind not in _ENDS]
        kept: list[SpecialPoint] = []
        for special in sorted(met, key=lambda special: special.value):
            if not any(special.same(other) for other in kept):
                kept.append(special)
        return tuple(kept)

    def special(self, kind: str) -> list[float]:
        """Return the values (SI) of the special points of a kind, such as "hopf", "grazing", "jump"."""
        return [special.value for special in self.specials if special.kind == kind]

    def shown(self) -> Iterator[str | Table]:
        """Yield the special points, the branches, and what was not computed."""
        axis = self.axis
        low = axis.text(min(axis.values))
        high = axis.text(max(axis.values))
        yield f"{self.scene.name}: branches over {axis.label} from {low} to {high}, output {self.output}\n"
        yield self._special_points() if self.specials else "  no special point"
        rows: list[tuple[Any, ...]] = []
        for branch in self.branches:
            begin, last = (branch.points[i].value for i in (0, -1)) if branch.points else (math.nan, math.nan)
            end = "" if branch.end is None else self._end(branch.end)
            rows.append((branch.name, len(branch.points), begin, last, _stability(branch.points), end))
        ends = (axis.column(name, ".8g") for name in ("from", "to"))
        columns = (Column("branch"), Column("points", digits=".0f"), *ends, Column("stability"), Column("ends at"))
        yield ""
        yield Table("branches", columns, rows)
        worst = max((point.residual for *_, point in self.points()), default=0.0)
        yield f"\n  largest residual of a return map: {worst:.1e} of the range of each state"
        known = [a for *_, point in self.points() if (a := point.multiplier_accuracy) == a]
        if known:
            yield f"  accuracy of the multipliers: {max(known):.0e} of the larger of 1 and their size, or better"
        yield from (f"  {note}" for note in self.notes)

    def _special_points(self) -> Table:
        accuracy = self.axis.column("accuracy", ".0e")
        place = (self.axis.column(digits=".12g"), accuracy, Column("period", "s", ".8g"))
        rows = [
            (special.name, special.value, special.accuracy, special.period, special.why) for special in self.specials
        ]
        return Table("specials", (Column("name"), *place, Column("why")), rows)

    def _end(self, end: SpecialPoint) -> str:
        return _ENDS.get(end.kind, end.name)

    def _last(self, branch: Branch) -> str:
        """Where a branch ends, with the value in SI."""
        return f"{self._end(branch.end)}, {branch.end.value:.12g} {self.axis.unit}" if branch.end else ""

    def facts(self) -> dict[str, Any]:
        """Return the branches with all points; parameters in SI."""
        return {
            "scene": self.scene.name,
            "key": self.axis.key,
            "unit": self.axis.unit,
            "range": [min(self.axis.values), max(self.axis.values)],
            "output": self.output,
            "output_unit": self.unit,
            "branches": [branch.to_json() for branch in self.branches],
            "specials": [{"name": special.name, **asdict(special)} for special in self.specials],
            "notes": list(self.notes),
            "folder": str(self.folder) if self.folder else None,
        }

    def points(self) -> Iterator[tuple[int, Branch, Point]]:
        """Yield number of the branch, branch and point, in their order."""
        for number, branch in enumerate(self.branches):
            for point in branch.points:
                yield number, branch, point

    def to_xarray(self) -> Dataset:
        """Return all points as a Dataset over `point`, and the special points over `special`; units as attributes."""
        from rig.extras import needed

        xarray: Any = needed("xarray", "data")
        branch_of = []
        numbers = []
        points = []
        for number, branch, point in self.points():
            numbers.append(number)
            branch_of.append(branch.name)
            points.append(point)
        specials = self.specials
        of_output = {"units": self.unit}
        of_axis = {"units": self.axis.unit}
        seconds = {"units": "s"}
        variables = {
            "low": ("point", [point.low for point in points], of_output),
            "high": ("point", [point.high for point in points], of_output),
            "period": ("point", [point.period for point in points], seconds),
            "stick_share": ("point", [point.stick for point in points]),
            "stable": ("point", [point.stable for point in points]),
            "multiplier": ("point", [point.largest_multiplier for point in points]),
            "multiplier_accuracy": ("point", [point.multiplier_accuracy for point in points]),
            "motion": ("point", branch_of),
            "special_kind": ("special", [special.name for special in specials]),
            "special_accuracy": ("special", [special.accuracy for special in specials], of_axis),
            "special_why": ("special", [special.why for special in specials]),
            "special_period": ("special", [special.period for special in specials], seconds),
        }
        coordinates = {
            "branch": ("point", numbers),
            self.axis.key: ("point", [point.value for point in points], of_axis),
            "special_value": ("special", [special.value for special in specials], of_axis),
        }
        dataset: Dataset = xarray.Dataset(variables, coordinates, {"scene": self.scene.name})
        return dataset

    def listed(self) -> Table:
        """Return a row for each point of each branch."""
        output = (Column("low", self.unit), Column("high", self.unit))
        names = ("stick share", "stable", "largest multiplier", "multiplier accuracy", "branch ends at")
        rest = (Column(name) for name in names)
        columns = (Column("branch"), Column("motion"), self.axis.column(), *output, Column("period", "s"), *rest)
        rows = []
        for number, branch, point in self.points():
            end = self._last(branch) if point is branch.points[-1] else ""
            row = [number, branch.name, point.value, point.low, point.high, point.period, point.stick]
            multiplier = _with_known_digits(point.largest_multiplier, point.multiplier_accuracy)
            rows.append([*row, int(point.stable), multiplier, point.multiplier_accuracy, end])
        return Table("points", columns, rows)

    def at(self, value: float) -> list[tuple[Branch, Point]]:
        """Return the motions at a value (SI) of the parameter, interpolated between neighbouring points."""
        out = []
        for branch in self.branches:
            for a, b in zip(branch.points, branch.points[1:]):
                low, high = sorted((a.value, b.value))
                if low - _ROUNDED * abs(low) <= value <= high + _ROUNDED * abs(high) and low != high:
                    out.append((branch, _between(a, b, value)))
        return out


def _with_known_digits(multiplier: float, accuracy: float) -> float:
    """A multiplier with the digits that its accuracy tells."""
    if not (0.0 < accuracy < 1.0 and math.isfinite(multiplier)):
        return multiplier
    return round(multiplier, math.ceil(-math.log10(accuracy * max(1.0, multiplier))))


def _stability(points: Sequence[Point]) -> str:
    stable = {point.stable for point in points}
    if len(stable) > 1:
        return "stable and unstable"
    return "stable" if True in stable else "unstable"


def _between(a: Point, b: Point, value: float) -> Point:
    """The motion at a value between two points, interpolated; its stability and multipliers are those of the nearer."""
    share = (value - a.value) / (b.value - a.value)

    def interpolated(x: float, y: float) -> float:
        return float(np.interp(share, [0.0, 1.0], [x, y]))

    low = interpolated(a.low, b.low)
    high = interpolated(a.high, b.high)
    period = interpolated(a.period, b.period)
    stick = interpolated(a.stick, b.stick)
    near = a if share < 0.5 else b
    return Point(value, low, high, near.stable, period, stick, near.multipliers, near.multiplier_accuracy)
