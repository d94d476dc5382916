"""The figure of branches: extremes of the output over the parameter, stability by line style, stick share as colour."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.analysis.axis import heading
from rig.analysis.branches.curves import Curves
from rig.analysis.branches.result import REST, SLIDING, Branch, Branches, Point
from rig.view.curves import plain
from rig.view.palette import ALARM, BARE, BLUE, GREEN, GREY, LINES, PURPLE, VERMILION, page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SYMBOLS = {
    "hopf": ("o", "Hopf point", ALARM),
    "fold": ("D", "fold", BLUE),
    "grazing": ("s", "grazing", VERMILION),
    "jump": ("X", "jump", ALARM),
    "period doubling": ("P", "period doubling", PURPLE),
    "torus": ("h", "torus point", PURPLE),
    "lift-off": ("^", "lift-off", GREEN),
    "end of lift-off": ("^", "lift-off", GREEN),
    "landing": ("v", "landing", GREEN),
    "begin of stick": ("<", "begin or end of stick", GREY),
    "end of stick": ("<", "begin or end of stick", GREY),
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
            axes.plot(along / result.axis.scale, up / result.second.scale, "-o", ms=3, color=colour, label=name)
        axes.set(xlabel=result.axis.title, ylabel=result.second.title)
        axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.11), ncols=3)
        heading(figure, result.scene, [result.axis, result.second], f"{result.scene.title}: special points")
    return figure


def _draw(figure: Figure, result: Branches) -> None:
    from matplotlib.colors import Normalize
    from matplotlib.lines import Line2D

    axes = figure.add_subplot()
    colours = Normalize(0.0, max((p.stick for *_, p in result.points()), default=0.0) or 1.0)
    for branch in result.branches:
        _curve(axes, branch, result.axis.scale, colours)
    handles = [
        Line2D([], [], color="black", ls=style, label=label)
        for style, label in (("-", "stable"), ((0, (4, 2)), "unstable"))
    ]
    seen: dict[str, Any] = {}
    for special in result.specials:
        marker, label, colour = SYMBOLS.get(special.kind, ("*", special.kind, GREY))
        label = f"{label} fold" if special.turns and special.kind == "grazing" else label
        x = special.value / result.axis.scale
        (drawn_at,) = axes.plot(
            [x, x], [special.low, special.high], marker, color=colour, ms=6.5, mfc="white", mew=1.4, zorder=5
        )
        seen.setdefault(label, drawn_at)
    for label, line in seen.items():
        handles.append(
            Line2D([], [], marker=line.get_marker(), color=line.get_color(), mfc="white", mew=1.4, ls="", label=label)
        )
    axes.set(xlabel=result.axis.title, ylabel=f"{plain(result.output)} [{result.unit}], extremes")
    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.0, -0.13), ncols=4)
    if any(point.stick for *_, point in result.points()):
        from matplotlib.cm import ScalarMappable

        figure.colorbar(ScalarMappable(colours, "viridis"), ax=axes, label="share of the period in stick", pad=0.02)
    heading(figure, result.scene, [result.axis], f"{result.scene.title}: stable and unstable motions")


def _curve(axes: Axes, branch: Branch, scale: float, colours: Any) -> None:
    from matplotlib import colormaps
    from matplotlib.collections import LineCollection

    points = branch.points
    if branch.kind == REST:
        axes.fill_between([p.value / scale for p in points], [p.low for p in points], [p.high for p in points],
                          color=GREY, alpha=0.3, lw=0, label=REST)  # fmt: skip
        return
    for begin, last, stable in _runs(points):
        part = points[begin : last + 1]
        for name in ("low", "high"):
            xy = np.array([(point.value / scale, getattr(point, name)) for point in part])
            share = np.array([0.5 * (a.stick + b.stick) for a, b in pairwise(part)])
            if not stable:  # dashes need one line
                xy, share = xy[None], share.mean(keepdims=True)
            else:
                xy = np.stack([xy[:-1], xy[1:]], axis=1)
            style = "solid" if stable else (0, (4, 2))
            colour = "black" if branch.kind == SLIDING else colormaps["viridis"](colours(share))
            axes.add_collection(LineCollection(list(xy), linestyles=[style], linewidths=1.6, colors=colour))
    axes.autoscale_view()


def _runs(points: Sequence[Point]) -> Iterator[tuple[int, int, bool]]:
    """First and last of neighbouring points of the same stability, which overlap by the line between them."""
    stable = [a.stable and b.stable for a, b in pairwise(points)]
    begin = 0
    for i in range(1, len(stable) + 1):
        if i == len(stable) or stable[i] != stable[begin]:
            yield begin, i, stable[begin]
            begin = i
