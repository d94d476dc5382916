"""Analyses of a recording as pictures."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rig.study.recorded.hysteresis import Hysteresis
from rig.view.figure import STYLE, thinned
from rig.view.put import put

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_UP, _DOWN, _LINE = "#1d4f91", "#d1802f", "#5a5a5a"


@contextmanager
def sheet(path: Path, title: str, size: tuple[float, float]) -> Iterator[Figure]:
    """An empty figure of `size` [inches] to draw on, written to `path` in the end; directories are made."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    path.parent.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(STYLE):  # type: ignore[arg-type]
        figure = Figure(figsize=size, dpi=125, facecolor="white", layout="constrained")
        FigureCanvasAgg(figure)
        yield figure
        figure.suptitle(title, x=0.01, ha="left", fontsize=13, fontweight="bold")
        put(figure, path)


def draw_hysteresis(found: Hysteresis, path: Path) -> None:
    """Draw the RMS over the speed, and both over time, into the file `path` (PNG; other endings as matplotlib does)."""
    with sheet(path, f"{found.scene}: {found.name} over {found.over}", (12.0, 8.0)) as figure:
        loop, rms, speed = figure.subplots(3, 1, height_ratios=(2.4, 1.0, 0.7))
        rms.sharex(speed)
        told = set()
        for curve in found.curves:
            way, colour = ("rising", _UP) if curve.branch.rises else ("falling", _DOWN)
            label = f"{found.over} {way}"
            loop.plot(*thinned(curve.speed, curve.rms), color=colour, label=None if label in told else label)
            told.add(label)
            for axes, values in ((rms, curve.rms), (speed, curve.speed)):
                axes.plot(*thinned(curve.t, values), color=colour)
            if math.isfinite(curve.stick):
                what = "last stick" if curve.branch.rises else "first stick"
                loop.axvline(
                    curve.stick, color=colour, lw=0.9, ls="--", label=f"{what}: {curve.stick:.4g} {found.over_unit}"
                )
        window = f"centred window of {found.window:.4g} s"
        loop.set_title(f"RMS about the mean, {window}")
        loop.set(xlabel=f"{found.over} [{found.over_unit}]", ylabel=f"RMS of {found.name} [{found.unit}]")
        loop.set_ylim(0.0, None)
        loop.legend(loc="best")
        rms.set(ylabel=f"RMS [{found.unit}]")
        rms.set_ylim(0.0, None)
        rms.tick_params(labelbottom=False)
        speed.set(ylabel=f"{found.over}\n[{found.over_unit}]", xlabel="time [s]")
        figure.align_ylabels([rms, speed])
