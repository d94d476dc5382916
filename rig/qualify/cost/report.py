"""A cost table as a report: text, and the figure of `rig cost`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from rig.analysis.motion_measures.settings import THEORY
from rig.analysis.text_table import columns
from rig.qualify.cost.pareto import front
from rig.qualify.cost.table import WORST, Row, Table
from rig.results import Result

COLUMNS = ("method", "setting", "error", "of", "p50 [us/ms]", "p99 [us/ms]", "95 %", "of a frame", "rt factor", "")


@dataclass(frozen=True)
class CostReport(Result):
    """Error by a measure against compute time: `pick` is the recommended setting, `budget` a share of a frame."""

    FIGURE: ClassVar = "rig.qualify.cost.figure:figure"

    table: Table
    metric: str = WORST
    pick: Row | None = None
    budget: float | None = None

    def text(self) -> str:
        """Return the table and the notes on it as text."""
        found = self.table
        rows = columns([COLUMNS, *lines(found, self.metric, self.pick)], "<<><>>>>><")
        told = (f"  {one}" for one in notes(found, self.metric))
        return "\n".join([f"{found.scene}: error and compute time on this machine", "", *rows, "", *told])


def lines(found: Table, metric: str, pick: Row | None) -> list[tuple[str, ...]]:
    """Return the rows of the table as text."""
    best = front(found.rows, metric)
    rows = []
    for row in found.rows:
        method, _, dial = str(row.setting).partition(" at ")
        if row.fault:
            rows.append((method, dial, row.fault, *[""] * 7))
            continue
        cost, mark = row.cost, "front" if row in best else ""
        p99 = f"{cost.p99.low:.3g} .. {cost.p99.high:.3g}"
        of = row.worst if metric == "worst" else metric
        mark = "recommended" if row is pick else mark
        rows.append((method, dial, f"{row.error(metric):.1e}", of, f"{cost.p50.value:.3g}", f"{cost.p99.value:.3g}",
                     p99, f"{row.share:.2%}", _times(cost.factor.value), mark))  # fmt: skip
    return rows


def _times(factor: float) -> str:
    return f"{factor:.0f}" if factor >= 10.0 else f"{factor:.2g}"


def _agreement(row: Row, metric: str) -> str:
    """The difference of the references, in words."""
    apart = row.floor(metric)
    if math.isfinite(apart):
        return f"the references agree to {apart:.0e}"
    measures = [name for name, floor in row.floors.items() if name and math.isinf(floor)]
    return f"the references do not agree: {', '.join(measures)}" if measures else "one of the references stops"


def notes(found: Table, metric: str) -> list[str]:
    """Return the notes on the table."""
    out = [f"{found.kind}, {found.seconds:.4g} s simulated; {_agreement(found.rows[0], metric)}"]
    out += [f"{m}: error falls with the step to the power {o:.2f}, theory {THEORY[m]}" for m, o in found.orders.items()]
    if any(row.setting.method == "kick" for row in found.rows):
        out.append(
            "kick does not locate opening and closing of contacts: slip and stick are compared, also of open contacts"
        )
    if any(math.isinf(error) for row in found.rows for error in row.errors.values()):
        out.append(
            "inf: the mode set changes differ from those of the reference, so that their times cannot be compared"
        )
    return out + [f"{method} left out: {why}" for method, why in found.left_out.items()]
