"""The cost table of a scene: a row for each setting, stored as CSV and Parquet with machine and versions."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rig.analysis.motion_measures.settings import Setting
from rig.errors import UsageError
from rig.qualify.cost.timing import Cost, Spread
from rig.user_files import DATA, contents, csv_table, draft_of, write_file

WORST = "worst"


@dataclass(frozen=True)
class Row:
    """One setting: its errors by measure, the resolution of each, its cost, its share of a frame at p99."""

    setting: Setting
    errors: dict[str, float]
    floors: dict[str, float]
    cost: Cost
    share: float
    steps: int = 0
    fault: str = ""

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
        for name, spread in vars(self.cost).items():
            out |= {name: spread.value, f"{name}_low": spread.low, f"{name}_high": spread.high}
        out |= {f"error {name}": value for name, value in self.errors.items()}
        return out | {f"floor {name}": value for name, value in self.floors.items()}

    @classmethod
    def of_flat(cls, raw: dict[str, Any]) -> Row:
        """Return the row of a flat record."""

        def under(prefix: str) -> dict[str, float]:
            named = {name: v for name, v in raw.items() if name.startswith(prefix) and v not in (None, "")}
            return {name.removeprefix(prefix): float(v) for name, v in named.items()}

        def spread(name: str) -> Spread:
            return Spread(*(float(raw[f"{name}{end}"]) for end in ("", "_low", "_high")))

        return cls(
            Setting(raw["method"], float(raw["tolerance"]), int(raw["step_ns"])),
            under("error "),
            under("floor "),
            Cost(*(spread(name) for name in ("p50", "p99", "factor", "tick"))),
            float(raw["share_p99"]),
            int(raw["steps"]),
            raw["fault"] or "",
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
    def metrics(self) -> list[str]:
        """The measures that have errors."""
        return list(dict.fromkeys(name for row in self.rows for name in row.errors))

    def metric(self, asked: str) -> str:
        """Return a measure by its name or the begin of it. Raises UsageError with the existing ones."""
        known = (WORST, *self.metrics)
        found = asked if asked in known else next((name for name in known if asked and name.startswith(asked)), None)
        if found is None:
            raise UsageError(f"--metric {asked}: no such measure of {self.scene}; {', '.join(known)}")
        return found

    def write(self, folder: Path) -> None:
        """Write cost.csv, cost.parquet and machine.json, each completely or not at all. Raises OutputError."""
        rows = [row.flat() for row in self.rows]
        columns = list(dict.fromkeys(name for row in rows for name in row))
        lines = [[row.get(name) for name in columns] for row in rows]
        write_file(folder / "cost.csv", csv_table([[_head(name) for name in columns], *lines]))
        write_parquet(folder / "cost.parquet", {c: [row.get(c) for row in rows] for c in columns})
        about = {name: value for name, value in vars(self).items() if name != "rows"}
        write_file(folder / "machine.json", json.dumps(about, indent=1).encode())

    @classmethod
    def read(cls, folder: Path) -> Table:
        """Return the table of a folder. Raises UsageError if there is no readable one."""
        try:
            about = json.loads(contents(folder / "machine.json"))
            text = contents(folder / "cost.csv", DATA).decode()
            head, *lines = csv.reader(io.StringIO(text, newline=""))
            names = [name.partition(" [")[0] for name in head]
            rows = [Row.of_flat(dict(zip(names, line, strict=True))) for line in lines]
            return cls(**about, rows=rows)
        except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
            raise UsageError(f"{folder}: no readable cost table ({error})") from None


_UNITS = {"p50": "us", "p99": "us", "tick": "ns"}


def _head(column: str) -> str:
    """A column of cost.csv with its unit, if the name has none."""
    unit = _UNITS.get(column.removesuffix("_low").removesuffix("_high"), "")
    return f"{column} [{unit}]" if unit else column


def write_parquet(path: Path, columns: dict[str, Sequence[Any]]) -> None:
    """Write columns by name as a Parquet file, completely or not at all. Raises OutputError."""
    import pyarrow as pa
    from pyarrow import parquet

    with draft_of(path) as draft:
        parquet.write_table(pa.table(columns), draft)
