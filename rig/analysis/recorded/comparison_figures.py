"""Figures of two recordings, and of a recording with its simulation: channels over each other, and their difference."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rig.analysis.recorded.against_scene import AgainstScene, Pair
from rig.analysis.recorded.comparison import Compared
from rig.analysis.recorded.series import scene_name
from rig.analysis.recorded.stick_slip import StickSlip
from rig.record.compare import series_of
from rig.record.statistics import whole_signals
from rig.view.curves import largest, plain, scaled, thinned
from rig.view.palette import AMBER, BLUE, GREY, page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DRAWN_CHANNELS = 5  # of a comparison, those that differ first
_DRAWN_CYCLES = 12  # of a measurement beside its simulation


def comparison_figure(compared: Compared) -> Figure:
    """Draw up to five channels of two runs, those that differ first, with their difference."""
    first, second = compared.runs
    ours, two = (series_of(run, compared.begin, compared.end) for run in (first, second))
    known = {signal.topic: signal for signal in compared.signals.signals}
    measured = [f"meas/{name}" for name in first.measurements]
    names = [name for name in (*whole_signals(first), *measured) if name in known]
    names = sorted(names, key=lambda name: known[name].equal)[:_DRAWN_CHANNELS]
    styles: tuple[dict[str, Any], ...] = ({"color": BLUE}, {"color": AMBER, "ls": "--"})
    title = " and ".join(dict.fromkeys(scene_name(run) for run in (first, second)))
    with page(14.0, 1.4 + 2.1 * len(names), f"{title}: two recordings", layout="constrained") as figure:
        rows = figure.subplots(max(len(names), 1), 2, squeeze=False, sharex=True, width_ratios=(1.5, 1.0))
        for (over, apart), name in zip(rows, names):
            factor, unit = scaled(first.units.get(name, ""), largest(ours[name].values, two[name].values))
            for which, series, style in zip(compared.labels, (ours[name], two[name]), styles):
                t = np.multiply(series.t_ns, 1e-9, dtype=np.float64)
                over.plot(*thinned(t, factor * series.values), lw=1.0, label=which, **style)
            over.set_ylabel(f"{plain(name.removeprefix('meas/'))}\n[{unit}]")
            shared, at_one, at_two = np.intersect1d(ours[name].t_ns, two[name].t_ns, return_indices=True)
            away = factor * (two[name].values[at_two] - ours[name].values[at_one])
            shared_t = np.multiply(shared, 1e-9, dtype=np.float64)
            apart.plot(*thinned(shared_t, away), lw=0.9, color=GREY)
            apart.set_ylabel(f"difference B - A\n[{unit}]")
            signal = known[name]
            outcome = "equal, bit by bit"
            if signal.differing:
                outcome = f"from t = {signal.time:.6g} s on, up to {signal.deviation:.3g} of the range"
            apart.set_title(outcome)
        rows[0, 0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=1, borderaxespad=0.2)
        for axes in rows[-1]:
            axes.set_xlabel("time [s]")
        figure.align_ylabels(rows[:, 0])
        figure.align_ylabels(rows[:, 1])
    return figure


def against_scene_figure(comparison: AgainstScene) -> Figure:
    """Draw every channel over time, aligned by the first event, and its cycles over their phase; friction if known."""
    rows = len(comparison.pairs) + (comparison.stick is not None)
    title = f"{comparison.recording} and its simulation, {comparison.scene}"
    with page(14.0, 1.6 + 3.0 * rows, title, layout="constrained") as figure:
        axes = figure.subplots(rows, 2, squeeze=False, width_ratios=(1.6, 1.0))
        for (over, phase), pair in zip(axes, comparison.pairs):
            _in_time(over, pair)
            _in_phase(phase, pair)
        axes[0, 0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
        if comparison.stick is not None:
            _slips(axes[-1, 0], axes[-1, 1], comparison.stick)
        figure.align_ylabels(axes[:, 0])
    return figure


def _in_time(axes: Axes, pair: Pair) -> None:
    """A few cycles of both, the first event at time 0; without cycles all of it, as it was."""
    factor, unit = scaled(pair.unit, largest(pair.measured, pair.simulated))
    curves = (("measured", pair.measured, BLUE, "-"), ("simulated", pair.simulated, AMBER, "--"))
    for i, (which, v, colour, dashes) in enumerate(curves):
        t = pair.t
        shown = np.ones(v.size, np.bool_)
        if pair.cycles:
            t = t - pair.cycles[i].begins[0]
            span = _DRAWN_CYCLES * pair.cycles[0].period
            shown = (t >= -0.1 * span) & (t <= span)
        axes.plot(*thinned(t[shown], factor * v[shown]), lw=1.0, label=which, color=colour, ls=dashes)
    axes.set_ylabel(f"{plain(pair.channel)}\n[{unit}]")
    axes.set_xlabel("time from the first event [s]" if pair.cycles else "time [s]")


def _in_phase(axes: Axes, pair: Pair) -> None:
    """The median of the cycles with the band of eight tenths of them."""
    if pair.cycles is None:
        axes.text(0.5, 0.5, "less than three cycles", ha="center", va="center", color=GREY, transform=axes.transAxes)
        axes.set_axis_off()
        return
    factor, unit = scaled(pair.unit, largest(pair.measured, pair.simulated))
    for cycles, colour in zip(pair.cycles, (BLUE, AMBER)):
        phase = np.linspace(0.0, 1.0, cycles.middle.size)
        axes.plot(phase, factor * cycles.middle, color=colour, lw=1.4)
        axes.fill_between(phase, factor * cycles.low, factor * cycles.high, color=colour, alpha=0.18, lw=0.0)
    axes.set(
        xlabel="phase of the cycle [1]",
        ylabel=f"{plain(pair.channel)} [{unit}]",
        title="median and 10 to 90 % of the cycles",
    )


def _slips(times: Axes, friction: Axes, both: tuple[StickSlip, StickSlip]) -> None:
    """How long both stick, and friction over rising slip speed."""
    slips = [slip for contact in both for slip in contact.slips]
    longest = max((np.nan_to_num(slip.stick) for slip in slips), default=1.0) or 1.0
    for contact, colour, which in zip(both, (BLUE, AMBER), ("measured", "simulated")):
        sticks = [slip.stick for slip in contact.slips if np.isfinite(slip.stick)]
        times.hist(sticks, list(np.linspace(0.0, longest, 40)), color=colour, alpha=0.6, label=which)
        if contact.up is not None and contact.up.speed.size:
            up = contact.up
            friction.errorbar(up.speed, up.friction, 2.0 * up.error, color=colour, marker="o", ms=3.5, lw=1.0)
    times.set(xlabel="stick time [s]", ylabel="number of slips [1]")
    friction.set_visible(bool(both[0].force_unit))
    friction.set(xlabel=f"rising slip speed [{both[0].speed_unit}]", ylabel=f"friction [{both[0].force_unit}]")
