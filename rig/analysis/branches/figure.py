"""The figure of branches: extremes of the output over the parameter, stability by line style, stick share as colour."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.analysis.branches.curves import Curves
from rig.analysis.branches.result import CYCLES, FORCED, REST, SLIDING, TURNS, Branch, Branches, Point
from rig.scenes.axis import heading
from rig.view.curves import plain, read_in
from rig.view.palette import ALARM, BARE, BLUE, GREEN, GREY, LINES, PURPLE, VERMILION, page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

THIN = 1.1  # pt, of equilibria
THICK = 2.0  # pt, of cycles
DASHED = ((0, (2.2, 1.8)), "unstable")
_LISTED = 3  # values of a kind of special point that fit into a line of the legend
SYMBOLS = {
    "hopf": ("o", "Hopf point", ALARM),
    "fold": ("D", "fold", BLUE),
    "grazing": ("s", "grazing", VERMILION),
    "jump": ("X", "jump", ALARM),
    "canard": ("d", "canard", BLUE),
    "period doubling": ("P", "period doubling", PURPLE),
    "torus": ("h", "torus point", PURPLE),
    "lift-off": ("^", "lift-off", GREEN),
    "end of lift-off": ("^", "lift-off", GREEN),
    "landing": ("v", "landing", GREEN),
    "begin of stick": ("<", "begin or end of stick", GREY),
    "end of stick": ("<", "begin or end of stick", GREY),
    **{f"{way} of reversal": (">", "begin or end of reversal", GREY) for way in ("begin", "end")},
    "unresolved": ("x", "not followed further", GREY),
}


def branches_figure(result: Branches) -> Figure:
    """Return the figure of branches with their special points."""
    with page(9.6, 6.4, style=BARE, layout="constrained") as figure:
        _draw(figure, result)
    return figure


def curves_figure(result: Curves) -> Figure:
    """Return the figure of special points over two parameters."""
    with page(9.6, 6.4, style=BARE, layout="constrained") as figure:
        axes = figure.add_subplot()
        for (name, along, up), colour in zip(result.lines(), LINES * len(result.curves)):
            x = along / result.axis.scale
            y = up / result.second.scale
            axes.plot(x, y, "-o", ms=3.5, color=colour, label=name, clip_on=False)
        ends = result.second.shown_values[[0, -1]]
        axes.set(xlabel=result.axis.title, ylabel=result.second.title, ylim=sorted(ends))
        axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.11), ncols=3)
        heading(figure, result.scene, [result.axis, result.second], "special points")
    return figure


def _draw(figure: Figure, result: Branches) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.lines import Line2D

    axes = figure.add_subplot()
    kinds = {branch.kind for branch in result.branches}
    most = max((point.stick for _, branch, point in result.points() if branch.kind != REST), default=0.0)
    colours: Any = ScalarMappable(Normalize(0.0, most or 1.0), _colours())
    for branch in result.branches:
        _curve(axes, branch, result.axis.scale, colours)
    axes.autoscale_view()
    handles: list[Any] = []
    for style, label in (("-", "stable"), DASHED):
        handles.append(Line2D([], [], color=GREY, ls=style, label=label))
    if SLIDING in kinds:
        handles.append(Line2D([], [], color="black", lw=THIN, label="steady sliding"))
    if any(point.stick == 0.0 for _, branch, point in result.points() if branch.kind in (CYCLES, FORCED)):
        handles.append(Line2D([], [], color=colours.to_rgba(0.0), lw=THICK, label="cycle without stick"))
    handles += _special_points(axes, result)
    if REST in kinds:
        handles.append(axes.collections[0])
    unit = read_in(axes.yaxis, result.unit, max(map(abs, axes.get_ylim())))
    axes.set(xlabel=result.axis.title, ylabel=f"lowest and highest {plain(result.output)} [{unit}]")
    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.0, -0.11), ncols=3)
    if most:
        figure.colorbar(colours, ax=axes, label="share of the period in stick", pad=0.02)
    heading(figure, result.scene, [result.axis], "stable and unstable motions")


def _special_points(axes: Axes, result: Branches) -> list[Any]:
    """Draw the special points; return a handle of each kind for the legend, with the values of the kind if few."""
    from matplotlib.lines import Line2D

    handles: dict[str, Any] = {}
    values: dict[str, list[float]] = {}
    for special in result.specials:
        marker, label, colour = SYMBOLS.get(special.kind, ("*", special.kind, GREY))
        if special.turns and special.kind in TURNS:
            label = f"{label} fold"
        style: dict[str, Any] = {"marker": marker, "color": colour, "mfc": "white", "mew": 1.4, "ls": ""}
        both = [special.value / result.axis.scale] * 2
        axes.plot(both, [special.low, special.high], ms=7.0, zorder=5, **style)
        if label not in handles:
            handles[label] = Line2D([], [], label=label, **style)
        values.setdefault(label, []).append(special.value)
    for label, handle in handles.items():
        if len(values[label]) <= _LISTED:
            texts = dict.fromkeys(result.axis.text(value, 5) for value in values[label])
            handle.set_label(f"{label}: {', '.join(texts)}")
    return list(handles.values())


def _colours() -> Colormap:
    """Viridis without its ends, which are hard to tell from black and from white."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps["viridis"](np.linspace(0.1, 0.93, 256)))


def _curve(axes: Axes, branch: Branch, scale: float, colours: Any) -> None:
    from matplotlib.collections import LineCollection

    points = branch.points
    if branch.kind == REST:
        x = [point.value / scale for point in points]
        low = [point.low for point in points]
        high = [point.high for point in points]
        axes.fill_between(x, low, high, color=GREY, alpha=0.3, lw=0, label=REST)
        return
    equilibrium = branch.kind == SLIDING
    width = THIN if equilibrium else THICK
    for begin, last, stable in _runs(points):
        part = points[begin : last + 1]
        share = np.array([0.5 * (a.stick + b.stick) for a, b in pairwise(part)])
        colour: Any = "black" if equilibrium else colours.to_rgba(share)
        order = 3 if stable else 2
        for name in ("low",) if equilibrium else ("low", "high"):
            xy = np.array([(point.value / scale, getattr(point, name)) for point in part])
            pieces = list(np.stack([xy[:-1], xy[1:]], axis=1))
            lines = LineCollection(pieces, linewidths=width, colors=colour, capstyle="round", zorder=order)
            axes.add_collection(lines)
            if not stable:  # gaps over the line, which keeps its colours
                axes.plot(*xy.T, color="white", lw=width + 0.8, ls=DASHED[0], dash_capstyle="butt", zorder=2)


def _runs(points: Sequence[Point]) -> Iterator[tuple[int, int, bool]]:
    """First and last of neighbouring points of the same stability, which overlap by the line between them."""
    stable = [a.stable and b.stable for a, b in pairwise(points)]
    begin = 0
    for i in range(1, len(stable) + 1):
        if i == len(stable) or stable[i] != stable[begin]:
            yield begin, i, stable[begin]
            begin = i
