"""The figure of a run of the plate rig.

phases and marks of the protocol                        maps of the film's pressure at selected instants,
acceleration of the slider                              which thin lines mark in the curves
normal and friction force
contact fraction
pressure centre                                         what the run was, and how it went

A plate without a slider, or bonded to it, has no maps, and panels only for the outputs that it has.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rig.record.film_points import Points, points_of
from rig.record.pressure_instants import Instant, characteristic
from rig.record.run import Reals, Run
from rig.view import timeline
from rig.view.caption import caption
from rig.view.channels import Channels
from rig.view.curves import (
    channels_of,
    curves,
    heading,
    legend,
    line,
    phases,
    plain,
    shade,
)
from rig.view.pressure_maps import draw_map, draw_scale

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.gridspec import SubplotSpec

_MEANS = 160
"""Number of mean values over a run, in panels that the vibration fills."""


class Panel(NamedTuple):
    """A panel: label of its axis, its outputs, factor to the unit of the axis, and whether to draw means."""

    label: str
    outputs: tuple[str, ...]
    factor: float = 1.0
    means: bool = False


_PANELS = (
    Panel("acceleration [m/s^2]", ("slider_acceleration",)),
    Panel("force [N]", ("friction_force", "normal_force")),
    Panel("contact fraction", ("contact_fraction",), means=True),
    Panel("pressure centre [mm]", ("pressure_centre_x", "pressure_centre_y"), 1e3, means=True),
)
_ALONE = (
    Panel("acceleration [m/s^2]", ("plate_acceleration",)),
    Panel("displacement [um]", ("plate_displacement",), 1e6),
)


def compose(figure: Figure, run: Run) -> None:
    """Draw `run` on an empty figure of 12.8 x 8.4 inches."""
    points = points_of(run.scene)
    if points is not None and run.signals.keys().isdisjoint(points.names):
        points = None
    panels = [p for p in (*_PANELS, *_ALONE) if _recorded(run, p) and (points is None or p not in _ALONE)]
    grid = figure.add_gridspec(
        1 + len(panels), 2, width_ratios=(2.0, 1), height_ratios=(0.3, *[4.4 / len(panels)] * len(panels)),
        hspace=0.13, wspace=0.13, left=0.076, right=0.985, top=0.94, bottom=0.072,
    )  # fmt: skip
    channels = channels_of(run)
    times = figure.add_subplot(grid[1, 0])
    drawn = [times, *(figure.add_subplot(grid[row, 0], sharex=times) for row in range(2, 1 + len(panels)))]
    phases(figure.add_subplot(grid[0, 0], sharex=times), run)
    times.set_xlim(timeline.begin_of(run), timeline.end_of(run) or 1.0)
    found = characteristic(run) if points is not None and run.time.size else []
    for axes, panel in zip(drawn, panels):
        _panel(axes, run, channels, panel)
        shade(axes, run, [])
        for instant in found:
            axes.axvline(run.time[instant.sample], ymax=0.85, color="#555555", lw=0.6, zorder=4)
        axes.tick_params(labelbottom=axes is drawn[-1])
    drawn[-1].set_xlabel("time [s]")
    if thin := thinning(run):
        axes = drawn[:2][-1]
        axes.text(0.995, 0.97, thin, transform=axes.transAxes, ha="right", va="top", fontsize=9, color="#777777")
    figure.align_ylabels(drawn)
    if points is not None and found:
        right = grid[:, 1].subgridspec(2, 1, height_ratios=(5.6, 1.0), hspace=0.2)
        _maps(figure, right[0], run, points, found)
        side = right[1]
    else:
        side = grid[:, 1].subgridspec(2, 1, height_ratios=(5.6, 1.0))[1]
    words = side.subgridspec(1, 2, width_ratios=(0.13, 1.0))[1]  # the names of the rows are to the left of it
    caption(figure.add_subplot(words), run, np.empty(0, np.int64))
    heading(figure, run)


def thinning(run: Run) -> str:
    """A note for outputs that a live run recorded at a reduced rate; "" if every sample was recorded."""
    gaps = np.diff(run.time)
    if not gaps.size or float(np.median(gaps)) < 1.5e-9 * run.step_ns:
        return ""
    rate = 1.0 / float(np.median(gaps))
    return f"outputs: {rate:.0f} per second; faster vibration appears as aliases"


def _panel(axes: Axes, run: Run, channels: Channels, panel: Panel) -> None:
    axes.set_ylabel(panel.label)
    if not panel.means:
        if panel.factor == 1.0:
            curves(axes, run, channels, _recorded(run, panel))
        else:
            _lines(axes, run, channels, panel)
        return
    size = max(run.time.size // _MEANS, 1)
    for output in _recorded(run, panel):
        colour = channels.colours[output]
        v = panel.factor * run.signals[output]
        fast = v.size > 4 * _MEANS
        line(axes, run.time, v, color=colour, alpha=0.35 if fast else 1.0, lw=0.8, label=plain(output), zorder=2)
        if fast:
            mean = f"mean of {1e-6 * size * run.step_ns:.2g} ms"
            axes.plot(_means(run.time, size), _means(v, size), color=colour, lw=1.8, label=mean, zorder=3)
    legend(axes, 4)


def _recorded(run: Run, panel: Panel) -> tuple[str, ...]:
    """The outputs of a panel, without those that a damaged recording has lost."""
    return tuple(output for output in panel.outputs if output in run.signals)


def _lines(axes: Axes, run: Run, channels: Channels, panel: Panel) -> None:
    for output in _recorded(run, panel):
        line(axes, run.time, panel.factor * run.signals[output], color=channels.colours[output], label=plain(output))
    legend(axes, 4)


def _means(v: Reals, size: int) -> Reals:
    """Means of `size` values each; NaN if one of them is NaN."""
    whole = v.size // size * size
    return np.asarray(v[:whole].reshape(-1, size).mean(axis=1))


def _maps(figure: Figure, place: SubplotSpec, run: Run, points: Points, found: list[Instant]) -> None:
    grid = place.subgridspec(len(found) // 2, 2, hspace=0.62, wspace=0.1)
    at = [instant.sample for instant in found]
    maps = points.maps({name: run.output(name)[at] for name in points.names})
    drawn = []
    for number, (instant, pressures) in enumerate(zip(found, maps)):
        axes = figure.add_subplot(grid[number // 2, number % 2])
        drawn.append(axes)
        centre = [float(run.output(f"pressure_centre_{axis}")[instant.sample]) for axis in "xy"]
        draw_map(axes, points, pressures, points.scale, centre)
        share = run.output("contact_fraction")[instant.sample]
        axes.set_title(f"{run.time[instant.sample]:.5g} s, {100 * share:.0f} % in contact\n{instant.why}", fontsize=9)
        axes.tick_params(labelsize=8.5, labelbottom=number >= len(found) - 2, labelleft=number % 2 == 0)
        if number >= len(found) - 2:
            axes.set_xlabel("x on the slider [mm]", fontsize=9)
        if number % 2 == 0:
            axes.set_ylabel("y on the slider [mm]", fontsize=9)
    beyond = bool(np.nanmax(maps) > points.scale)
    draw_scale(drawn[0], points.scale, beyond, ax=drawn, location="bottom", pad=0.13, aspect=40, fraction=0.05)
