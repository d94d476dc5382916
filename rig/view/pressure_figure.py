"""The figure of a run of a film, or of a structure with contact points:

phases and marks of the protocol                        maps of the contact pressure at selected instants,
motion, forces                                          which thin lines mark in the curves
contact fraction
pressure centre, of a slider on a film                  what the run was, and how it went

A plate without a slider, or bonded to it, has no maps, and panels only for the outputs that it has.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rig.record.film_points import Points, points_of
from rig.record.run import Reals, Run
from rig.record.statistics import Instant, characteristic
from rig.view.channels import Channels
from rig.view.curves import Sheet, channels_of, curves, legend, line, plain
from rig.view.header import BOTTOM, LEFT, RIGHT, Header, caption, heading, shade, stacked
from rig.view.pressure import draw_map, draw_scale, where

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.gridspec import SubplotSpec

_MEANS = 160  # number of mean values over a run, in panels that the vibration fills


class Panel(NamedTuple):
    """A panel: title of its axis, its outputs, and whether to draw means."""

    title: str
    outputs: tuple[str, ...]
    means: bool = False


_PANELS = (
    Panel("acceleration", ("slider_acceleration",)),
    Panel("force", ("friction_force", "normal_force")),
    Panel("contact fraction", ("contact_fraction",), means=True),
    Panel("pressure centre", ("pressure_centre_x", "pressure_centre_y"), means=True),
)
_ALONE = (
    Panel("acceleration", ("plate_acceleration",)),
    Panel("displacement", ("plate_displacement",)),
)


def compose(figure: Figure, run: Run) -> None:
    """Draw `run` on an empty figure of 12.8 x 8.4 inches."""
    points = points_of(run.scene)
    if points is not None and run.signals.keys().isdisjoint(points.names):
        points = None
    channels = channels_of(run)
    panels = _panels(run, channels, points)
    outputs = [name for panel in panels for name in _recorded(run, panel)]
    in_maps = {"m": 0.01} if points is not None else None  # the maps are in mm
    sheet = Sheet.of(run, channels, outputs, in_maps)
    split = LEFT + (RIGHT - LEFT) * 0.64
    header = Header(figure, run, (split - LEFT) * figure.bbox.width)
    drawn, top = stacked(figure, run, header, len(panels), (LEFT, split, BOTTOM))
    instants = characteristic(run, points) if points is not None and run.time.size else []
    for axes, panel in zip(drawn, panels):
        _panel(axes, sheet, panel)
        shade(axes, run, [])
        for instant in instants:
            axes.axvline(run.time[instant.sample], ymax=0.85, color="#555555", lw=0.6, zorder=4)
        axes.tick_params(labelbottom=axes is drawn[-1])
    drawn[-1].set_xlabel("time [s]")
    figure.align_ylabels(drawn)
    right = figure.add_gridspec(
        2, 1, left=split + 0.045, right=RIGHT, top=top, bottom=BOTTOM, height_ratios=(5.6, 1.0), hspace=0.2
    )
    if points is not None and instants:
        _maps(figure, right[0], run, points, instants)
    words = right[1].subgridspec(1, 2, width_ratios=(0.13, 1.0))[1]  # the names of the rows are to the left of it
    caption(figure.add_subplot(words), run, np.empty(0, np.int64))
    heading(figure, run, LEFT)


def _panels(run: Run, channels: Channels, points: Points | None) -> list[Panel]:
    """The panels of a run, those without recorded outputs left out."""
    if points is None:
        return [panel for panel in (*_PANELS, *_ALONE) if _recorded(run, panel)]
    panels = [panel for panel in _PANELS if _recorded(run, panel)]
    if points.surfaces[0].name == "film":
        return panels
    motion = [panel for panel in channels.panels if panel.outputs and panel.place <= 1]
    titles = [panel.title.partition(" [")[0] for panel in motion]
    return [*(Panel(title, panel.outputs) for title, panel in zip(titles, motion)), *panels]


def _panel(axes: Axes, sheet: Sheet, panel: Panel) -> None:
    run = sheet.run
    outputs = _recorded(run, panel)
    factor, unit = sheet.scales.of(run.units.get(outputs[0], ""))
    axes.set_ylabel(f"{panel.title} [{unit}]" if unit not in ("", "1") else panel.title)
    if not panel.means or sheet.style:
        sensors = [sensor for output in outputs for sensor in sheet.sensors(output)]
        curves(axes, sheet, outputs, sensors, factor)
        return
    size = max(run.time.size // _MEANS, 1)
    for output in outputs:
        colour = sheet.channels.colours[output]
        v = factor * run.signals[output]
        fast = v.size > 4 * _MEANS
        opacity = 0.35 if fast else 1.0
        line(axes, run.time, v, color=colour, alpha=opacity, lw=0.8, label=plain(output), zorder=2)
        if fast:
            step = float(np.median(np.diff(run.time)))
            mean = f"mean of {1e3 * size * step:.2g} ms"
            axes.plot(_means(run.time, size), _means(v, size), color=colour, lw=1.8, label=mean, zorder=3)
    legend(axes, 4)


def _recorded(run: Run, panel: Panel) -> tuple[str, ...]:
    """The outputs of a panel, without those that a damaged recording has lost."""
    return tuple(output for output in panel.outputs if output in run.signals)


def _means(v: Reals, size: int) -> Reals:
    """Means of `size` values each; NaN if one of them is NaN."""
    whole = v.size // size * size
    return np.asarray(v[:whole].reshape(-1, size).mean(axis=1))


def _maps(figure: Figure, place: SubplotSpec, run: Run, points: Points, instants: list[Instant]) -> None:
    several = len(points.surfaces) > 1
    rows = -(-len(instants) // 2)
    grid = place.subgridspec(rows, 2, hspace=0.75 if several else 0.62, wspace=0.1)
    at = [instant.sample for instant in instants]
    picked = {name: run.output(name)[at] for name in points.names}
    maps = [surface.maps(picked) for surface in points.surfaces]
    x, y = where(points.surfaces)
    drawn = []
    for number, instant in enumerate(instants):
        axes = figure.add_subplot(grid[number // 2, number % 2])
        drawn.append(axes)
        now = [pressures[number] for pressures in maps]
        draw_map(axes, points.surfaces, now, points.scale)
        share = "" if several else f", {100 * float(np.mean(now[0] > 0.0)):.0f} % in contact"  # else under each map
        axes.set_title(f"{run.time[instant.sample]:.5g} s{share}\n{instant.why}", fontsize=9)
        last = number >= len(instants) - 2
        axes.tick_params(labelsize=8.5, labelbottom=last or several, labelleft=number % 2 == 0)
        if last:
            axes.set_xlabel(x, fontsize=9)
        if number % 2 == 0:
            axes.set_ylabel(y, fontsize=9)
    beyond = any(bool(np.nanmax(pressures) > points.scale) for pressures in maps)
    draw_scale(drawn[0], points.scale, beyond, ax=drawn, location="bottom", pad=0.13, aspect=40, fraction=0.05)
