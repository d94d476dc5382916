"""Contact pressure in figures: colours, maps, and the figure of a run with maps.

Colours of pressure: dark violet at zero to yellow at the upper end of the scale; white for open points. A point that
just touches is dark and an open point is bright, so that they cannot be confused. One scale serves all maps.

The figure of a run of a film, or of a structure with contact points:

phases and marks of the protocol                        maps of the contact pressure at selected instants,
motion, forces                                          which thin lines mark in the curves
contact fraction
pressure centre, of a slider on a film                  what the run was, and how it went

A plate without a slider, or bonded to it, has no maps, and panels only for the outputs that it has.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.record.film_points import Points, points_of
from rig.record.run import Reals, Run
from rig.record.statistics import Instant, characteristic
from rig.view.contact import rgb
from rig.view.curves import (
    BOTTOM,
    LEFT,
    RIGHT,
    Header,
    Sheet,
    caption,
    channels_of,
    curves,
    heading,
    legend,
    line,
    plain,
    shade,
    stacked,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.gridspec import SubplotSpec

    from rig.plants.structures.contact_map import Surface


OPEN = "#f4f4f4"
_STOPS = ("#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725")
"""viridis (matplotlib, public domain) at even steps."""
COUNT = 256


def table() -> NDArray[np.uint8]:
    """The colours of the scale from its lower to its upper end: uint8 [COUNT, rgb]."""
    stops = np.array([rgb(stop) for stop in _STOPS], np.float64)
    at = np.linspace(0.0, 1.0, len(stops))
    share = np.linspace(0.0, 1.0, COUNT)
    return np.stack([np.interp(share, at, stops[:, i]) for i in range(3)], axis=1).round().astype(np.uint8)


def colours(pressures: NDArray[np.float64], scale: float) -> NDArray[np.uint8]:
    """The colours [..., rgb] of `pressures` on a scale from 0 to `scale`; larger ones have its last colour."""
    share = np.clip(np.nan_to_num(pressures) / scale, 0.0, 1.0)
    coloured: NDArray[np.uint8] = table()[np.rint(share * (COUNT - 1)).astype(np.int64)]
    coloured[~(pressures > 0.0)] = rgb(OPEN)
    return coloured


_CENTRE = "#e4322b"
_BETWEEN = 0.3  # gap between two contacts on a map, over the width of the first


def draw_map(axes: Axes, surfaces: Sequence[Surface], maps: Sequence[Reals], scale: float) -> None:
    """Draw the pressures in Pa of each contact, on a scale from 0 to `scale`, with their centres; axes in mm.

    Several contacts lie side by side, over their names and shares of closed points.
    """
    from matplotlib.collections import PolyCollection

    begin, middles = 0.0, list[float]()
    for surface, pressures in zip(surfaces, maps):
        cells, pressed = 1e3 * surface.corners, pressures.ravel()
        left, right = float(cells[:, :, 0].min()), float(cells[:, :, 0].max())
        by = begin - left if len(surfaces) > 1 else 0.0
        cells = cells + np.array([by, 0.0])
        begin, middles = by + right + _BETWEEN * (right - left), [*middles, by + 0.5 * (left + right)]
        shades = colours(pressed, scale) / 255.0
        axes.add_collection(PolyCollection(list(cells), facecolors=shades, edgecolors=shades, linewidths=0.3))
        for cell in cells[~(pressed > 0.0)]:  # a diagonal line, visible in black and white too
            axes.plot(*cell[[0, 2]].T, color="#b0b0b0", lw=0.5)
        x, y = surface.centre(pressures)
        if np.isfinite((x, y)).all():
            axes.plot(1e3 * x + by, 1e3 * y, "o", ms=5.0, mfc=_CENTRE, mec="white", mew=0.9)
    axes.grid(visible=False)
    axes.autoscale_view()
    axes.margins(0.0)
    axes.set_aspect("equal")
    if len(surfaces) > 1:
        names = [f"{s.name}\n{100 * (pressed > 0.0).mean():.0f} %" for s, pressed in zip(surfaces, maps)]
        axes.set_xticks(middles, names)
        axes.tick_params(axis="x", length=0.0)
    for side in axes.spines.values():
        side.set_visible(len(surfaces) == 1)
        side.set_color("#9a9a9a")


def where(surfaces: Sequence[Surface]) -> tuple[str, str]:
    """The titles of the axes of a map."""
    x, y = surfaces[0].axes
    if surfaces[0].name == "film":
        return f"{x} on the slider [mm]", f"{y} on the slider [mm]"
    return f"position {x} [mm]" if len(surfaces) == 1 else "", f"position {y} [mm]"


def draw_scale(axes: Axes, scale: float, beyond: bool, **placed: Any) -> None:
    """Draw a colour bar for maps beside `axes`; `beyond`: whether pressures above its end occur."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    shades = ScalarMappable(Normalize(0.0, 1e-6 * scale), ListedColormap(table() / 255.0))
    bar = axes.figure.colorbar(shades, extend="max" if beyond else "neither", **placed)
    between = "\n" if placed.get("location") == "bottom" else "; "
    bar.set_label(f"pressure [MPa]{between}white, crossed: open; dot: pressure centre", fontsize=9)
    bar.outline.set_visible(False)  # type: ignore[operator]


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
    panels = [p for p in (*_PANELS, *_ALONE) if _recorded(run, p) and (points is None or p not in _ALONE)]
    if points is not None and points.surfaces[0].name != "film":
        motion = [Panel(p.title.partition(" [")[0], p.outputs) for p in channels.panels if p.outputs and p.place <= 1]
        panels = [*motion, *panels]
    outputs = [name for panel in panels for name in _recorded(run, panel)]
    sheet = Sheet.of(run, channels, outputs, {"m": 0.01} if points is not None else None)  # the maps are in mm
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


def _panel(axes: Axes, sheet: Sheet, panel: Panel) -> None:
    run, outputs = sheet.run, _recorded(sheet.run, panel)
    factor, unit = sheet.scales.of(run.units.get(outputs[0], ""))
    axes.set_ylabel(f"{panel.title} [{unit}]" if unit not in ("", "1") else panel.title)
    if not panel.means or sheet.style:
        curves(axes, sheet, outputs, [sensor for output in outputs for sensor in sheet.sensors(output)], factor)
        return
    size = max(run.time.size // _MEANS, 1)
    for output in outputs:
        colour = sheet.channels.colours[output]
        v = factor * run.signals[output]
        fast = v.size > 4 * _MEANS
        line(axes, run.time, v, color=colour, alpha=0.35 if fast else 1.0, lw=0.8, label=plain(output), zorder=2)
        if fast:
            mean = f"mean of {1e3 * size * float(np.median(np.diff(run.time))):.2g} ms"
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
