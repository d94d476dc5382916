"""Effects as a picture and as CSV: the cost of each per step, and the change without it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from rig.qualify.cost.effects import Paired
from rig.qualify.cost.figure import sheet, tick_labels
from rig.qualify.cost.table import Table
from rig.user_files import csv_table, write_file
from rig.view.palette import BLUE, VERMILION
from rig.view.save_figure import put


def write(found: Sequence[Paired], path: Path) -> None:
    """Write one line for each effect and measure. Raises OutputError."""
    rows: list[list[object]] = [
        ["effect", "measured", "states", "cost per step [ns]", "low [ns]", "high [ns]", "noise [ns]",
         "measure", "unit", "with", "without", "change", "significant", "note"]
    ]  # fmt: skip
    for one, how in [(one, "as held") for one in found] + [(p.closed, "closed") for p in found if p.closed]:
        head = [one.name, how, one.states, *one.to_json()["tick"].values(), one.to_json()["noise"]]
        note = one.fault or one.note
        for c in one.changes:
            rows.append([*head, c.measure, c.unit, c.whole, c.less, c.size, c.significant, note])
        if not one.changes:
            rows.append([*head, *[""] * 6, note])
    write_file(path, csv_table(rows))


def text(one: Paired) -> str:
    """Return the report as text."""
    if one.fault:
        return f"effect {one.name}: {one.change()}"
    return f"effect {one.name}: {one.states} states, {one.cost()} per step; change if left out: {one.change()}"


def draw(found: Sequence[Paired], table: Table, path: Path) -> None:
    """Draw bars: ns per step on the left, changes by measure on the right."""
    shown = [one.closed or one for one in found if not math.isnan((one.closed or one).tick.value)]
    if not shown:
        return
    with sheet(f"{table.title}: what its effects cost", table.machine) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        places = range(len(shown) + 1)
        ticks = [one.shown_cost for one in shown]
        whole = shown[0].whole
        rest = max(whole - sum(max(tick.value, 0.0) for tick in ticks), 0.0)
        begin = rest
        left.barh(0, rest, color="#9aa5b1")
        for place, one in zip(places[1:], shown):
            left.barh(place, one.shown_cost.value, left=begin, color=BLUE)
            spread = [
                [max(one.shown_cost.value - one.shown_cost.low, 0.0)],
                [max(one.shown_cost.high - one.shown_cost.value, 0.0)],
            ]
            left.errorbar(begin + one.shown_cost.value, place, xerr=spread, color="black", lw=0.8, capsize=2)
            begin += one.shown_cost.value
            for change in one.changes:
                if change.significant:
                    right.plot(change.size, place, "o", ms=5, color=VERMILION, alpha=0.7)
            worst = one.worst
            if worst is not None:
                right.annotate(f"{worst.measure.replace('_', ' ')}, {worst.size:.2g}", (worst.size, place), (0, 8),
                               textcoords="offset points", ha="right", fontsize=8.5)  # fmt: skip
            else:
                right.annotate("no change", (0.02, place), xycoords=("axes fraction", "data"), fontsize=9.5)
        left.axvline(whole, color="black", ls=":", lw=1.0)
        noise = max(one.noise for one in shown)
        left.set(xlabel=f"compute of a step of {1e6 * table.step:g} us [ns]; noise up to {noise:.2g} ns")
        left.set_yticks(list(places), ["everything else", *(one.name.replace("_", " ") for one in shown)])
        right.set(xscale="log", xlabel="change if left out: share of the larger value")
        right.set_xlim(*_range([size for one in shown for size in one.errors.values()]))
        tick_labels(right)
        figure.supxlabel("\n", fontsize=8.5)  # room for the machine
    put(figure, path)


def _range(errors: Sequence[float]) -> tuple[float, float]:
    """The range of the errors with a margin."""
    seen = [error for error in errors if error > 0.0] or [1e-3]
    return 0.1 * min(seen), 10.0 * max(seen)
