"""The cost table of a scene: a row for each setting, stored as CSV and Parquet with machine and versions; the observed
order of each method, the Pareto front, and the recommended setting.

A setting is on the Pareto front if no other setting is both cheaper and has a smaller error. The recommended setting is
the cheapest at p99 of those that meet the target error and the budget. Settings whose 95 % interval begins below 1.1
times this cost count as equally cheap; of these only those are considered whose plant alone takes up to a tenth longer
than the fastest. The one with the smallest error is taken, of equal errors the one with the finest tolerance, because
frames may have cut the steps of all of them to the same length.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet
from scipy.special import stdtrit

from rig.analysis.cycles.motion_measures import THEORY, Setting
from rig.errors import UsageError
from rig.machine.files import DATA, contents, csv_table, draft_of, write_file
from rig.qualify.cost.timing import Cost, Spread

WORST = "worst"
_CLEAR = 30.0  # multiple of the resolution above which an error is used
_LARGEST = 0.1  # the largest error that is used: beyond, it is not yet proportional to a power of the step
_POINTS = 4  # most of them, the finest ones
SAME = 1.1  # ratio of costs that count as equal
_RESOLVED = 2.0  # an error below this multiple of the difference between the references is not resolved
_SPREADS = ("p50", "p99", "factor", "tick")
_UNITS = {"p50": "us", "p99": "us", "tick": "ns"}
_NORMAL = 1.95  # below the limit of `student` for many runs
_RANGE = 1.5  # smallest ratio of steps: similar steps, as where frames cut them all, give no order


def orders(rows: Sequence[Row], seconds: float) -> dict[str, float]:
    """Return method -> slope of the largest error over the step (its mean, if it varies), between the finest clear
    points.

    Methods with fewer than two clear points are left out.
    """
    slopes = {}
    for method in THEORY:
        stepping = [row for row in rows if row.setting.method == method and (row.setting.step_ns or row.steps)]
        clear = [row for row in stepping if _CLEAR * row.floor(WORST) < row.error(WORST) < _LARGEST]
        points = sorted((math.log(step(row, seconds)), math.log(row.error(WORST))) for row in clear)[:_POINTS]
        if len(points) > 1 and points[-1][0] - points[0][0] > math.log(_RANGE):
            steps, errors = np.array(points).T
            slopes[method] = float(np.polyfit(steps, errors, 1)[0])
    return slopes


def step(row: Row, seconds: float) -> float:
    """Return the step of a setting [s]; the mean if the method adapts it."""
    return row.setting.step_ns * 1e-9 if row.setting.step_ns else seconds / max(row.steps, 1)


def front(rows: Sequence[Row], metric: str) -> list[Row]:
    """Return the settings that no other beats in both error and cost, cheapest first."""
    best = math.inf
    pareto = []
    timed = [row for row in rows if row.p99 > 0.0]
    for row in sorted(timed, key=lambda row: (row.p99, row.error(metric))):
        if row.error(metric) < best:
            best = row.error(metric)
            pareto.append(row)
    return pareto


def recommended(rows: Sequence[Row], metric: str, target: float | None, budget: float | None) -> Row:
    """Return the recommended setting. `target`: largest error; `budget`: largest share of a frame at p99.

    Without a target: the one with the smallest error that fits the budget. Raises UsageError if none does, with the
    best available one.
    """
    able = [row for row in rows if row.p99 > 0.0 and math.isfinite(row.error(metric))]
    fitting = [row for row in able if budget is None or row.share <= budget]
    enough = [row for row in fitting if target is None or row.error(metric) <= target]
    if not enough:
        raise UsageError(_why_none(able, fitting, metric, target, budget))
    if target is None:
        best = min(row.error(metric) for row in enough)
        enough = [row for row in enough if row.error(metric) <= max(best, _RESOLVED * row.floor(metric))]
    least = min(row.p99 for row in enough)
    cheap = [row for row in enough if row.cost.p99.low <= SAME * least]
    fastest = min(row.cost.tick.value for row in cheap)
    return min(
        (row for row in cheap if row.cost.tick.value <= SAME * fastest),
        key=lambda row: (row.error(metric), row.setting.tolerance),
    )


def _why_none(able: list[Row], fitting: list[Row], metric: str, target: float | None, budget: float | None) -> str:
    if not able:
        return "no setting completes this scene; the table has the reasons"
    if not fitting:
        least = min(able, key=lambda row: row.share)
        took = f"the cheapest, {least.setting}, takes {least.share:.1%}"
        return f"no setting fits {_percent(budget)} of a frame here; {took}"
    best = min(fitting, key=lambda row: row.error(metric))
    within = "" if budget is None else f" within {_percent(budget)} of a frame"
    name = best.worst if metric == WORST else metric
    error = best.error(metric)
    floor = best.floor(name)
    if best.repeats and target is not None:
        parts = f"{error - floor:.1e} by the step and {floor:.1e} by statistics"
        provably = "provably " if floor > target else ""
        return (
            f"no setting {provably}reaches a relative error of {target:.0e}{within}: that of {best.setting} in "
            f"{name} is {parts}, half of the 95 % interval of the means of {best.repeats} runs"
            f"{_more_runs(best, floor, target)}"
        )
    if error <= _RESOLVED * floor:
        return (
            f"no setting provably reaches a relative error of {target:.0e}{within}: the references agree only to "
            f"{floor:.0e} in {name}, and the error of {best.setting} is as small"
        )
    has = f"the best, {best.setting}, has {error:.1e} in {name}"
    return f"no setting reaches a relative error of {target:.0e}{within}; {has}"


def _more_runs(row: Row, floor: float, target: float) -> str:
    needed = runs_needed(row.repeats, floor, target)
    return f"; statistics alone need {needed} runs of each step for {target:.0e}" if needed > row.repeats else ""


def student(runs: int) -> float:
    """97.5 % of Student's t for the difference of the means of two times `runs` runs."""
    return float(stdtrit(2 * runs - 2, 0.975))


def runs_needed(runs: int, half: float, target: float) -> int:
    """The number of runs of each step whose means have a 95 % interval of at most twice `target`.

    `half`: half the interval of the means of `runs` runs. The spread of the runs is taken as known from these.
    """
    spread = half / student(runs) * math.sqrt(runs)
    needed = max(math.ceil((_NORMAL * spread / target) ** 2), 2)
    while student(needed) * spread > target * math.sqrt(needed):
        needed += 1
    return needed


def _percent(share: float | None) -> str:
    return "all" if share is None else f"{100.0 * share:g} %"


@dataclass(frozen=True)
class Row:
    """One setting: its errors by measure, the resolution of each, its cost, its share of a frame at p99.

    `repeats`: number of runs whose means are compared, of a film; the resolution is then the part of statistics.
    """

    setting: Setting
    errors: dict[str, float]
    floors: dict[str, float]
    cost: Cost
    share: float
    steps: int = 0
    fault: str = ""
    repeats: int = 0

    @property
    def p99(self) -> float:
        """Compute time at p99 [us per 1 ms of simulated time]."""
        return self.cost.p99.value

    @property
    def timed(self) -> bool:
        """Whether its cost is known or not needed."""
        return bool(self.fault) or self.p99 > 0.0

    @property
    def worst(self) -> str:
        """The measure with the largest error."""
        return max(self.errors, key=lambda name: self.errors[name]) if self.errors else ""

    def error(self, metric: str) -> float:
        """Return the error of a measure; the largest of all for "worst"."""
        if self.fault or not self.errors:
            return math.inf
        return self.errors[self.worst if metric == WORST else metric]

    def floor(self, metric: str) -> float:
        """Return the smallest resolved error of a measure, or of the worst one."""
        return max(self.floors.values(), default=0.0) if metric == WORST else self.floors.get(metric, 0.0)

    def text(self, metric: str) -> str:
        """Return error and cost of this setting in words."""
        name = self.worst if metric == WORST else metric
        return f"{self.setting}: {name} error {self.error(metric):.0e}, {self.share:.2%} of a frame at p99"

    def flat(self) -> dict[str, Any]:
        """Return the row as a flat record."""
        out: dict[str, Any] = vars(self.setting) | {"fault": self.fault, "steps": self.steps, "share_p99": self.share}
        out["repeats"] = self.repeats
        for name, spread in vars(self.cost).items():
            out |= {name: spread.value, f"{name}_low": spread.low, f"{name}_high": spread.high}
        out |= {f"error {name}": value for name, value in self.errors.items()}
        return out | {f"floor {name}": value for name, value in self.floors.items()}

    @classmethod
    def of_flat(cls, raw: dict[str, Any]) -> Row:
        """Return the row of a flat record."""

        def under(prefix: str) -> dict[str, float]:
            named = {name.removeprefix(prefix): value for name, value in raw.items() if name.startswith(prefix)}
            return {name: value for name, value in named.items() if value is not None}

        setting = Setting(raw["method"], raw["tolerance"], raw["step_ns"])
        spreads = [Spread(raw[name], raw[f"{name}_low"], raw[f"{name}_high"]) for name in _SPREADS]
        return cls(
            setting=setting,
            errors=under("error "),
            floors=under("floor "),
            cost=Cost(*spreads),
            share=raw["share_p99"],
            steps=raw["steps"],
            fault=raw["fault"],
            repeats=raw["repeats"],
        )


@dataclass
class Table:
    """Error and compute time of a scene on a machine. `left_out`: methods that cannot be used, and why."""

    scene: str
    title: str
    digest: str
    kind: str
    seconds: float
    frame: float
    step: float
    machine: dict[str, str]
    left_out: dict[str, str]
    orders: dict[str, float] = field(default_factory=dict)
    values: dict[str, float] = field(default_factory=dict)
    rows: list[Row] = field(default_factory=list)

    @property
    def statistical(self) -> bool:
        """Whether the errors are those of statistics of a film, with their interval."""
        return self.kind.startswith("statistics")

    @property
    def metrics(self) -> list[str]:
        """The measures that have errors."""
        return list(dict.fromkeys(name for row in self.rows for name in row.errors))

    def metric(self, asked: str) -> str:
        """Return a measure by its name or the begin of it. Raises UsageError with the existing ones."""
        known = (WORST, *self.metrics)
        if asked in known:
            return asked
        for name in known:
            if asked and name.startswith(asked):
                return name
        raise UsageError(f"--metric {asked}: no such measure of {self.scene}; {', '.join(known)}")

    def write(self, folder: Path) -> None:
        """Write cost.csv, cost.parquet and machine.json, each completely or not at all. Raises OutputError."""
        rows = [row.flat() for row in self.rows]
        columns = {}
        for name in dict.fromkeys(name for row in rows for name in row):
            columns[name] = [row.get(name) for row in rows]
        write_file(folder / "cost.csv", csv_table([map(_head, columns), *zip(*columns.values())]))
        with draft_of(folder / "cost.parquet") as draft:
            parquet.write_table(pa.table(columns), draft)
        about = {name: value for name, value in vars(self).items() if name != "rows"}
        write_file(folder / "machine.json", json.dumps(about, indent=1).encode())

    @classmethod
    def read(cls, folder: Path) -> Table:
        """Return the table of a folder. Raises UsageError if there is no readable one."""
        try:
            about = json.loads(contents(folder / "machine.json"))
            flat = parquet.read_table(pa.BufferReader(contents(folder / "cost.parquet", DATA))).to_pylist()
            return cls(**about, rows=[Row.of_flat(row) for row in flat])
        except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
            raise UsageError(f"{folder}: no readable cost table ({error})") from None


def _head(column: str) -> str:
    """A column of cost.csv with its unit, if the name has none."""
    unit = _UNITS.get(column.removesuffix("_low").removesuffix("_high"), "")
    return f"{column} [{unit}]" if unit else column
