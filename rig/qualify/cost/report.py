"""A cost table as a report: text, and the figure of error against compute time."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from rig import results
from rig.analysis.cycles.motion_measures import THEORY
from rig.errors import UsageError
from rig.qualify.cost.table import WORST, Row, Table, front
from rig.qualify.cost.timing import Spread
from rig.results import Column, Result
from rig.view import palette
from rig.view.palette import ALARM, AMBER, BLUE, GREEN, PURPLE, SKY, VERMILION, headline, page, printed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = {"exact": BLUE, "dopri5": VERMILION, "rosenbrock": SKY, "rk4": GREEN, "kick": AMBER, "smooth": PURPLE}
MARKS = {"exact": "D", "dopri5": "o", "rosenbrock": "P", "rk4": "s", "kick": "^", "smooth": "v"}
STYLE = palette.STYLE | {"axes.titlesize": "large", "lines.linewidth": 1.5}
LEAST = 1e-16  # errors of zero are drawn at this value
_TIME = "us/ms"
_SHORT = 100.0  # ratio of the ends of an axis up to which labels of minor ticks have room beside those of the decades
_FEW = 3.0  # ratio up to which there may be no tick at 2, at 5 or at a decade, and all minor ticks have labels


@dataclass(frozen=True)
class CostReport(Result):
    """Error by a measure against compute time: `pick` is the recommended setting, `budget` a share of a frame."""

    FIGURE: ClassVar = "rig.qualify.cost.report:figure"

    table: Table
    metric: str = WORST
    pick: Row | None = None
    budget: float | None = None

    def shown(self) -> Iterator[str | results.Table]:
        """Yield a row for each setting, and the notes on them."""
        yield f"{self.table.scene}: error and compute time on this machine\n"
        yield self._settings()
        yield ""
        yield from (f"  {note}" for note in notes(self.table, self.metric))

    def _settings(self) -> results.Table:
        """The settings; the errors of statistics with the part of statistics."""
        statistical = self.table.statistical
        best = front(self.table.rows, self.metric)
        columns = (
            Column("method"),
            Column("setting"),
            Column("error", "1", ".1e"),
            *[Column("by statistics", "1", ".1e")] * statistical,
            Column("of"),
            *(Column(name, _TIME, ".3g") for name in ("p50", "p99", "p99_low", "p99_high")),
            Column("share_p99", "1", ".2f", "%", 0.01),
            Column("factor", "1", ".6g"),
            Column("note"),
        )
        rows: list[tuple[Any, ...]] = []
        for row in self.table.rows:
            method, _, dial = str(row.setting).partition(" at ")
            if row.fault:
                rows.append((method, dial, *[None] * (1 + statistical), "", *[None] * 6, row.fault))
                continue
            name = row.worst if self.metric == WORST else self.metric
            errors = (row.error(self.metric), *[row.floor(name)] * statistical)
            times = (row.cost.p50.value, row.cost.p99.value, row.cost.p99.low, row.cost.p99.high)
            mark = ""
            if row is self.pick:
                mark = "recommended"
            elif row in best:
                mark = "front"
            rows.append((method, dial, *errors, name, *times, row.share, row.cost.factor.value, mark))
        return results.Table("rows", columns, rows)

    def facts(self) -> dict[str, Any]:
        """Return the whole table."""
        return {**vars(self.table), "rows": [row.flat() for row in self.table.rows]}


def _agreement(table: Table, metric: str) -> str:
    """The difference of the references, or the interval of statistics, in words."""
    row = table.rows[0]
    apart = row.floor(metric)
    if table.statistical:
        return f"errors contain half of the 95 % interval of the means of {row.repeats} runs, up to {apart:.0e}"
    if math.isfinite(apart):
        return f"the references agree to {apart:.0e}"
    measures = [name for name, floor in row.floors.items() if name and math.isinf(floor)]
    return f"the references do not agree: {', '.join(measures)}" if measures else "one of the references stops"


def notes(table: Table, metric: str) -> list[str]:
    """Return the notes on the table."""
    out = [f"{table.kind}, {table.seconds:.4g} s simulated; {_agreement(table, metric)}"]
    out += [f"{m}: error falls with the step to the power {o:.2f}, theory {THEORY[m]}" for m, o in table.orders.items()]
    if any(math.isinf(error) for row in table.rows for error in row.errors.values()):
        out.append("inf: the mode set changes are not those of the reference, so that their times cannot be compared")
    return out + [f"{method} left out: {why}" for method, why in table.left_out.items()]


def figure(report: CostReport) -> Figure:
    """Return error over compute time, with Pareto front, budget and recommended setting.

    Left: frames as in a run. Right: the plant alone, without interruption. Raises UsageError if no setting has both an
    error and a cost.
    """
    table = report.table
    metric = report.metric
    pick = report.pick
    if not front(table.rows, metric):
        raise UsageError("nothing to draw: no setting has both an error and a cost")
    with sheet(f"{table.scene}: error against compute time", table.machine) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        for axes, of in ((left, lambda row: row.cost.p99), (right, _of_plant)):
            _curves(axes, table, metric, of)
            if pick is not None:
                label = f"recommended: {printed(str(pick.setting))}"
                at = of(pick).value, _shown(pick, metric)
                axes.plot(*at, "o", ms=17, mfc="none", mec="black", mew=1.6, label=label)
            axes.set(xscale="log", yscale="log")
        best = front(table.rows, metric)
        style: dict[str, Any] = {"where": "post", "color": "black", "ls": ":", "lw": 1.2, "zorder": 1}
        left.step([row.p99 for row in best], [_shown(row, metric) for row in best], label="Pareto front", **style)
        if report.budget is not None:
            left.axvline(1e3 * report.budget, color=ALARM, lw=1.3, label=f"budget, {report.budget:.0%} of a frame")
        last = math.inf
        for row in table.rows:
            y = _shown(row, metric)
            if row.p99 > 0.0 and np.isfinite(y) and not 0.5 < y / last < 2.0:
                _, _, dial = str(row.setting).partition(" at ")
                at = (_of_plant(row).value, y)
                right.annotate(printed(dial), at, (12, 6), textcoords="offset points", fontsize=7.5)
                last = y
        left.set_xlabel("frames as in a run: compute in 1 ms of simulated time, p99 [us]")
        right.set_xlabel("plant alone, in one piece: compute in 1 ms of simulated time [us]")
        second_axis(left, percent_of_frame, "share of a frame [%]")
        second_axis(right, real_time_factor, "real-time factor")
        labels = dict(zip(*reversed(left.get_legend_handles_labels())))
        figure.legend(labels.values(), labels.keys(), loc="outside lower left", ncols=2)
    return figure


@contextlib.contextmanager
def sheet(title: str, machine: dict[str, str]) -> Iterator[Figure]:
    """Yield an empty figure with a title and the machine."""
    with page(10.8, 6.4, style=STYLE, layout="constrained") as figure:
        yield figure
        machine_text = "{processor}, {cores} cores\nPython {python}, numba {numba}, {date:.10}".format_map(machine)
        headline(figure, title)
        figure.text(0.99, 0.015, machine_text, ha="right", va="bottom", fontsize=8.5, color="#666666")


def _of_plant(row: Row) -> Spread:
    """Compute time of the plant alone in 1 ms of simulated time [us]."""
    factor = row.cost.factor
    return Spread(1e3 / factor.value, 1e3 / factor.high, 1e3 / factor.low)


def _shown(row: Row, metric: str) -> float:
    return max(row.error(metric), LEAST)


def _curves(axes: Axes, table: Table, metric: str, of: Callable[[Row], Spread]) -> None:
    """Error over compute time, a curve for each method, and the resolution of the references."""
    known = [row for row in table.rows if np.isfinite(row.error(metric))]
    for method in dict.fromkeys(row.setting.method for row in table.rows):
        rows = [row for row in known if row.setting.method == method and row.p99 > 0.0]
        if rows:
            spreads = [of(row) for row in rows]
            low = [max(spread.value - spread.low, 0.0) for spread in spreads]
            high = [max(spread.high - spread.value, 0.0) for spread in spreads]
            order = f": order {table.orders[method]:.1f}, theory {THEORY[method]}" if method in table.orders else ""
            style: dict[str, Any] = {"color": COLOURS[method], "marker": MARKS[method], "label": f"{method}{order}"}
            style |= {"ms": 5.5, "lw": 1.2, "elinewidth": 0.8, "capsize": 2}
            x = [spread.value for spread in spreads]
            y = [_shown(row, metric) for row in rows]
            axes.errorbar(x, y, xerr=(low, high), **style)
    floor = max((row.floor(metric) for row in table.rows), default=0.0)
    if LEAST < floor < math.inf:
        axes.axhspan(LEAST, floor, color="#f0f0f0", lw=0, label="below the resolution of the references", zorder=0)
    shown = [_shown(row, metric) for row in known]
    top = 5.0 * max([10.0 * LEAST, *shown])
    axes.set_ylim(min(max(0.2 * min([floor, *shown]), LEAST), 0.1 * top), top)


def second_axis(axes: Axes, converted: Callable[[float], float], label: str) -> None:
    """Draw a second horizontal axis on top: the same values in another unit."""
    top = axes.twiny()
    low, high = axes.get_xlim()
    top.set(xscale="log", xlim=(converted(low), converted(high)), xlabel=label)
    top.grid(visible=False)
    for axis in (axes, top):
        tick_labels(axis)


def tick_labels(axes: Axes) -> None:
    """Label a logarithmic horizontal axis so that its labels stay apart."""
    low, high = sorted(axes.get_xlim())
    axes.xaxis.set_major_formatter("{x:g}")
    digits = "23456789"
    if high >= _SHORT * low:
        digits = ""
    elif high >= _FEW * low:
        digits = "25"
    axes.xaxis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:.0e}"[0] in digits else "")


def percent_of_frame(compute: float) -> float:
    """Compute time [us] as percent of 1 ms."""
    return 0.1 * compute


def real_time_factor(compute: float) -> float:
    """Real-time factor of a compute time [us] for 1 ms."""
    return 1e3 / compute
