"""The figure of two recordings: channels over each other, and their difference."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rig.analysis.recorded.comparison import Compared
from rig.analysis.recorded.figure import sheet
from rig.analysis.recorded.series import scene_name
from rig.record.compare import series_of
from rig.record.statistics import whole_signals
from rig.view.curves import plain, thinned
from rig.view.palette import AMBER, BLUE, GREY

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_A, _B, _DIFFERENCE = BLUE, AMBER, GREY
_DRAWN = 5
"""Most channels in a figure: those that differ first."""


def figure(found: Compared) -> Figure:
    """Draw up to five channels of two runs, those that differ first, with their difference."""
    first, second = found.runs
    one, two = (series_of(run, found.begin, found.end) for run in (first, second))
    known = {signal.topic: signal for signal in found.signals.signals}
    names = [
        name for name in (*whole_signals(first), *(f"meas/{name}" for name in first.measurements)) if name in known
    ]
    names = sorted(names, key=lambda name: known[name].equal)[:_DRAWN]
    title = " and ".join(dict.fromkeys(scene_name(run) for run in (first, second)))
    with sheet(f"{title}: two recordings", (14.0, 1.4 + 2.1 * len(names))) as figure:
        rows = figure.subplots(max(len(names), 1), 2, squeeze=False, sharex=True, width_ratios=(1.5, 1.0))
        for (over, apart), name in zip(rows, names):
            unit = first.units.get(name, "")
            for which, series, style in (("A", one[name], {"color": _A}), ("B", two[name], {"color": _B, "ls": "--"})):
                t = np.multiply(series.t_ns, 1e-9, dtype=np.float64)
                over.plot(*thinned(t, series.values), lw=1.0, label=which, **style)
            over.set_ylabel(f"{plain(name.removeprefix('meas/'))}\n[{unit}]")
            shared, at_one, at_two = np.intersect1d(one[name].t_ns, two[name].t_ns, return_indices=True)
            away = two[name].values[at_two] - one[name].values[at_one]
            apart.plot(*thinned(np.multiply(shared, 1e-9, dtype=np.float64), away), lw=0.9, color=_DIFFERENCE)
            apart.set_ylabel(f"difference B - A\n[{unit}]")
            signal = known[name]
            apart.set_title(
                f"from t = {signal.time:.6g} s on, up to {signal.deviation:.3g} of the range"
                if signal.differing
                else "equal, bit by bit"
            )
        rows[0, 0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
        for axes in rows[-1]:
            axes.set_xlabel("time [s]")
        figure.align_ylabels(rows[:, 0])
        figure.align_ylabels(rows[:, 1])
    return figure
