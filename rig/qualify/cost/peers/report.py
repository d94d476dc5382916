"""The comparison of solvers as a table, as CSV and as a picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from rig.qualify.cost.figure import sheet
from rig.qualify.cost.peers.race import OURS, Entry, cheapest
from rig.user_files import csv_table, write_file
from rig.view.palette import ALARM, AMBER, BLUE, GREEN, GREY, PURPLE, VERMILION
from rig.view.save_figure import put

COLUMNS = ("solver", "setting", "error of event times", "real-time factor", "rig is faster by", "")
_COLOURS = (BLUE, GREEN, PURPLE, AMBER, VERMILION, GREY)


def lines(found: Sequence[Entry], target: float) -> list[tuple[str, ...]]:
    """Return for each solver the fastest setting that meets `target`."""
    best = cheapest(found, target)
    rows: list[tuple[str, ...]] = []
    for one in best:
        if math.isnan(one.factor):
            rows.append((one.peer, "", "", "", "", one.fault))
            continue
        short = "" if one.error <= target else f"does not reach {target:g}"
        ratio = f"{best[0].factor / one.factor:.0f}" if one.peer != OURS and not short else ""
        error = f"{one.error:.1e}" if math.isfinite(one.error) else "changes missed or invented"
        note = "; ".join(part for part in (short, one.fault) if part)
        rows.append((one.peer, one.setting, error, f"{one.factor:.3g}", ratio, note))
    return rows


def write(found: Sequence[Entry], path: Path) -> None:
    """Write the comparison as CSV. Raises OutputError."""
    head = ("solver", "setting", "largest error of event times / period", "real-time factor", "fault")
    write_file(path, csv_table([head, *(vars(one).values() for one in found)]))


def draw(found: Sequence[Entry], title: str, machine: dict[str, str], target: float, path: Path) -> None:
    """Draw the error of event times over compute time, a curve for each method of each solver."""
    with sheet(f"{title}: beside other solvers", machine) as figure:
        axes = figure.add_subplot()
        for colour, peer in zip(_COLOURS, dict.fromkeys(one.peer for one in found)):
            mine = [one for one in found if one.peer == peer and math.isfinite(one.error)]
            marks = iter("osD^v")
            for method in dict.fromkeys(one.setting.partition(" at ")[0] for one in mine):
                points = [one for one in mine if one.setting.partition(" at ")[0] == method]
                x, y = [1e3 / one.factor for one in points], [one.error for one in points]
                axes.plot(x, y, color=colour, marker=next(marks), ms=5, lw=1.2, label=f"{peer} {method}")
            if not mine:
                why = next(one.fault for one in found if one.peer == peer)
                axes.plot([], [], " ", label=f"{peer}: {why.partition(':')[0]}")
        axes.axhline(target, color=ALARM, lw=1.0, ls=":", label=f"{target:g}")
        axes.set(xscale="log", yscale="log", xlabel="compute in 1 ms of simulated time [us], samples every 1 ms")
        axes.set_ylabel("largest error of event times / period")
        figure.legend(loc="outside lower left", ncols=3)
    put(figure, path)
