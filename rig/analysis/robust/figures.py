"""The figure of a robust design: the growth of random rigs as histograms, eigenvalues of worst rigs in the plane.

With a proof in time also the envelopes of the runs, each design beside the other, with the slopes of the eigenvalues.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.analysis.robust.growth import hertz
from rig.errors import UsageError
from rig.view.palette import page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rig.analysis.robust.in_time import Timed
    from rig.analysis.robust.result import RobustResult

_COLOURS = ("#1d4f91", "#c03a76")
_BINS = 80
_FAR = 4.0  # of the spread of growths: eigenvalues that decay faster are not drawn


def robust_figure(result: RobustResult) -> Figure:
    """Return the histograms and the plane. Raises UsageError if no rig has a growth."""
    growths = {name: growth[np.isfinite(growth)] for name, growth in result.growths.items()}
    every = np.concatenate([*growths.values()])
    if not every.size:
        raise UsageError("nothing to draw: no rig of the audit has a growth")
    designs = list(dict.fromkeys(run.design for run in result.timed))
    rows = 3 if designs else 2
    title = f"{result.job.scene.name}: growth of the rigs of the box"
    with page(9.6, 3.6 * rows, title, layout="constrained") as figure:
        grid = figure.add_gridspec(rows, max(len(designs), 1))
        top, below = (figure.add_subplot(grid[row, :]) for row in range(2))
        bins: Any = np.linspace(every.min(), every.max() or 1e-9, _BINS) if np.ptp(every) else 3
        for (name, growth), colour in zip(growths.items(), _COLOURS):
            top.hist(growth, bins, color=colour, alpha=0.6, label=name)
        top.axvline(0.0, color="0.3", lw=0.8)
        top.set(xlabel="growth rate [1/s]", ylabel="rigs [1]")
        top.legend(loc="best")
        _plane(below, result, float(every.min()))
        beside = None
        for column, design in enumerate(designs):
            beside = figure.add_subplot(grid[2, column], sharey=beside)
            _envelopes(beside, [run for run in result.timed if run.design == design], _COLOURS[column])
    return figure


def _envelopes(axes: Axes, runs: Sequence[Timed], colour: str) -> None:
    """Envelopes of a design with the nominal and the worst rig; dashed: as the eigenvalue grows."""
    for run, width in zip(runs, (0.8, 1.8)):
        times, amplitudes = np.array([run.times, run.amplitudes])
        axes.plot(times, amplitudes, color=colour, lw=width, label=f"{run.design}, {run.rig} rig")
        used = (times >= run.begin) & (times <= run.end) & (amplitudes > 0.0)
        if used.any():
            middle = 0.5 * (run.begin + run.end)
            level = np.exp(np.interp(middle, times[used], np.log(amplitudes[used])))
            line = level * np.exp(run.expected * (times[used] - middle))
            axes.plot(times[used], line, "--", color="0.2", lw=0.8, label=f"eigenvalue, {run.expected:.3g} 1/s")
    axes.set(yscale="log", xlabel="time [s]", ylabel=f"amplitude of {runs[0].output} [{runs[0].unit_of_output}]")
    axes.legend(loc="best")


def _plane(axes: Axes, result: RobustResult, least: float) -> None:
    """Eigenvalues of the nominal rigs and of the worst ones, within the band."""
    growth = result.job.grown()
    for entry, colour in zip(result.found.entries[: len(result.growths)], _COLOURS):
        for k, rates in enumerate(entry.spectra(growth)):
            near = rates[(rates.imag >= 0.0) & (rates.real > _FAR * min(least, -1.0))]
            tones = hertz(near)
            drawn = growth.inside(tones)
            label = f"{entry.name}, {'worst rigs' if k else 'nominal rig'}" if k < 2 else None
            marker = "x" if k else "o"
            axes.plot(near.real[drawn], tones[drawn], marker, ms=5, color=colour, fillstyle="none", label=label)
    axes.axvline(0.0, color="0.3", lw=0.8)
    axes.set(xlabel="growth rate [1/s]", ylabel="frequency [Hz]")
    axes.legend(loc="best")
