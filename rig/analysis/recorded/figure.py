"""Figures of the analyses of a recording."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from rig.analysis.recorded.hysteresis import Hysteresis
from rig.analysis.recorded.orders import Orders
from rig.analysis.recorded.pressure import Pressure
from rig.analysis.recorded.series import squared
from rig.analysis.recorded.spectrum import Density, Line, Map, Spectrum
from rig.printable import counted
from rig.view.curves import plain, thinned
from rig.view.palette import AMBER, BLUE, GREY
from rig.view.pressure_maps import draw_map, draw_scale
from rig.view.run_figure import STYLE
from rig.view.save_figure import page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_UP, _DOWN, _LINE = BLUE, AMBER, GREY
_RANGE = 70.0
"""Range of a map [dB below its maximum]."""
_NAMED, _APART = 3, 0.35
"""Number of lines that a picture labels, and their smallest distance [decades]."""
_ALL = 1e-4
"""Share of the mean square that may lie above the range of a map."""


@contextmanager
def sheet(title: str, size: tuple[float, float]) -> Iterator[Figure]:
    """Yield an empty figure of `size` [inches] to draw on; it gets its title at the end."""
    with page(STYLE, *size, layout="constrained") as figure:
        yield figure
        figure.suptitle(title, x=0.01, ha="left", fontsize=13, fontweight="bold")


def hysteresis_figure(found: Hysteresis) -> Figure:
    """Draw the RMS over the speed, and both over time."""
    over, name = plain(found.over), plain(found.name)
    with sheet(f"{found.scene}: {name} over {over}", (12.0, 8.0)) as figure:
        loop, rms, speed = figure.subplots(3, 1, height_ratios=(2.4, 1.0, 0.7))
        rms.sharex(speed)
        labelled = set()
        for curve in found.curves:
            way, colour, dashes = ("rising", _UP, "-") if curve.branch.rises else ("falling", _DOWN, "--")
            label = f"{over} {way}"
            loop.plot(
                *thinned(curve.speed, curve.rms), color=colour, ls=dashes, label=None if label in labelled else label
            )
            labelled.add(label)
            for axes, values in ((rms, curve.rms), (speed, curve.speed)):
                axes.plot(*thinned(curve.t, values), color=colour)
            if math.isfinite(curve.stick):
                what = "last stick" if curve.branch.rises else "first stick"
                loop.axvline(
                    curve.stick, color=colour, lw=0.9, ls=":", label=f"{what}: {curve.stick:.4g} {found.over_unit}"
                )
        window = f"centred window of {found.window:.4g} s"
        loop.set_title(f"RMS about the mean, {window}")
        loop.set(xlabel=f"{over} [{found.over_unit}]", ylabel=f"RMS of {name} [{found.unit}]")
        loop.set_ylim(0.0, None)
        loop.legend(loc="best")
        rms.set(ylabel=f"RMS [{found.unit}]")
        rms.set_ylim(0.0, None)
        rms.tick_params(labelbottom=False)
        speed.set(ylabel=f"{over}\n[{found.over_unit}]", xlabel="time [s]")
        figure.align_ylabels([rms, speed])
    return figure


def spectrum_figure(found: Spectrum, order: Orders | None = None) -> Figure:
    """Draw density and spectrogram, and those over orders."""
    size = (12.0, 7.6) if order is None else (15.0, 8.0)
    with sheet(f"{found.scene}: spectrum of {plain(found.name)}", size) as figure:
        (density, *beside), (spectrogram, *below) = figure.subplots(2, 1 if order is None else 2, squeeze=False)
        _density(density, found.density, found.lines, f"{squared(found.unit)}/Hz", "Hz")
        density.set(
            title=f"mean of {counted(found.density.windows, 'Hann window')} of {found.window:.4g} s",
            xlabel="frequency [Hz]",
        )
        _map(spectrogram, found.map, found.density, f"level [dB re 1 {squared(found.unit)}/Hz]")
        spectrogram.set(title=f"windows of {found.map_window:.4g} s", xlabel="time [s]", ylabel="frequency [Hz]")
        if order is not None:
            per = order.per
            _density(beside[0], order.density, order.lines, f"{squared(found.unit)}*{per}", f"1/{per}")
            beside[0].set(
                title=f"mean of {counted(order.density.windows, 'Hann window')} of {order.window:.4g} {per}, "
                f"over {plain(order.over)}",
                xlabel=f"order [1/{per}]",
            )
            _map(below[0], order.map, order.density, f"level [dB re 1 {squared(found.unit)}*{per}]")
            below[0].set(title=f"windows of {order.map_window:.4g} {per}", xlabel="time [s]", ylabel=f"order [1/{per}]")
    return figure


def _density(axes: Axes, density: Density, lines: tuple[Line, ...], unit: str, axis: str) -> None:
    axes.loglog(density.f[1:], density.s[1:], color=_UP)
    low, high = axes.get_ylim()
    top = float(density.s[1:].max(initial=0.0))
    axes.set_ylim(max(low, 1e-12 * top) if top else low, 8.0 * high)
    axes.set_ylabel(f"power spectral density\n[{unit}]")
    named: list[float] = []
    for line in lines:
        if len(named) == _NAMED or any(abs(math.log10(line.at / other)) < _APART for other in named):
            continue
        named.append(line.at)
        digits = max(0, 3 - math.floor(math.log10(line.at)))  # at least four, without an exponent
        axes.annotate(f"{line.at:.{digits}f} {axis}", (line.at, line.density), (0, 5), textcoords="offset points",
                      ha="center", fontsize=9, color=_LINE,
                      bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0.0, "pad": 0.5})  # fmt: skip


def _map(axes: Axes, found: Map, density: Density, unit: str) -> None:
    above = np.cumsum(density.s[::-1])[::-1] / max(float(density.s.sum()), 1e-300)
    top = density.f[min(int(np.count_nonzero(above > _ALL)), density.f.size - 1)]
    shown = found.f <= max(1.3 * top, found.f[min(20, found.f.size - 1)])
    s = 10.0 * np.log10(np.maximum(found.s[shown], 1e-30))
    best = float(np.nanmax(s, initial=-300.0))
    mesh = axes.pcolormesh(found.t, found.f[shown], s, vmin=best - _RANGE, vmax=best, cmap="magma", shading="nearest")
    mesh.set_rasterized(True)
    axes.grid(visible=False)
    bar = axes.figure.colorbar(mesh, ax=axes, label=unit, pad=0.01)
    bar.outline.set_visible(False)  # type: ignore[operator]


def pressure_figure(found: Pressure) -> Figure:
    """Draw the maps, all on one scale."""
    across = 3 if len(found.maps) in (3, 5, 6, 9) else min(len(found.maps), 4)
    down = -(-len(found.maps) // across)
    with sheet(f"{found.scene}: pressure of the film", (1.2 + 3.0 * across, 1.9 + 2.4 * down)) as figure:
        drawn = figure.subplots(down, across, squeeze=False)
        largest = max(one.largest for one in found.maps)
        scale = found.points.scale
        for number, axes in enumerate(drawn.flat):
            if number >= len(found.maps):
                axes.set_axis_off()
                continue
            one = found.maps[number]
            draw_map(axes, found.points, one.pressures, scale, one.centre)
            head = f"({chr(ord('a') + number)}) {one.time:.5g} s, {100 * one.fraction:.0f} % in contact"
            axes.set_title("\n".join(filter(None, (head, one.why))), fontsize=9.5)
            if number + across >= len(found.maps):
                axes.set_xlabel("x on the slider [mm]")
            if number % across == 0:
                axes.set_ylabel("y on the slider [mm]")
        draw_scale(drawn[0, 0], scale, largest > scale, ax=drawn, location="bottom", aspect=45, shrink=0.7)
    return figure
