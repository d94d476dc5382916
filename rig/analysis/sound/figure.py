"""A sound as a picture: the signal, its short-time spectrum, its level."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rig.analysis.sound.hearing import Sound
from rig.view import timeline
from rig.view.curves import plain
from rig.view.palette import BLUE, GREEN, GREY, VERMILION
from rig.view.run_figure import STYLE
from rig.view.save_figure import page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LINE, _TONE, _WORK = BLUE, VERMILION, GREEN
_COLUMNS = 2400
_RANGE = 70.0  # dB of the spectrum that are shown


def figure(sound: Sound) -> Figure:
    """Return the figure of `sound`."""
    with page(STYLE, 12.0, 7.6, layout="constrained") as figure:
        signal, spectrum, level = figure.subplots(3, 1, sharex=True, height_ratios=(1.0, 1.5, 1.0))
        every = -(-sound.v.size // _COLUMNS)
        edges = np.arange(0, sound.v.size, every)
        t = sound.start + edges / sound.rate
        low, high = np.minimum.reduceat(sound.v, edges), np.maximum.reduceat(sound.v, edges)
        signal.fill_between(t, low, high, color=_LINE, lw=0.5)
        signal.set_ylabel(f"{plain(sound.channel)} [{sound.unit}]")
        for span in timeline.controlled(sound.run):
            if span.begin > 0.0 or span.end < timeline.end_of(sound.run):  # one that works throughout needs no mark
                for axes in (signal, level):
                    axes.axvspan(span.begin, span.end, color=_WORK, alpha=0.12, lw=0)
                signal.annotate(span.text, (span.begin, 1.01), xycoords=("data", "axes fraction"), color=_WORK)
        shown = sound.frequencies <= max(6e3, 1.5 * max((one.highest for one in sound.squeals), default=0.0))
        top = float(sound.spectrum.max())
        mesh = spectrum.pcolormesh(sound.times, 1e-3 * sound.frequencies[shown], sound.spectrum[:, shown].T,
                                   vmin=top - _RANGE, vmax=top, cmap="magma", shading="nearest")  # fmt: skip
        mesh.set_rasterized(True)
        spectrum.grid(visible=False)
        spectrum.set_ylabel("frequency [kHz]")
        bar = figure.colorbar(mesh, ax=spectrum, label=f"level [{sound.reference}]", pad=0.01)
        bar.outline.set_visible(False)  # type: ignore[operator]
        level.plot(sound.times, sound.level, color=_LINE, label="total")
        level.plot(sound.times, sound.tone, color=_TONE, label="loudest tone above 1 kHz")
        level.axhline(sound.threshold, color=GREY, lw=0.8, ls=":", label="squeal above")
        level.set(ylabel=f"level [{sound.reference}]", xlabel="time [s]", xlim=(sound.times[0], sound.times[-1]))
        level.set_ylim(max(float(np.percentile(sound.tone, 1.0)) - 5.0, float(sound.level.max()) - 120.0), None)
        level.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.0)
        figure.suptitle(f"{sound.scene}: {plain(sound.channel)}", x=0.01, ha="left", fontsize=13, fontweight="bold")
    return figure
