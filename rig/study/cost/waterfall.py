"""Effects as a picture and as CSV: what each adds to a step, and what error its absence makes."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

from rig.study.cost.effects import Paired
from rig.study.cost.figure import sheet
from rig.study.cost.table import Table


def write(found: Sequence[Paired], path: Path) -> None:
    """One line for each effect and measure."""
    with path.open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(["effect", "states", "ns_per_step", "low", "high", "measure", "error_if_dropped", "fault"])
        for one in found:
            head = [one.name, one.states, one.tick.value, one.tick.low, one.tick.high]
            for name, error in (one.errors or {"": math.nan}).items():
                out.writerow([*head, name, error, one.fault])


def text(one: Paired) -> str:
    """For a reader."""
    if one.fault:
        return f"{one.name}: cannot be dropped: {one.fault}"
    measure, error = one.worst
    size = f"by {error:.2%}" if error < 1.0 else f"to {1.0 + error:.3g} times or to nothing"
    what = f"changes {measure} {size}" if error else "changes nothing"
    return f"{one.name}: {one.tick.value:.0f} of {one.whole:.0f} ns per step, {one.states} states; dropped, it {what}"


def draw(found: Sequence[Paired], table: Table, path: Path) -> None:
    """Bars: ns per step on the left, errors by measure on the right."""
    shown = [one for one in found if not one.fault]
    with sheet(f"{table.title}: what its effects cost", table.machine, path) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        places = range(len(shown) + 1)
        ticks = [one.tick for one in shown]
        whole = shown[0].whole
        rest = max(whole - sum(max(tick.value, 0.0) for tick in ticks), 0.0)
        begin = rest
        left.barh(0, rest, color="#9aa5b1")
        for place, one in zip(places[1:], shown):
            left.barh(place, one.tick.value, left=begin, color="#1d4f91")
            spread = [[max(one.tick.value - one.tick.low, 0.0)], [max(one.tick.high - one.tick.value, 0.0)]]
            left.errorbar(begin + one.tick.value, place, xerr=spread, color="black", lw=0.8, capsize=2)
            begin += one.tick.value
            for error in (one.errors or {}).values():
                if error > 0.0:
                    right.plot(error, place, "o", ms=5, color="#c03a76", alpha=0.7)
            measure, error = one.worst
            if error > 0.0:
                right.annotate(f"{measure}, {error:.2g}", (error, place), (0, 8), textcoords="offset points",
                               ha="right", fontsize=8.5)  # fmt: skip
            else:
                right.annotate("changes nothing", (0.02, place), xycoords=("axes fraction", "data"), fontsize=9.5)
        left.axvline(whole, color="black", ls=":", lw=1.0)
        left.set(xlabel=f"compute of a step of {1e6 * table.step:g} us [ns], plant alone")
        left.set_yticks(list(places), ["everything else", *(one.name for one in shown)])
        right.set(xscale="log", xlabel="relative error of each measure if the effect is dropped")
        right.set_xlim(*_range([error for one in shown for error in (one.errors or {}).values()]))
        figure.supxlabel("\n", fontsize=8.5)  # room for the machine


def _range(errors: Sequence[float]) -> tuple[float, float]:
    """Where the errors lie, with some room beside them."""
    seen = [error for error in errors if error > 0.0] or [1e-3]
    return 0.1 * min(seen), 10.0 * max(seen)
