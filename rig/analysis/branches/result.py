"""The result of a continuation: branches of points over a parameter, and their special points."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from rig.analysis.axis import Axis, with_unit
from rig.machine.files import csv_table
from rig.printable import columns
from rig.results import Result
from rig.scenes.scene import Scene

if TYPE_CHECKING:
    from xarray import Dataset

SLIDING, REST, CYCLES, FORCED = "sliding", "rest in stick", "cycles", "forced motion"
TURNS = {kind: f"{kind} fold" for kind in ("grazing", "lift-off", "landing")}
_ROUNDED = 1e-12
WORDS = {"unresolved": "not followed further", "hopf": "Hopf point"}


def named(kind: str, contact: str) -> str:
    """Return what a special point is, in words."""
    what = WORDS.get(kind, kind)
    return f"{what} ({contact})" if contact else what


@dataclass(frozen=True)
class Point:
    """A motion at one value (SI) of the parameter.

    `low`, `high`: of the output in a period; at rest in stick the ends of the interval. `period` [s]: NaN for an
    equilibrium. `stick`: share of the period in which a contact sticks. `multipliers`: Floquet multipliers without
    that of the shift; of an equilibrium its eigenvalues [1/s]. `residual`: by how much the motion misses its start,
    over the range of each state; `state`: by name.
    """

    value: float
    low: float
    high: float
    stable: bool
    period: float = math.nan
    stick: float = 0.0
    multipliers: tuple[complex, ...] = ()
    residual: float = 0.0
    state: dict[str, float] = field(default_factory=dict, compare=False, repr=False)

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
        opened = dict.fromkeys(event[: -len(" opens")] for event in self.events if event.endswith(" opens"))
        turned = (event for event in self.events if event.endswith((" slip ends", " releases +", " releases -")))
        stuck = dict.fromkeys(event.rsplit(" ", 2)[0] for event in turned)
        how = "stick-slip" if any(p.stick for p in self.points) else "reversal"
        parts = [f"{how}: {', '.join(stuck)}"] if stuck else []
        parts += [f"lift-off: {', '.join(opened)}"] if opened else []
        return "; ".join(parts) or ("slip" if not self.events else ", ".join(self.events))

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
        return cls(
            raw["kind"],
            raw["family"],
            tuple(raw["events"]),
            tuple(Point.of(point) for point in raw["points"]),
            tuple(SpecialPoint(**special) for special in raw["specials"]),
            raw["end"] and SpecialPoint(**raw["end"]),
        )


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
        """All special points, ends of the range left out, by value."""
        every = [s for branch in self.branches for s in (*branch.specials, *([branch.end] if branch.end else []))]
        kept: dict[tuple[str, float], SpecialPoint] = {}
        for special in every:
            if special.kind not in ("range", "most"):
                kept.setdefault((special.name, float(f"{special.value:.9g}")), special)
        return tuple(sorted(kept.values(), key=lambda special: special.value))

    def special(self, kind: str) -> list[float]:
        """Return the values (SI) of the special points of a kind, such as "hopf", "grazing", "jump"."""
        return [special.value for special in self.specials if special.kind == kind]

    def text(self) -> str:
        """Return the report as text."""
        axis = self.axis
        low, high = axis.text(min(axis.values)), axis.text(max(axis.values))
        lines = [f"{self.scene.name}: branches over {axis.label} from {low} to {high}, output {self.output}", ""]
        rows: list[tuple[str, ...]] = [("special point", axis.label, "accuracy", "period s", "")]
        for special in self.specials:
            period = f"{special.period:.8g}" if special.period == special.period else ""
            at = f"{special.value / axis.scale:.12g}"
            accuracy = f"{special.accuracy / axis.scale:.0e}" if math.isfinite(special.accuracy) else ""
            rows.append((special.name, at, accuracy, period, special.why))
        lines += columns(rows, "<>>><") if len(rows) > 1 else ["  no special point"]
        rows = [("branch", "points", "from", "to", "stability", "ends at")]
        for branch in self.branches:
            if branch.points:
                first, last = (axis.text(branch.points[i].value, 8) for i in (0, -1))
                stable = {point.stable for point in branch.points}
                how = "stable and unstable" if len(stable) > 1 else "stable" if True in stable else "unstable"
                end = "" if branch.end is None else self._end(branch.end)
                rows.append((branch.name, str(len(branch.points)), first, last, how, end))
        lines += ["", *columns(rows, "<>>><<")]
        worst = max((p.residual for b in self.branches for p in b.points), default=0.0)
        lines += ["", f"  largest residual of a return map: {worst:.1e} of the range of each state"]
        return "\n".join([*lines, *(f"  {note}" for note in self.notes)])

    def _end(self, end: SpecialPoint) -> str:
        words = {"range": "end of the range", "most": "largest number of points"}
        return words.get(end.kind, end.name)

    def _last(self, branch: Branch) -> str:
        """Where a branch ends, with the value in SI."""
        return f"{self._end(branch.end)}, {branch.end.value:.12g} {self.axis.unit}" if branch.end else ""

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values; parameters in SI."""
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
        every, specials = list(self.points()), self.specials
        unit = {"units": self.unit}
        made: Dataset = xarray.Dataset(
            {
                "low": ("point", [p.low for *_, p in every], unit),
                "high": ("point", [p.high for *_, p in every], unit),
                "period": ("point", [p.period for *_, p in every], {"units": "s"}),
                "stick_share": ("point", [p.stick for *_, p in every]),
                "stable": ("point", [p.stable for *_, p in every]),
                "multiplier": ("point", [max(map(abs, p.multipliers), default=math.nan) for *_, p in every]),
                "motion": ("point", [b.name for _, b, _ in every]),
                "special_kind": ("special", [s.name for s in specials]),
                "special_accuracy": ("special", [s.accuracy for s in specials], {"units": self.axis.unit}),
                "special_why": ("special", [s.why for s in specials]),
                "special_period": ("special", [s.period for s in specials], {"units": "s"}),
            },
            {
                "branch": ("point", [n for n, *_ in every]),
                self.axis.key: ("point", [p.value for *_, p in every], {"units": self.axis.unit}),
                "special_value": ("special", [s.value for s in specials], {"units": self.axis.unit}),
            },
            {"scene": self.scene.name},
        )
        return made

    def csv(self) -> str:
        """Return every point as a line of a CSV file; the head names the units."""
        head = ["branch", "motion", self.axis.si_label, with_unit("low", self.unit), with_unit("high", self.unit)]
        head += ["period [s]", "stick share", "stable", "largest multiplier", "branch ends at"]
        rows = [
            [number, b.name, p.value, p.low, p.high, p.period, p.stick, int(p.stable),
             max(map(abs, p.multipliers), default=math.nan), self._last(b) if p is b.points[-1] else ""]
            for number, b, p in self.points()
        ]  # fmt: skip
        return csv_table([head, *rows]).decode()

    def at(self, value: float) -> list[tuple[Branch, Point]]:
        """Return the motions at a value (SI) of the parameter, interpolated between neighbouring points."""
        out = []
        for branch in self.branches:
            for a, b in zip(branch.points, branch.points[1:]):
                low, high = sorted((a.value, b.value))  # which are rounded
                if low - _ROUNDED * abs(low) <= value <= high + _ROUNDED * abs(high) and low != high:
                    share = (value - a.value) / (b.value - a.value)
                    low, high, period, stick = (
                        float(np.interp(share, [0.0, 1.0], [x, y]))
                        for x, y in ((a.low, b.low), (a.high, b.high), (a.period, b.period), (a.stick, b.stick))
                    )
                    near = a if share < 0.5 else b
                    out.append((branch, Point(value, low, high, near.stable, period, stick, near.multipliers)))
        return out
