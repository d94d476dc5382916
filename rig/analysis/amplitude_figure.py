"""Amplitudes of a recording as a picture: one plot for each sensor, one bar for each stage of the run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rig.analysis.amplitude import Row
from rig.analysis.recorded.amplitudes import Amplitudes
from rig.errors import UsageError
from rig.view.palette import BLUE
from rig.view.run_figure import STYLE
from rig.view.save_figure import page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = 3
_BAR = BLUE


def figure(amplitudes: Amplitudes) -> Figure:
    """Return the figure of the amplitudes. Raises UsageError if no sensor has samples."""
    rows = amplitudes.rows
    sensors = list(dict.fromkeys(row.sensor for row in rows))
    if not sensors:
        raise UsageError("nothing to draw: no sensor has samples")
    columns = min(len(sensors), _COLUMNS)
    lines = math.ceil(len(sensors) / columns)
    with page(STYLE, 4.4 * columns, 1.0 + 3.2 * lines, layout="constrained") as figure:
        title = f"{amplitudes.scene}: amplitude in each stage", "(half of peak to valley) and frequency"
        figure.suptitle(("\n" if columns == 1 else " ").join(title), ha="center")
        for i, sensor in enumerate(sensors):
            _bars(figure.add_subplot(lines, columns, i + 1), [row for row in rows if row.sensor == sensor])
    return figure


def _bars(axes: Axes, rows: Sequence[Row]) -> None:
    first = rows[0]
    places = range(len(rows))
    bars = axes.bar(places, [row.found.half if row.found.cycles else 0.0 for row in rows], color=_BAR, width=0.6)
    labels = [f"{row.found.frequency:.4g} Hz" if row.found.cycles else "no cycle" for row in rows]
    axes.bar_label(bars, labels, fontsize=8, padding=2)
    axes.margins(y=0.15)
    axes.set_xticks(places, [row.stage for row in rows], rotation=20 if len(rows) > 3 else 0, fontsize=8)
    axes.set_ylabel(f"{first.sensor.replace('_', ' ')} [{first.unit}]")
    axes.grid(axis="x", visible=False)
    axes.set_axisbelow(True)
