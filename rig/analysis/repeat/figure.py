"""The spread of runs with different seeds as a picture: openings, every number over its median, the spectrum."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rig.analysis.repeat.measure import ONSET
from rig.analysis.repeat.spread import Repeats
from rig.errors import UsageError
from rig.view.palette import BLUE
from rig.view.run_figure import STYLE
from rig.view.save_figure import page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST = 24  # numbers in the picture
_COLOUR, _BAND = BLUE, "#b9cce4"


def figure(found: Repeats) -> Figure:
    """Return the figure of the spread. Raises UsageError if no run was simulated."""
    if not found.seen:
        raise UsageError(f"nothing to draw: {found.ended or 'no run was simulated'}")
    with page(STYLE, 12.0, 7.0, layout="constrained", dpi=100) as figure:
        left, right = figure.subplots(1, 2)
        _numbers(left, found)
        _spectrum(right, found)
        figure.suptitle(f"{found.scene}: {len(found.seen)} runs with seeds {found.seeds[0]} to {found.seeds[-1]}")
    return figure


def _numbers(axes: Axes, found: Repeats) -> None:
    """Every number of every run over its median."""
    shown = [one for one in found.spreads if one.median and one.least != one.greatest][:_MOST]
    for place, one in enumerate(shown):
        ratio = np.array(found.values(one.name)) / one.median
        axes.plot(ratio, np.full(len(ratio), -place), ".", color=_COLOUR, alpha=0.6)
    labels = [f"{one.name}  {one.median:.4g} {one.unit}".rstrip(" 1") for one in shown]
    axes.set_yticks([-place for place in range(len(shown))], labels, fontsize=8)
    axes.set_xlabel("ratio to the median, which stands beside the name")
    opened = found.values(ONSET)
    axes.set_title(f"{len(opened)} of {len(found.seen)} runs open" if opened else "spread over the seeds")


def _spectrum(axes: Axes, found: Repeats) -> None:
    """Median and range of the spectra, line by line."""
    seen = [one for one in found.seen if one.s]
    if not seen:
        axes.set_axis_off()
        axes.text(0.5, 0.5, "no run is long enough for a spectrum", ha="center", transform=axes.transAxes)
        return
    f = np.array(seen[0].f)[1:]
    s = np.array([one.s for one in seen if len(one.s) == len(seen[0].s)])[:, 1:]
    axes.fill_between(f, s.min(axis=0), s.max(axis=0), color=_BAND, label="range")
    axes.semilogy(f, np.median(s, axis=0), color=_COLOUR, label="median")
    axes.set_xlabel("frequency [Hz]")
    axes.set_ylabel(f"power spectral density of {seen[0].name} [({seen[0].unit})$^2$/Hz]")
    axes.set_title(f"spectrum, {len(s)} runs")
    axes.legend()
